#!/usr/bin/env python3
"""Polarized scenes drawn from formulas, without noise or 8-bit steps of their own, for `malus experiment denoise`.

    /usr/bin/python3 bench/drawn_scenes.py FOLDER [--size 384] [--charts] [--patterns]

Writes FOLDER/NAME/I0.png, I45.png, I90.png, I135.png (16 bits, RGB) for every NAME of SCENES; with --charts of CHARTS:
checkerboards of light and, in even light, of polarization, by the size of their squares in pixels; with --patterns of
PATTERNS: weaves by their period, one word over and over, a page of letters, checkerboards of AoLP alone, bars, slanted and fine, codes of
squares by chance by the size of these in pixels, lines of one pixel.
"""
import argparse
import pathlib
import struct
import zlib

import numpy as np


GLYPHS = {  # 5 x 7, rows from the top
    "A": "0e11111f111111", "E": "1f10101e10101f", "K": "11121418141211", "L": "1010101010101f", "M": "111b1515111111",
    "N": "11191513111111", "O": "0e11111111110e", "S": "0f10100e01011e", "T": "1f040404040404", "U": "1111111111110e"}


def text(lines, pixels):
    """Ink (rows, cols) of lines of letters, `pixels` pixels per dot, one dot between letters, three between lines."""
    dots = np.zeros((10 * len(lines), 6 * max(map(len, lines))))
    for i, line in enumerate(lines):
        for k, letter in enumerate(line):
            if letter != " ":
                rows = bytes.fromhex(GLYPHS[letter])
                dots[10 * i:10 * i + 7, 6 * k:6 * k + 5] = [[row >> bit & 1 for bit in (4, 3, 2, 1, 0)] for row in rows]
    return dots.repeat(pixels, 0).repeat(pixels, 1)


def pattern(name, size):
    y, x = np.mgrid[0:size, 0:size].astype(float)
    colour = lambda light, rgb: light[..., None] * np.array(rgb)
    even = np.ones_like(x)
    if name.startswith("weave"):  # threads over and under each other, each direction with its own polarization
        period = float(name.rpartition("_")[2])
        warp, weft = np.cos(np.pi * x / period) ** 2, np.cos(np.pi * y / period) ** 2
        over = 0.5 + 0.5 * np.sin(np.pi * x / period) * np.sin(np.pi * y / period)
        light = 0.1 + 0.8 * (over * warp + (1 - over) * weft)
        return colour(light, (0.9, 1.0, 0.7)), 0.1 + 0.3 * over, 0.3 + 0.8 * over
    if name.startswith("aolboard"):
        side = int(name.rpartition("_")[2])
        bright = (y // side + x // side) % 2 == 0
        return colour(0.45 * even, (0.9, 1.0, 0.8)), 0.3 * even, np.where(bright, 0.3, 1.5)
    if name == "bars":  # 11 pixels wide, slanted by one in eight
        light = np.where((x + y // 8) // 11 % 2 == 0, 0.7, 0.15)
        return colour(light, (0.9, 1.0, 0.8)), np.where(light > 0.5, 0.1, 0.4), 0.5 * even
    if name == "bars_2":  # two pixels wide
        light = np.where(x // 2 % 2 == 0, 0.7, 0.15)
        return colour(light, (0.9, 1.0, 0.8)), np.where(light > 0.5, 0.1, 0.4), 0.5 * even
    random = np.random.default_rng(11)
    if name.startswith("code"):  # as QR codes
        side = int(name.rpartition("_")[2])
        ink = random.integers(0, 2, (size // side + 1,) * 2).repeat(side, 0).repeat(side, 1)[:size, :size]
        return colour(0.8 - 0.7 * ink, (0.95, 1.0, 0.85)), 0.1 + 0.3 * ink, 0.4 + 0.5 * ink
    if name == "lines":
        ink = np.zeros_like(x)
        for x0, y0, x1, y1 in random.uniform(0, size, (size // 10, 4)):
            steps = np.linspace(0, 1, 2 * size)
            ink[(y0 + (y1 - y0) * steps).astype(int), (x0 + (x1 - x0) * steps).astype(int)] = 1
        return colour(0.8 - 0.7 * ink, (0.95, 1.0, 0.85)), 0.1 + 0.3 * ink, 0.4 + 0.5 * ink
    across, down = size // 12 + 1, size // 20 + 1
    lines = ["MALUS " * (across // 6 + 1)] * down
    if name == "page":
        lines = ["".join(random.choice(list("AEKLMNOSTU   "), across)) for _ in range(down)]
    ink = text(lines, 2)[:size, :size]
    return colour(0.8 - 0.7 * ink, (0.95, 1.0, 0.85)), 0.1 + 0.3 * ink, 0.4 + 0.5 * ink


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
    if name in PATTERNS:
        return pattern(name, size)
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
PATTERNS = ("weave_9", "weave_17", "word", "page", "aolboard_16", "bars", "bars_2", "code_3", "code_5", "lines")


def write_png(path, picture):
    """picture: (rows, cols, 3) in 0..1, written with 16 bits, which Pillow cannot (PNG specification, 5 and 11)."""
    rows, cols, _ = picture.shape
    values = np.rint(65535 * np.clip(picture, 0, 1)).astype(">u2").reshape(rows, -1)
    chunk = lambda name, data: struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">IIBBBBB", cols, rows, 16, 2, 0, 0, 0))
                     + chunk(b"IDAT", zlib.compress(b"".join(b"\0" + row.tobytes() for row in values), 3)) + chunk(b"IEND", b""))


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=pathlib.Path)
    parser.add_argument("--size", type=int, default=384)
    parser.add_argument("--charts", action="store_true")
    parser.add_argument("--patterns", action="store_true")
    arguments = parser.parse_args()
    names = CHARTS * arguments.charts + PATTERNS * arguments.patterns
    for name in names or SCENES:
        light, dolp, aolp = scene(name, arguments.size)
        folder = arguments.folder / name
        folder.mkdir(parents=True, exist_ok=True)
        for angle in (0, 45, 90, 135):  # Malus: I = (S0 + S1 cos 2a + S2 sin 2a) / 2, doubled as S0 is the light
            share = 1 + dolp * np.cos(2 * (aolp - np.deg2rad(angle)))
            write_png(folder / f"I{angle}.png", light * share[..., None] / 2)


if __name__ == "__main__":
    main()
