#!/usr/bin/env python3
"""What taking column noise out is worth: the table of docs/column-noise.md.

    PYTHONPATH=build/release/python /usr/bin/python3 bench/column_noise.py build/release/malus PICTURE...

A NumPy camera (Poisson, Gaussian read noise, rows and columns that are lifted anew in every frame, 12 bit), calibrated from its own
frames, and scenes of which light, DoLP and AoLP are known: drawn ones, and the pictures polarized by `malus simulate`. Prints, per
layout, deviation of rows and columns over that of the read noise, light (DN of white) and scene: PSNR of image and DoLP [dB], squared
error over what is stated of it (geometric mean over a scene's frames) and how often two stated deviations hold the truth, without the
columns' removal and with it. --default: as the version that PYTHONPATH names does it by itself, one column.
"""
import argparse
import pathlib
import subprocess
import tempfile
import warnings

import malus
import numpy as np

ROWS, COLS, K, READ, BLACK, WHITE = 512, 640, 0.5, 2.0, 100, 4095
LAYOUTS = ("polar-bayer-rggb", "polar-mono", "bayer-rggb")
ANGLE = np.array([[90, 45], [135, 0]])
COLOUR = np.array([[0, 1], [1, 2]])
TINT = np.array([0.9, 1.0, 0.7])
DRAWN = ("smooth", "bars", "stripes", "edges")


def frame(signal_dn, row_dn, column_dn, group, random):
    rows, cols = signal_dn.shape
    dn = K * random.poisson(signal_dn / K) + random.normal(0, READ, signal_dn.shape)
    dn += np.repeat(random.normal(0, row_dn, -(-rows // group)), group)[:rows, None]
    dn += random.normal(0, column_dn, cols)
    return np.clip(np.round(BLACK + dn), 0, WHITE).astype(np.uint16)


def group_of(layout):
    return 2 if layout.startswith("polar-bayer") else 1


def colour_of(layout, rows, cols):
    """0, 1, 2 for red, green, blue of these pixels; a sensor without colours is taken to see green."""
    assert layout == "polar-mono" or layout.endswith("bayer-rggb"), layout
    return COLOUR[rows // group_of(layout) % 2, cols // group_of(layout) % 2] if "bayer" in layout else np.ones_like(rows)


def calibrated(layout, ratio, folder, columns=1):
    random = np.random.default_rng(1)
    text = f'[sensor]\nlayout = "{layout}"\nblack = {BLACK}\nwhite = {WHITE}\nrow_group = {group_of(layout)}\n'
    for level in range(6):
        names = [f"{level}_{i}.npy" for i in range(2 if level else 30)]
        for name in names:
            light = np.full((ROWS, COLS), 450.0 * level)
            np.save(folder / name, frame(light, ratio * READ, columns * ratio * READ, group_of(layout), random))
        text += f'[[frames]]\nkind = "{"flat" if level else "bias"}"\ngain_db = 0\n' + (f"level = {level}\n" if level else "")
        text += f"paths = {names}\n".replace("'", '"')
    (folder / "session.toml").write_text(text)
    return malus.calibrate(malus.Session(folder / "session.toml"))


def drawn(kind):
    """S0, DoLP and AoLP [deg]."""
    r, c = np.mgrid[:ROWS, :COLS].astype(float)
    if kind == "smooth":
        return 0.55 + 0.25 * np.sin(r / 130) * np.cos(c / 170), 0.3 + 0.2 * np.sin(c / 90), 40 + 60 * np.sin(r / 150)
    if kind == "bars":
        checks = (c // 37 + r // 53) % 2
        return 0.35 + 0.4 * checks + 0.15 * np.sin(r / 60), 0.15 + 0.35 * (r // 71 % 2), 20 + 70 * (c // 83 % 2)
    if kind == "stripes":  # from narrow to wide, down the whole frame, and blinds of polarization
        light = 0.5 + 0.3 * np.sign(np.sin(2 * np.pi * c / (12 + 60 * (c / COLS))))
        return light, 0.25 + 0.15 * np.sign(np.sin(2 * np.pi * c / 45)), 30 + 0 * c
    edge = np.sort(np.random.default_rng(4).integers(0, COLS, 30))  # 6 % of contrast, down the whole frame
    light = 0.5 + 0.03 * (np.searchsorted(edge, c[0], "right") % 2) + 0.1 * np.sin(r / 90)
    return light, 0.3 + 0 * r, 60 + 0 * r


def mosaic(layout, s0, dolp, aolp):
    r, c = np.mgrid[:ROWS, :COLS]
    tint = TINT[colour_of(layout, r, c)]
    if not layout.startswith("polar"):
        return tint * s0
    return 0.5 * tint * s0 * (1 + dolp * np.cos(2 * np.radians(ANGLE[r % 2, c % 2] - aolp)))


def scenes(layout, program, pictures, folder):
    """Kind and light of 1 for white."""
    found = [(kind, mosaic(layout, *drawn(kind))) for kind in DRAWN]
    if pictures:
        polarized = ["--polarized"] if layout.startswith("polar") else []
        subprocess.run([program, "simulate", *pictures, *polarized, "--layout", layout, "--format", "npy", "-q", "-o", folder], check=True,
                       capture_output=True)
    for path in sorted(folder.glob("*.npy")):
        light = np.load(path).astype(float)
        row, col = (max(n - wanted, 0) // 2 // 4 * 4 for n, wanted in zip(light.shape, (ROWS, COLS)))
        light = light[row:row + ROWS, col:col + COLS]
        light = light[: light.shape[0] // 4 * 4, : light.shape[1] // 4 * 4]
        found.append(("pictures", np.clip(0.9 * light / np.percentile(light, 97), 0, 3)))
    return found


def dolp_of(layout, dn):
    step = 4 if group_of(layout) == 2 else 2
    colours = [(0, 0)] if step == 2 else [(0, 0), (0, 2), (2, 0), (2, 2)]
    at = {ANGLE[r, c]: np.stack([dn[y + r::step, x + c::step] for y, x in colours]) for r in (0, 1) for c in (0, 1)}
    s0 = sum(at.values()) / 2
    return np.clip(np.hypot(at[0] - at[90], at[45] - at[135]) / np.maximum(s0, 1e-3), 0, 1)


def psnr(error, peak):
    return 10 * np.log10(peak**2 / np.mean(error**2))


def scores(layout, clean, white, raw, model, settings):
    done = malus.denoise(raw, layout=layout, black=BLACK, white=WHITE, model=model, gain=0, variance=True, **settings)
    known = np.isfinite(done["variance"])
    error, stated = (done["dn"] - clean)[known], done["variance"][known]
    dolp = psnr(dolp_of(layout, done["dn"]) - dolp_of(layout, clean), 1) if layout.startswith("polar") else np.nan
    return psnr(error, white), dolp, np.log(np.mean(error**2) / np.mean(stated)), 100 * np.mean(error**2 <= 4 * stated)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("program")
    parser.add_argument("pictures", nargs="*")
    parser.add_argument("--ratios", nargs="+", type=float, default=[0.3, 1, 2])
    parser.add_argument("--lights", nargs="+", type=float, default=[40, 400])
    parser.add_argument("--default", action="store_true")
    arguments = parser.parse_args()
    warnings.simplefilter("ignore")  # of pictures that are smaller than the sensor
    ways = [{}] if arguments.default else [{"column_noise": False}, {"column_noise": True}]
    for layout in LAYOUTS:
        with tempfile.TemporaryDirectory() as folder:
            of_layout = scenes(layout, arguments.program, arguments.pictures, pathlib.Path(folder))
        for ratio in arguments.ratios:
            with tempfile.TemporaryDirectory() as folder:
                model = calibrated(layout, ratio, pathlib.Path(folder))
            for white in arguments.lights:
                rows = {}
                for kind, light in of_layout:
                    clean = white * light
                    raw = frame(clean, ratio * READ, ratio * READ, group_of(layout), np.random.default_rng(7))
                    rows.setdefault(kind, []).append([scores(layout, clean, white, raw, model, way) for way in ways])
                for kind, found in rows.items():
                    cells = [f"{image:.2f} / {dolp:.2f}, {np.exp(log):.2f} ({held:.0f})" for image, dolp, log, held in np.mean(found, axis=0)]
                    print(f"| {layout} | {ratio:g} | {white:g} | {kind} | " + " | ".join(cells) + " |", flush=True)


if __name__ == "__main__":
    main()
