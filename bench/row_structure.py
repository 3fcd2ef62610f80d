#!/usr/bin/env python3
"""What row noise removal does to a picture's own rows: the table of docs/row-noise.md.

    PYTHONPATH=build/release/python /usr/bin/python3 bench/row_structure.py

A NumPy camera (that of column_noise.py without columns), calibrated from its own frames, and scenes that are made of rows. Prints, per
layout, deviation of rows over that of the read noise, light (DN of white) and scene: image PSNR [dB], squared error over what is stated
of it and how often two stated deviations hold the truth [%], by default and with row_noise=False; then the PSNR of the frame itself and
of the results without a model, by default and with row_noise=False. One draw of the noise each.
"""
import argparse
import pathlib
import tempfile
import warnings

import column_noise as camera
import malus
import numpy as np

KINDS = ("smooth", "stripes of half", "faint stripes", "bars", "text", "windows")
READ, BLACK, WHITE, ROWS, COLS = camera.READ, camera.BLACK, camera.WHITE, camera.ROWS, camera.COLS


def drawn(kind):
    """Light of 1 for white; equal along the rows but for text and the smooth scene."""
    r, c = np.mgrid[:ROWS, :COLS].astype(float)
    random = np.random.default_rng(6)
    if kind == "smooth":
        return camera.drawn("smooth")[0]
    if kind == "stripes of half":  # 6 rows on, 6 off
        return np.where(r < 272, 0.5, np.where(r // 6 % 2, 0.25, 0.75))
    if kind == "faint stripes":  # 4 rows on, 4 off, 5 % of contrast
        return np.where(r // 4 % 2, 0.525, 0.475)
    if kind == "bars":  # of 4 to 16 rows
        edge = np.cumsum(random.integers(4, 17, ROWS))
        return random.uniform(0.3, 0.7, ROWS)[np.searchsorted(edge, r, "right")]
    if kind == "windows":  # lit, 12 columns wide in lines of 16 rows, on a ground of 1 %
        lit = np.where(random.random((ROWS // 16, COLS // 12 + 1)) < 0.15, 0.02 * 30 ** random.random((ROWS // 16, COLS // 12 + 1)), 0.01)
        lit = lit.repeat(16, 0).repeat(12, 1)[:, :COLS]
        return np.where(r % 64 < 16, lit, 0.01)
    light, top = np.full((ROWS, COLS), 0.9), 3  # text: marks of 3 columns in lines of 4 to 14 rows
    while top < ROWS - 14:
        height = int(random.integers(4, 15))
        light[top:top + height, np.repeat(random.random(COLS // 3 + 1) < 0.35, 3)[:COLS]] = 0.12
        top += height + int(random.integers(4, 10))
    return light


def shown(layout, clean, white, raw, settings):
    done = malus.denoise(raw, layout=layout, black=BLACK, white=WHITE, variance=True, **settings)
    error, stated = done["dn"] - clean, done["variance"]
    known = np.isfinite(stated)
    return (f"{camera.psnr(error, white):.2f}", f"{np.mean(error[known]**2) / np.mean(stated[known]):.2f}",
            f"{100 * np.mean(error[known]**2 <= 4 * stated[known]):.0f}")


def main():
    warnings.simplefilter("ignore")  # of noise estimated from a picture
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--layouts", nargs="+", default=["polar-bayer-rggb", "bayer-rggb"])
    parser.add_argument("--ratios", nargs="+", type=float, default=[0, 0.5, 1])
    parser.add_argument("--lights", nargs="+", type=float, default=[20, 400])
    parser.add_argument("--kinds", nargs="+", default=KINDS)
    arguments = parser.parse_args()
    for layout in arguments.layouts:
        group = camera.group_of(layout)
        for ratio in arguments.ratios:
            with tempfile.TemporaryDirectory() as folder:
                model = camera.calibrated(layout, ratio, pathlib.Path(folder), columns=0)
            for white in arguments.lights:
                for kind in arguments.kinds:
                    clean = white * camera.mosaic(layout, drawn(kind), 0.2, 50)
                    raw = camera.frame(clean, ratio * READ, 0, group, np.random.default_rng(7))
                    ways = [shown(layout, clean, white, raw, {"model": model, "gain": 0, "row_noise": on}) for on in (True, False)]
                    blind = [shown(layout, clean, white, raw, {"row_noise": on})[0] for on in (True, False)]
                    cells = [f"{psnr}, {error} ({held})" for psnr, error, held in ways]
                    cells.append(f"{camera.psnr(raw.astype(float) - BLACK - clean, white):.2f}, " + ", ".join(blind))
                    print(f"| {layout} | {ratio:g} | {white:g} | {kind} | " + " | ".join(cells) + " |", flush=True)


if __name__ == "__main__":
    main()
