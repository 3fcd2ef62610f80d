#!/usr/bin/env python3
"""Whether stated errors of denoised pixels are true: the first tables of docs/uncertainty.md.

    PYTHONPATH=build/release/python /usr/bin/python3 bench/uncertainty.py build/release/malus [--pictures PICTURE...] [--scenes SCENE...] [--marks | --textures]

A NumPy camera (Poisson, read noise of 2 DN, rows of half of that, 0.5 DN/e-, 12 bit), calibrated from its own frames, at 30, 200 and 2000 DN
for white, and scenes known without noise: those of drawn_scenes.py (256 pixels), points on a slow sky, the pictures polarized by `malus
simulate`, and the middle of SCENE folders (I0.png to I135.png). Prints per method, profile and layout a table: squared error over what is
stated of it (geometric mean over the frames; of all pixels also least to largest), and how often one and two stated deviations hold the
truth [%], of which 68 and 95 would be Gaussian; at the border two alone (the outer 8 pixels), and at edges (the strongest 1 % of the differences).
"""
import argparse
import pathlib
import subprocess
import tempfile
import warnings

import column_noise as camera
import drawn_scenes
import malus
import numpy as np
from PIL import Image
from scipy.ndimage import gaussian_filter

SIDE, LIGHTS = 256, (30, 200, 2000)
KINDS = {"even light": ("flat",), "ramps": ("ramp",), "waves, hills": ("waves", "blobs"), "discs": ("discs",), "points": ("points",),
         "letters": ("word", "page"), "weaves": ("weave_9", "weave_17"), "bars": ("bars",), "boards": ("board_8", "board_12", "board_16"),
         "boards of polarization": ("polboard_8", "polboard_16", "aolboard_16")}
RUNS = [("nl-ridge", "normal", "polar-bayer-rggb"), ("nl-ridge", "fast", "polar-bayer-rggb"), ("nl-ridge", "high", "polar-bayer-rggb"),
        ("bm3d", "normal", "polar-bayer-rggb"), ("nl-ridge", "normal", "polar-mono"), ("bm3d", "normal", "polar-mono"),
        ("nl-ridge", "normal", "bayer-rggb")]


def through_mosaic(layout, light, dolp, aolp):
    """light: (rows, cols, 3); what the layout's pixels see of it, 1 for white."""
    r, c = np.mgrid[:light.shape[0], :light.shape[1]]
    seen = np.take_along_axis(light, camera.colour_of(layout, r, c)[..., None], 2)[..., 0]
    if not layout.startswith("polar"):
        return seen
    return seen / 2 * (1 + dolp * np.cos(2 * (aolp - np.radians(camera.ANGLE[r % 2, c % 2]))))


def drawn(name):
    if name != "points":
        return drawn_scenes.scene(name, SIDE)
    y, x = np.mgrid[:SIDE, :SIDE] / SIDE
    light, random = 0.05 + 0.05 * x + 0.03 * y, np.random.default_rng(9)
    for row, col, height in zip(*random.uniform(4, SIDE - 4, (2, 120)), 10 ** random.uniform(-1.3, 0, 120)):
        light += height * np.exp(-((SIDE * y - row) ** 2 + (SIDE * x - col) ** 2) / (2 * 0.9**2))
    return np.minimum(light, 1)[..., None] * (0.9, 1, 0.8), 0.2 + 0 * x, 0.5 + 0 * x


def middle(picture):
    row, col = ((n - SIDE) // 8 * 4 for n in picture.shape[:2])
    return picture[row:row + SIDE, col:col + SIDE]


def photographed(folder, layout):
    planes = {angle: middle(np.asarray(Image.open(folder / f"I{angle}.png").convert("RGB")) / 255) for angle in (0, 45, 90, 135)}
    if not layout.startswith("polar"):
        return through_mosaic(layout, sum(planes.values()) / 4, 0, 0)
    seen, (r, c) = np.zeros((SIDE, SIDE)), np.mgrid[:SIDE, :SIDE]
    for angle, plane in planes.items():
        here = camera.ANGLE[r % 2, c % 2] == angle
        seen[here] = 2 * through_mosaic(layout, plane, 0, 0)[here]
    return seen


def scenes(layout, arguments, folder):
    found = [(kind, through_mosaic(layout, *drawn(name))) for kind, names in KINDS.items() for name in names]
    if arguments.pictures:
        polarized = ["--polarized"] if layout.startswith("polar") else []
        subprocess.run([arguments.program, "simulate", *arguments.pictures, *polarized, "--layout", layout, "--format", "npy", "-q", "-o", folder],
                       check=True, capture_output=True)
        found += [("pictures", middle(np.load(path) / 4000)) for path in sorted(folder.glob("*_clean.npy"))]
    return found + [("public scenes", photographed(scene, layout)) for scene in arguments.scenes]


def marked(clean, depth):
    """clean with three stains of 40 pixels and two scratches of two to three, both darker by `depth` deviations of the noise; where these are."""
    y, x = np.mgrid[:SIDE, :SIDE].astype(float)
    stains = sum(1 / (1 + np.exp(np.hypot(y - row, x - col) - 20)) for row, col in ((60, 60), (60, 190), (190, 60)))
    scratches = np.zeros(clean.shape, bool)
    for row, col, angle in ((128, 20, 0.2), (200, 150, 1.1)):
        along, across = (x - col) * np.cos(angle) + (y - row) * np.sin(angle), (y - row) * np.cos(angle) - (x - col) * np.sin(angle)
        scratches |= (np.abs(across) <= 1) & (along > 0) & (along < 130)
    return clean - depth * np.sqrt(camera.K * clean + camera.READ**2) * (stains + scratches), (stains > 0.5) & ~scratches, scratches


def judge_marks(layout, model):
    """Prints the table of faint marks on print: squared error over what is stated, and the share in two deviations, in stains and scratches."""
    print(f"\n| {layout} | depth [deviations] | all pixels | stains | scratches |\n|---|---|---|---|---|")
    for name in ("word", "page", "lines", "code_5"):
        for depth in (1, 2):
            cells = []
            for white in LIGHTS[1:]:
                clean, stains, scratches = marked(white * through_mosaic(layout, *drawn(name)), depth)
                raw = camera.frame(clean, 0.5 * camera.READ, 0, camera.group_of(layout), np.random.default_rng(white))
                done = malus.denoise(raw, layout=layout, black=camera.BLACK, white=camera.WHITE, model=model, gain=0, variance=True)
                cells.append([judged(clean, done, place) for place in (np.ones_like(stains), stains, scratches)])
            print(f"| {name} | {depth} | " + " | ".join(f"{np.exp(np.log(place[:, 0]).mean()):.2f}, {100 * place[:, 2].mean():.0f}"
                                                        for place in np.swapaxes(cells, 0, 1)) + " |", flush=True)


def judge_textures(method, layout, model):
    """Prints the table of textures above the noise: squared error over what is stated, and the share in two deviations, of pixels, S1 and S2, and DoLP."""
    print(f"\n| {method}, {layout} | depth [deviations] | pixels | S1, S2 | DoLP |\n|---|---|---|---|---|")
    white, random = 800 if layout.startswith("polar") else 400, np.random.default_rng(3)
    for name, blur in (("white", 0), ("blurred by 1 px", 1)):
        texture = gaussian_filter(random.normal(size=(SIDE, SIDE)), blur, mode="wrap")
        for depth in (10, 3):
            light = white * (1 + depth * np.sqrt(camera.K * 400 + camera.READ**2) / 400 * texture / texture.std())
            clean = through_mosaic(layout, np.maximum(light, 0)[..., None] * (0.9, 1, 0.8), 0.3, 0.5)
            raw = camera.frame(clean, 0, 0, camera.group_of(layout), np.random.default_rng(7))
            done = malus.denoise(raw, layout=layout, black=camera.BLACK, white=camera.WHITE, model=model, gain=0, variance=True, method=method)
            cells = ["{:.2f}, {:.0f}".format(*held(done["dn"] - clean, done["variance"]))]
            if layout.startswith("polar"):
                truth, shown = malus.stokes(clean, layout), malus.stokes(done["dn"], layout, variance=done["variance"])
                for names in (("s1", "s2"), ("dolp",)):
                    cells.append("{:.2f}, {:.0f}".format(*held(*(np.stack(planes) for planes in zip(*((shown[name] - truth[name], shown[name + "_sd"]**2)
                                                                                                  for name in names))))))
            print(f"| {name} | {depth} | " + " | ".join(cells) + " |", flush=True)


def held(error, stated):
    """Ratio of squares, percentage in two deviations."""
    known = np.isfinite(error) & np.isfinite(stated)  # DoLP is not where nothing shines
    error2, stated = error[known]**2.0, stated[known]
    return error2.mean() / stated.mean(), 100 * np.mean(error2 <= 4 * stated)


def places(clean, period):
    r, c = np.mgrid[:SIDE, :SIDE]
    border = np.minimum(np.minimum(r, c), SIDE - 1 - np.maximum(r, c)) < 8
    step = sum(np.abs(clean - np.roll(clean, shift, axis)) for axis in (0, 1) for shift in (-period, period))
    step[border] = 0
    limit = np.quantile(step, 0.99)
    return np.ones_like(border), border, (step >= limit) & (step > 0.02 * clean.max())


def judged(clean, done, place):
    """Ratio of squares, shares in one and in two deviations."""
    stated = done["variance"].astype(float)
    here = place & np.isfinite(stated)
    error2, stated = (done["dn"][here] - clean[here]) ** 2.0, stated[here]
    return error2.sum() / stated.sum(), np.mean(error2 <= stated), np.mean(error2 <= 4 * stated)


def checked(clean, done, period):
    """Per place ratio of squares, shares in one and in two deviations; None where a place has few pixels."""
    return [judged(clean, done, place) if place.sum() > 50 else None for place in places(clean, period)]


def row(kind, frames):
    cells = [kind]
    for number in range(3):
        known = np.array([frame[number] for frame in frames if frame[number]])
        if not len(known):
            cells.append("")
            continue
        ratio, one, two = np.exp(np.log(known[:, 0]).mean()), 100 * known[:, 1].mean(), 100 * known[:, 2].mean()
        cells.append(f"{ratio:.2f} ({known[:, 0].min():.2f} to {known[:, 0].max():.2f}), {one:.0f}, {two:.0f}" if number == 0 else f"{ratio:.2f}, {two:.0f}")
    return "| " + " | ".join(cells) + " |"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("program")
    parser.add_argument("--pictures", nargs="+", default=[])
    parser.add_argument("--scenes", nargs="+", type=pathlib.Path, default=[])
    parser.add_argument("--runs", nargs="+", type=int, default=range(len(RUNS)), help="of the list RUNS")
    parser.add_argument("--marks", action="store_true", help="faint marks on print in place of the scenes, nl-ridge in its normal profile")
    parser.add_argument("--textures", action="store_true", help="textures above the noise in place of the scenes, normal profile")
    arguments = parser.parse_args()
    warnings.simplefilter("ignore")  # of maps of the fixed pattern, which the camera has none of
    for method, profile, layout in [RUNS[number] for number in arguments.runs]:
        with tempfile.TemporaryDirectory() as folder:
            model = camera.calibrated(layout, 0.5, pathlib.Path(folder), columns=0)
        if arguments.textures:
            judge_textures(method, layout, model)
            continue
        with tempfile.TemporaryDirectory() as folder:
            found = scenes(layout, arguments, pathlib.Path(folder))
        if arguments.marks:
            judge_marks(layout, model)
            continue
        print(f"\n| {method}, `{profile}`, `{layout}` | all pixels | border | edges |\n|---|---|---|---|", flush=True)
        frames = {}
        for number, (kind, light) in enumerate(found):
            for white in LIGHTS:
                clean = white * light
                raw = camera.frame(clean, 0.5 * camera.READ, 0, camera.group_of(layout), np.random.default_rng(100 * number + white))
                done = malus.denoise(raw, layout=layout, black=camera.BLACK, white=camera.WHITE, model=model, gain=0, variance=True,
                                     method=method, profile=profile)
                frames.setdefault(kind, []).append(checked(clean, done, 4 if layout == "polar-bayer-rggb" else 2))
        for kind, results in frames.items():
            print(row(kind, results), flush=True)
        print(row(f"all {sum(map(len, frames.values()))} frames", sum(frames.values(), [])), flush=True)


if __name__ == "__main__":
    main()
