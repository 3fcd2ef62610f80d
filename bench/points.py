#!/usr/bin/env python3
"""What denoising leaves of points of light: the table of docs/points.md.

    PYTHONPATH=build/release/python /usr/bin/python3 bench/points.py [--methods nl-ridge bm3d ...]

100 points on even light of 20 electrons, each a Gaussian of the given width (0: one pixel) whose peak, before the colour filters
take of it, is a number of deviations of the noise there; a NumPy camera of 1 DN/e- and 2.5 e- that is calibrated first from its
own frames. Prints, per layout, width and height: the light left within 4 pixels of the points, how much nearer to the truth
the frame is than the noisy one [dB], and the root mean square of error over stated error where the points have more than three
deviations.
"""
import argparse
import pathlib
import tempfile

import malus
import numpy as np

SIDE, GROUND, READ, BLACK, WHITE = 256, 20.0, 2.5, 100, 10000
COLOUR = {"polar-bayer-rggb": np.kron([[0.7, 1], [1, 0.6]], np.ones((2, 2))), "bayer-rggb": np.array([[0.7, 1], [1, 0.6]])}
ANGLE = np.array([[90, 45], [135, 0]])  # of a cell of 2x2


def tiled(cell):
    return np.tile(cell, (SIDE // cell.shape[0], SIDE // cell.shape[1]))


def seen_by(layout, light):
    if layout in COLOUR:
        light = light * tiled(COLOUR[layout])
    if layout.startswith("polar"):
        light = light * (1 + 0.3 * np.cos(np.radians(50 - 2 * tiled(ANGLE))))
    return light


def frame(electrons, random):
    return np.clip(np.round(BLACK + random.poisson(electrons) + READ * random.standard_normal(electrons.shape)), 0, WHITE).astype(np.uint16)


def calibrated(layout, folder):
    random = np.random.default_rng(3)
    text = f'[sensor]\nlayout = "{layout}"\nwhite = {WHITE}\nblack = {BLACK}\n'
    for number, (kind, count, light) in enumerate([("bias", 20, 0)] + [("flat", 4, level * WHITE) for level in (0.01, 0.03, 0.1, 0.3, 0.6)]):
        names = [f"{number}_{i}.npy" for i in range(count)]
        for name in names:
            np.save(folder / name, frame(np.full((SIDE, SIDE), float(light)), random))
        text += f'[[frames]]\nkind = "{kind}"\ngain_db = 0\n' + (f"level = {number}\n" if light else "") + f"paths = {names}\n".replace("'", '"')
    (folder / "session.toml").write_text(text)
    return malus.calibrate(malus.Session(folder / "session.toml"))


def light_of(width, deviations):
    random = np.random.default_rng(7)
    y, x = np.mgrid[:SIDE, :SIDE]
    light, near = np.full((SIDE, SIDE), GROUND), np.zeros((SIDE, SIDE), bool)
    for row in range(13, SIDE - 12, 25):
        for col in range(13, SIDE - 12, 25):
            at = random.uniform(-5.5, 5.5, 2) + (row, col)
            height = deviations * np.sqrt(GROUND + READ**2)
            if width == 0:
                light[int(at[0]), int(at[1])] += height
            else:
                light += height * np.exp(-((y - at[0]) ** 2 + (x - at[1]) ** 2) / (2 * width**2))
            near[int(at[0]) - 4:int(at[0]) + 5, int(at[1]) - 4:int(at[1]) + 5] = True
    return light, near


def measured(layout, model, method, width, deviations):
    light, near = light_of(width, deviations)
    truth, ground = seen_by(layout, light), seen_by(layout, np.full_like(light, GROUND))
    noisy = frame(truth, np.random.default_rng(1))
    name, _, profile = method.partition("/")
    result = malus.denoise(noisy, model=model, method=name, profile=profile or "normal", variance=True)
    off = result["dn"] - truth
    kept = (result["dn"] - ground)[near].sum() / (truth - ground)[near].sum()
    gain = 10 * np.log10(np.mean((noisy - float(BLACK) - truth) ** 2) / np.mean(off**2))
    point = truth - ground > 3 * np.sqrt(GROUND + READ**2)
    return kept, gain, np.sqrt(np.mean(off[point] ** 2 / result["variance"][point]))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--methods", nargs="+", default=["nl-ridge"])
    methods = parser.parse_args().methods
    for layout in ("polar-bayer-rggb", "bayer-rggb", "polar-mono", "mono"):
        with tempfile.TemporaryDirectory() as folder:
            model = calibrated(layout, pathlib.Path(folder))
        for width in (0, 0.5, 0.8, 1.5):
            for deviations in (8, 15, 26, 60):
                cells = [measured(layout, model, method, width, deviations) for method in methods]
                print(f"| {layout} | {width} | {deviations} | " + " | ".join("%.2f, %.1f, %.1f" % c for c in cells) + " |", flush=True)


if __name__ == "__main__":
    main()
