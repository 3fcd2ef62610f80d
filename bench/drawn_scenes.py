#!/usr/bin/env python3
"""Polarized scenes drawn from formulas, without noise or 8-bit steps of their own, for `malus experiment denoise`.

    /usr/bin/python3 bench/drawn_scenes.py FOLDER [--size 384] [--charts]

Writes FOLDER/NAME/I0.png, I45.png, I90.png, I135.png (16 bits, RGB) for every NAME of SCENES; with --charts of CHARTS:
checkerboards of light and, in even light, of polarization, by the size of their squares in pixels.
"""
import argparse
import pathlib
import subprocess

import numpy as np


def scene(name, size):
    """Light per colour (rows, cols, 3) in 0..1, DoLP and AoLP [rad] (rows, cols)."""
    y, x = np.mgrid[0:size, 0:size] / size
    colour = lambda light, rgb: light[..., None] * np.array(rgb)
    random = np.random.default_rng(7)
    if name == "flat":
        return colour(np.full_like(x, 0.5), (0.8, 1.0, 0.7)), np.full_like(x, 0.2), np.full_like(x, 0.6)
    if name == "ramp":
        return colour(0.1 + 0.8 * x, (0.9, 1.0, 0.8)), 0.05 + 0.5 * y, np.pi * (x + y) / 2
    if name == "waves":
        light = 0.5 + 0.35 * np.sin(2 * np.pi * (6 * x + 3 * y)) * np.cos(2 * np.pi * 4 * y)
        return (np.stack([light, 0.9 * light + 0.05, 0.6 + 0.3 * np.cos(2 * np.pi * 5 * (x - y))], -1),
                0.3 + 0.25 * np.sin(2 * np.pi * 3 * x), np.pi * y + 0.4 * np.sin(2 * np.pi * 4 * x))
    if name == "blobs":  # smooth hills, each of one colour and polarization
        light, s1, s2 = np.full((size, size, 3), 0.15), np.zeros((size, size)), np.zeros((size, size))
        for _ in range(24):
            row, col, width = random.uniform(0, 1, 2).tolist() + [random.uniform(0.03, 0.15)]
            hill = np.exp(-((x - col) ** 2 + (y - row) ** 2) / (2 * width**2))
            light += hill[..., None] * random.uniform(0.05, 0.4, 3)
            dolp, aolp = random.uniform(0, 0.6), random.uniform(0, np.pi)
            s1, s2 = s1 + hill * dolp * np.cos(2 * aolp), s2 + hill * dolp * np.sin(2 * aolp)
        return np.minimum(light, 0.95), np.minimum(np.hypot(s1, s2), 0.8), np.arctan2(s2, s1) / 2
    if name in CHARTS:
        side = int(name.rpartition("_")[2])
        row, col = np.mgrid[0:size, 0:size] // side
        bright = (row + col) % 2 == 0
        if name.startswith("board"):
            return colour(np.where(bright, 0.7, 0.2), (0.9, 1.0, 0.8)), np.full_like(x, 0.3), np.full_like(x, 0.5)
        return colour(np.full_like(x, 0.45), (0.9, 1.0, 0.8)), np.where(bright, 0.4, 0.1), np.full_like(x, 0.5)
    # Discs one over the other: edges, even or shaded areas, one polarization each.
    light, dolp, aolp = colour(0.3 + 0.2 * y, (1.0, 0.9, 0.8)), np.full_like(x, 0.1), np.full_like(x, 0.3)
    for _ in range(40):
        row, col, radius = random.uniform(0, 1, 2).tolist() + [random.uniform(0.03, 0.15)]
        inside = (x - col) ** 2 + (y - row) ** 2 < radius**2
        shade = 1 + random.uniform(-2, 2) * (x - col)
        light[inside] = (shade[..., None] * random.uniform(0.05, 0.9, 3))[inside]
        dolp[inside], aolp[inside] = random.uniform(0, 0.7), random.uniform(0, np.pi)
    return np.clip(light, 0.02, 0.95), dolp, aolp


SCENES = ("flat", "ramp", "waves", "blobs", "discs")
CHARTS = ("board_8", "board_12", "board_16", "polboard_8", "polboard_16")


def write_png(path, picture):
    """picture: (rows, cols, 3) in 0..1, written with 16 bits by OpenImageIO's oiiotool (openimageio-tools)."""
    pixmap = path.with_suffix(".pfm")  # rows from the bottom up, little-endian
    pixmap.write_bytes(b"PF\n%d %d\n-1\n" % (picture.shape[1], picture.shape[0])
                       + np.clip(picture[::-1], 0, 1).astype("<f4").tobytes())
    subprocess.run(["oiiotool", pixmap, "-d", "uint16", "-o", path], check=True)
    pixmap.unlink()


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=pathlib.Path)
    parser.add_argument("--size", type=int, default=384)
    parser.add_argument("--charts", action="store_true")
    arguments = parser.parse_args()
    for name in CHARTS if arguments.charts else SCENES:
        light, dolp, aolp = scene(name, arguments.size)
        folder = arguments.folder / name
        folder.mkdir(parents=True, exist_ok=True)
        for angle in (0, 45, 90, 135):  # Malus: I = (S0 + S1 cos 2a + S2 sin 2a) / 2, doubled as S0 is the light
            share = 1 + dolp * np.cos(2 * (aolp - np.deg2rad(angle)))
            write_png(folder / f"I{angle}.png", light * share[..., None] / 2)


if __name__ == "__main__":
    main()
