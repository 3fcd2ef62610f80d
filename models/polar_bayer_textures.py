#!/usr/bin/env python3
"""The drawn scenes among the training data of models/polar-bayer.toml: 60 of fine regular texture, 12 of points in
the dark, 24 of smooth light, 36 of print.

    /usr/bin/python3 models/polar_bayer_textures.py SCENES

Textures are those of bayer_textures.py, down to bars and boards of two pixels: of the light, of DoLP, of AoLP or of all three.
Writes SCENES/t_00/I0.png, I45.png, I90.png, I135.png and so on (16 bits, 512x512 pixels).
"""
import pathlib
import subprocess
import sys

import numpy as np

from bayer_textures import texture
from print_ink import SIDE, any_ink, on_paper, strokes

TEXTURES, POINTS, SMOOTH, PRINTS = 60, 12, 24, 36
Y, X = np.mgrid[0:SIDE, 0:SIDE].astype(float)


def slow(random, low, high):
    return np.sin(2 * np.pi * (X * random.uniform(-1, 1) + Y * random.uniform(-1, 1)) / random.uniform(low, high) + random.uniform(0, 6))


def board(random):
    """Bars or squares of whole pixels, which no sampling softens: -1 and 1."""
    high, wide = random.integers(2, 9, 2)
    style = random.integers(3)
    rows, cols = (Y // high) % 2, (X // wide) % 2
    return 2 * [rows, cols, (rows + cols) % 2][style] - 1


def regions(random):
    count = random.integers(1, 4)
    at_x, at_y = random.uniform(0, SIDE, count), random.uniform(0, SIDE, count)
    return np.argmin((X[..., None] - at_x) ** 2 + (Y[..., None] - at_y) ** 2, axis=-1), count


def textured(random):
    """Light per colour, DoLP and AoLP."""
    base = random.uniform(0.08, 0.75, 3)
    if random.random() < 0.5:
        base[:] = base.mean()
    light = np.zeros((SIDE, SIDE, 3)) + base
    dolp = random.choice([0.03, 0.15, 0.4]) * (1 + 0.8 * slow(random, 200, 900))
    aolp = random.uniform(0, np.pi) + 0.7 * slow(random, 200, 900)
    nearest, count = regions(random)
    bend = random.uniform(0, 2) * slow(random, 150, 600)
    for region in range(count):
        drawn = board(random) if random.random() < 0.4 else texture(X + bend, Y + bend, random)
        drawn = drawn * (nearest == region)
        what = random.integers(5)
        if what != 3:
            colour = random.uniform(0.2, 1, 3) if random.random() < 0.5 else np.ones(3)
            light += drawn[..., None] * np.exp(random.uniform(np.log(0.06), np.log(0.8))) * colour * base
        if what >= 2:
            dolp = np.where(nearest == region, random.uniform(0.1, 0.4) * (1 + random.uniform(0.2, 1) * drawn), dolp)
        if what >= 3:
            aolp = aolp + random.uniform(0.1, 1.2) * drawn
    return light * (1 + 0.3 * slow(random, 300, 1500))[..., None], dolp, aolp


def points(random):
    """Spots of one pixel to a few, each of one colour and polarization, on dark even light."""
    light = np.zeros((SIDE, SIDE, 3)) + random.uniform(0.005, 0.05, 3)
    s1, s2 = np.zeros_like(light), np.zeros_like(light)
    for _ in range(random.integers(200, 1500)):
        row, col, width = *random.uniform(8, SIDE - 8, 2), np.exp(random.uniform(np.log(0.4), np.log(3)))
        at = np.s_[int(row) - 8:int(row) + 9, int(col) - 8:int(col) + 9]
        spot = np.exp(-((Y[at] - row) ** 2 + (X[at] - col) ** 2) / (2 * width**2))[..., None]
        spot = spot * np.exp(random.uniform(np.log(0.01), 0)) * random.uniform(0.4, 1, 3)
        dolp, aolp = random.uniform(0, 0.8), random.uniform(0, np.pi)
        light[at] += spot
        s1[at] += spot * dolp * np.cos(2 * aolp)
        s2[at] += spot * dolp * np.sin(2 * aolp)
    return light, np.hypot(s1, s2) / light, np.arctan2(s2, s1) / 2


def smooth(random):
    """Even light, slow ramps and hills."""
    def field(low, high):
        return np.clip((low + high) / 2 + (high - low) / 2 * slow(random, *random.choice([(150, 500), (500, 2500), (9000, 20000)])), low, high)

    light = np.stack([field(0.02, 0.9) for _ in range(3)], -1) if random.random() < 0.4 else field(0.05, 0.9)[..., None] * random.uniform(0.3, 1, 3)
    return light, field(0.01, random.choice([0.1, 0.5, 0.9])), random.uniform(0, np.pi) + field(-1.5, 1.5)


def printed(random):
    """Ink on paper, each with its own light and polarization; on every other one faint marks besides: a stain, a scratch."""
    ink = any_ink(random)
    light = on_paper(ink, random)
    dolp_paper, dolp_ink = random.uniform(0, 0.3), random.uniform(0, 0.7)
    turn = random.uniform(0, np.pi)
    dolp = dolp_paper + (dolp_ink - dolp_paper) * ink
    aolp = turn + random.uniform(-1.5, 1.5) * ink
    if random.random() < 0.5:
        row, col, radius = random.uniform(0, SIDE), random.uniform(0, SIDE), random.uniform(10, 120)
        stain = np.clip((1 - np.hypot(Y - row, X - col) / radius) * random.uniform(1, 8), 0, 1)
        marks = np.maximum(stain, strokes(random, random.integers(1, 8), random.integers(1, 3)))
        light = light * (1 + random.uniform(-0.2, 0.1) * marks[..., None])
        dolp = dolp * (1 + random.uniform(-0.5, 0.5) * marks)
    return light * (1 + random.choice([0, 0.2]) * slow(random, 300, 1500))[..., None], dolp, aolp


def write(folder, light, dolp, aolp):
    folder.mkdir(parents=True, exist_ok=True)
    light = np.clip(light, 0.003, 1)
    dolp, aolp = (x if x.ndim == 3 else x[..., None] for x in (np.clip(dolp, 0, 0.95), aolp))
    for angle in (0, 45, 90, 135):
        picture = light * (1 + dolp * np.cos(2 * aolp - np.radians(2 * angle))) / 2
        pixmap = folder / "picture.pfm"  # rows from the bottom up, little-endian
        pixmap.write_bytes(b"PF\n%d %d\n-1\n" % (SIDE, SIDE) + picture[::-1].astype("<f4").tobytes())
        subprocess.run(["oiiotool", pixmap, "-d", "uint16", "-o", folder / f"I{angle}.png"], check=True)
        pixmap.unlink()


def main(scenes):
    random = np.random.default_rng(24)
    for number in range(TEXTURES):
        write(scenes / f"t_{number:02d}", *textured(random))
    for number in range(POINTS):
        write(scenes / f"p_{number:02d}", *points(random))
    random = np.random.default_rng(25)
    for number in range(SMOOTH):
        write(scenes / f"s_{number:02d}", *smooth(random))
    random = np.random.default_rng(26)
    for number in range(PRINTS):
        write(scenes / f"q_{number:02d}", *printed(random))


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    main(pathlib.Path(sys.argv[1]))
