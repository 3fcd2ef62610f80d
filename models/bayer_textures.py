#!/usr/bin/env python3
"""The drawn textures among the training pictures of models/bayer.toml: 110 of fine regular texture, 512x512 pixels.

    /usr/bin/python3 models/bayer_textures.py PICTURES

Waves, bars, triangles and cusps of 3.5 to 20 pixels, alone or crossed, slightly bent, in one to four regions of a picture, of
one colour or three, under slow shading. Writes PICTURES/t_000.png to t_109.png (8 bits, sRGB).
"""
import pathlib
import sys

import numpy as np
from PIL import Image

PICTURES, SIDE = 110, 512


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
    light = np.clip(light * (1 + 0.4 * slow(300, 1500))[..., None], 0.003, 1)
    return np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)


def main(folder):
    folder.mkdir(parents=True, exist_ok=True)
    random = np.random.default_rng(24)
    for number in range(PICTURES):
        Image.fromarray(np.round(255 * picture(random)).astype(np.uint8)).save(folder / f"t_{number:03d}.png")


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    main(pathlib.Path(sys.argv[1]))
