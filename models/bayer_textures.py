#!/usr/bin/env python3
"""The drawn ones among the training pictures of models/bayer.toml: 110 of fine regular texture, 60 of print, 60 of smooth light,
512x512 pixels.

    /usr/bin/python3 models/bayer_textures.py PICTURES

Waves, bars, triangles and cusps of 3.5 to 20 pixels, alone or crossed, slightly bent, in one to four regions of a picture, of
one colour or three, under slow shading. Print: codes, letters, strokes, bars of whole pixels; ink and paper of one colour or
three. Smooth: slow ramps and hills. Writes PICTURES/t_000.png to t_109.png, q_00.png to q_59.png and s_00.png to s_59.png (8 bits,
sRGB).
"""
import pathlib
import sys

import numpy as np
from PIL import Image

from print_ink import SIDE, any_ink, on_paper

PICTURES, PRINTS, SMOOTH = 110, 60, 60


def wave(phase, kind):
    """Of period 1, between -1 and 1."""
    sine = np.sin(2 * np.pi * phase)
    return [sine, np.clip(4 * sine, -1, 1), 2 * np.abs(((phase % 1) - 0.5) * 2) - 1, 2 * np.abs(sine) ** 0.5 - 1][kind]


def texture(x, y, random):
    period, angle = np.exp(random.uniform(np.log(3.5), np.log(20))), random.uniform(0, np.pi)
    along = wave((x * np.cos(angle) + y * np.sin(angle)) / period + random.random(), random.integers(4))
    style = random.integers(4)
    if style == 0:
        return along
    period *= np.exp(random.uniform(-0.4, 0.4))
    angle += np.pi / 2 + (random.normal() * 0.2 if style == 3 else 0)
    across = wave((x * np.cos(angle) + y * np.sin(angle)) / period + random.random(), random.integers(4))
    return [None, (along + across) / 2, along * across, np.maximum(along, across)][style]


def picture(random):
    y, x = np.mgrid[0:SIDE, 0:SIDE].astype(float)

    def slow(low, high):
        return np.sin(2 * np.pi * (x * random.uniform(-1, 1) + y * random.uniform(-1, 1)) / random.uniform(low, high))

    base = random.uniform(0.08, 0.75, 3)
    if random.random() < 0.5:
        base[:] = base.mean()
    light = np.zeros((SIDE, SIDE, 3)) + base
    regions = random.integers(1, 5)
    at_x, at_y = random.uniform(0, SIDE, regions), random.uniform(0, SIDE, regions)
    nearest = np.argmin((x[..., None] - at_x) ** 2 + (y[..., None] - at_y) ** 2, axis=-1)
    bend = random.uniform(0, 3) * slow(150, 600)
    for region in range(regions):
        drawn = texture(x + bend, y + bend, random)
        colour = random.uniform(0.2, 1, 3) if random.random() < 0.5 else np.ones(3)
        contrast = np.exp(random.uniform(np.log(0.04), np.log(0.5)))
        light += ((nearest == region) * drawn)[..., None] * contrast * colour * base
    return srgb(light * (1 + 0.4 * slow(300, 1500))[..., None])


def srgb(light):
    light = np.clip(light, 0.003, 1)
    return np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)


def printed(random):
    ink = any_ink(random)
    if random.random() < 0.25:
        wide, rows = random.integers(1, 9), np.mgrid[0:SIDE, 0:SIDE][random.integers(2)]
        ink = (rows // wide % 2).astype(float)
    return srgb(on_paper(ink, random))


def smooth(random):
    y, x = np.mgrid[0:SIDE, 0:SIDE].astype(float)
    light = np.zeros((SIDE, SIDE, 3)) + random.uniform(0.02, 0.9, 3)
    for _ in range(random.integers(1, 5)):
        period = np.exp(random.uniform(np.log(60), np.log(4000)))
        wave_of = np.sin(2 * np.pi * (x * random.uniform(-1, 1) + y * random.uniform(-1, 1)) / period + random.uniform(0, 6))
        light *= 1 + random.uniform(0, 0.5) * wave_of[..., None] * random.uniform(0.3, 1, 3)
    return srgb(np.minimum(light, 1))


def save(path, shown):
    Image.fromarray(np.round(255 * shown).astype(np.uint8)).save(path)


def main(folder):
    folder.mkdir(parents=True, exist_ok=True)
    random = np.random.default_rng(24)
    for number in range(PICTURES):
        save(folder / f"t_{number:03d}.png", picture(random))
    random = np.random.default_rng(26)
    for number in range(PRINTS):
        save(folder / f"q_{number:02d}.png", printed(random))
    random = np.random.default_rng(27)
    for number in range(SMOOTH):
        save(folder / f"s_{number:02d}.png", smooth(random))


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    main(pathlib.Path(sys.argv[1]))
