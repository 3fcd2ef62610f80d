#!/usr/bin/env python3
"""Crisp, printed, textured and smooth scenes by several methods: the last table of "Pixels that are alike" in docs/denoising-experiments.md.

    PYTHONPATH=build/release/python /usr/bin/python3 bench/like_pixels.py [--layouts LAYOUT...] [--methods METHOD[/PROFILE]...] [--pictures PICTURE...] [--errors]

A NumPy camera (Poisson, 0.4 DN/e-, read noise 2.4 e-, 12 bit), calibrated from its own frames; 256 pixels, 100, 500 and 3000 electrons for white. Prints the image PSNR [dB] per kind
of scene and light; with --errors, squared error over what is stated of it (geometric mean) and how often two stated deviations hold the truth [%], of the first two lights. The letters are DejaVu Sans, of Debian's package fonts-dejavu-core.
"""
import argparse
import warnings

import malus
import numpy as np
from PIL import Image, ImageDraw, ImageFont

SIDE, LIGHTS, BLACK, WHITE = 256, (100, 500, 3000), 64, 4095
GAIN_DN_PER_E, READ_E = 0.4, 2.4
FONT = "/usr/share/fonts/truetype/dejavu/DejaVuSans.ttf"
LETTERS = "abcdefghijklmnopqrstuvwxyz     ABCDEFGH0123456789.,"
ROWS, COLS = np.mgrid[0:SIDE, 0:SIDE].astype(float)
ANGLES_DEG = np.array([[90, 45], [135, 0]])
COLOURS = np.array([[0, 1], [1, 2]])
KINDS = {"crisp": ("rectangles", "polygons", "cubes", "shaded discs", "star", "board"),
         "print": ("page", "soft page", "faint page", "shaded page", "marked page"), "weave": ("weave",), "stripes": ("stripes",), "grain": ("grain",),
         "waves": ("waves",), "even, ramp": ("even", "ramp")}


def any_surface(random):
    return random.uniform(.05, .95) * random.uniform(.6, 1, 3), random.uniform(0, .6), random.uniform(0, np.pi)


class Scene:
    """Light of three colours, 1 for white, its degree and angle of polarization."""

    def __init__(self, light, dolp=.2, aolp=.5):
        self.light = np.broadcast_to(light, (3, SIDE, SIDE)).copy()
        self.dolp, self.aolp = np.full((SIDE, SIDE), dolp), np.full((SIDE, SIDE), aolp)

    def put(self, mask, surface, shade=1.0):
        colour, dolp, aolp = surface
        for plane, value in zip(self.light, colour):
            plane[mask] = (value * np.broadcast_to(shade, mask.shape))[mask]
        self.dolp[mask], self.aolp[mask] = dolp, aolp
        return self

    def seen_by(self, layout):
        r, c = ROWS.astype(int), COLS.astype(int)
        cell = 2 if layout.startswith("polar") else 1
        light = self.light.mean(0) if layout.endswith("mono") else np.take_along_axis(self.light, COLOURS[r // cell % 2, c // cell % 2][None], 0)[0]
        if cell == 1:
            return light
        angle = np.deg2rad(ANGLES_DEG[r % 2, c % 2])
        return light / 2 * (1 + self.dolp * np.cos(2 * angle - 2 * self.aolp))


def crisp(kind, random):
    scene = Scene(.3).put(np.ones((SIDE, SIDE), bool), any_surface(random))
    if kind == "rectangles":
        for _ in range(40):
            (height, width), (r, c) = random.integers(8, 90, 2), random.integers(-20, SIDE - 10, 2)
            scene.put((ROWS >= r) & (ROWS < r + height) & (COLS >= c) & (COLS < c + width), any_surface(random))
    elif kind == "polygons":
        for _ in range(30):
            turn, (x, y), size, inside = random.uniform(0, 2 * np.pi), random.uniform(0, SIDE, 2), random.uniform(10, 60), np.ones((SIDE, SIDE), bool)
            for k in range(random.integers(3, 6)):
                a = turn + 2 * np.pi * k / 5 + random.uniform(-.3, .3)
                inside &= (COLS - x) * np.cos(a) + (ROWS - y) * np.sin(a) < size
            scene.put(inside, any_surface(random))
    elif kind == "cubes":
        for i, k in np.ndindex(SIDE // 48 + 1, SIDE // 48 + 1):
            x, y = 48 * k + 24 * (i % 2) + random.uniform(-3, 3), 44 * i + random.uniform(-3, 3)
            for face in range(3):
                a, b = np.deg2rad(30 + 120 * face), np.deg2rad(150 + 120 * face)
                u, v = np.linalg.solve([[np.cos(a), np.cos(b)], [np.sin(a), np.sin(b)]], np.stack([COLS - x, ROWS - y]).reshape(2, -1)).reshape(2, SIDE, SIDE)
                scene.put((u >= 0) & (v >= 0) & (u < 22) & (v < 22), any_surface(random))
    elif kind == "shaded discs":
        for _ in range(30):
            (x, y), size, (colour, dolp, _) = random.uniform(0, SIDE, 2), random.uniform(10, 50), any_surface(random)
            squared = ((COLS - x)**2 + (ROWS - y)**2) / size**2
            height, disc = np.sqrt(np.maximum(1 - squared, 0)), squared < 1
            scene.put(disc, (colour, (dolp * (1 - height) + .02)[disc], (np.arctan2(ROWS - y, COLS - x) % np.pi)[disc]), .3 + .7 * height)
    elif kind == "star":
        scene.put(ROWS >= 0, (np.full(3, .1), .05, 0)).put(np.sin(20 * np.arctan2(ROWS - SIDE / 2, COLS - SIDE / 2)) > 0, (np.full(3, .8), .3, .6))
    else:
        scene.put(ROWS >= 0, (np.full(3, .15), .05, .3)).put((ROWS // 16 + COLS // 16) % 2 > 0, (np.array([.8, .7, .6]), .2, 1.2))
    return scene


def page(random, size, ink=.1, paper=.85, soft=False):
    picture = Image.new("L" if soft else "1", (SIDE, SIDE), 255 if soft else 1)
    draw, font = ImageDraw.Draw(picture), ImageFont.truetype(FONT, size)
    for y in range(2, SIDE, int(1.25 * size)):
        draw.text((3, y), "".join(random.choice(list(LETTERS), 80)), fill=0, font=font)
    return ink + (paper - ink) * np.asarray(picture.convert("L"), float) / 255


def grey(kind, random):
    if kind.endswith("page"):
        light = page(random, *{"faint page": (14, .6), "soft page": (13,)}.get(kind, (12,)), soft=kind == "soft page")
        if kind == "shaded page":
            light = light * (.3 + .7 * (COLS + ROWS) / (2 * SIDE))
        if kind == "marked page":
            for x, y in random.uniform(0, SIDE, (10, 2)):
                light = light * (1 - .04 * ((COLS - x)**2 + (ROWS - y)**2 < 144))
        return light
    return {"even": lambda: .4 + 0 * ROWS, "ramp": lambda: .05 + .9 * (COLS + ROWS) / (2 * SIDE), "grain": lambda: .5 + .03 * random.normal(size=ROWS.shape),
            "waves": lambda: .5 + .4 * np.sin(COLS / 9 + np.sin(ROWS / 31)) * np.cos(ROWS / 11),
            "stripes": lambda: .2 + .6 * (np.sin((.96 * COLS + .28 * ROWS) * 2 * np.pi / 9) > 0),
            "weave": lambda: .3 + .4 * ((COLS // 3 + ROWS // 3) % 2) * (.6 + .4 * np.sin(COLS / 4.5) * np.sin(ROWS / 4.5))}[kind]()


def scene_of(kind, random):
    if kind in KINDS["crisp"]:
        return crisp(kind, random)
    scene = Scene(np.array([.9, 1, .8])[:, None, None] * grey(kind, random))
    if kind not in ("stripes", "weave"):
        scene.dolp += .1 * np.sin(COLS / 37) * np.sin(ROWS / 29)
        scene.aolp = (.5 + .7 * np.sin(COLS / 51 + ROWS / 43)) % np.pi
    return scene


def picture_scene(path):
    light = (np.asarray(Image.open(path).convert("RGB"), float)[20:20 + SIDE, 30:30 + SIDE] / 255)**2.2
    scene = Scene(.95 * np.moveaxis(light, 2, 0) + .01)
    scene.dolp += .1 * np.sin(COLS / 37) * np.sin(ROWS / 29)
    return scene


def exposed(electrons, random):
    return np.round(BLACK + GAIN_DN_PER_E * (random.poisson(electrons) + random.normal(0, READ_E, electrons.shape))).astype(np.uint16)


def calibrated(layout, random):
    even = np.ones((SIDE, SIDE))
    sets = [malus.FrameSet("bias", [exposed(0 * even, random) for _ in range(16)], gain_db=0)]
    for electrons in (50, 300, 1000, 2500, 6000):
        sets.append(malus.FrameSet("flat", [exposed(electrons * even, random) for _ in range(2)], gain_db=0, exposure_s=1e-5 * electrons))
    return malus.calibrate(sets, layout=layout, black=BLACK, white=WHITE)


def denoised(scene, layout, light, model, method, variance=False):
    """The error of every pixel and what is stated of its square, DN."""
    electrons = light * scene.seen_by(layout)
    frame = malus.Frame(exposed(electrons, np.random.default_rng(99)), layout, black=BLACK, white=WHITE, gain_db=0)
    name, _, profile = method.partition("/")
    result = malus.denoise(frame, model=model, gain=0, method=name, profile=profile or "normal", variance=variance)
    return result["dn"] - GAIN_DN_PER_E * electrons, result["variance"] if variance else None


def psnr_of(scenes, layout, model, method):
    def psnr_db(scene, light):
        error, _ = denoised(scene, layout, light, model, method)
        return 10 * np.log10((GAIN_DN_PER_E * light)**2 / np.mean(error**2))

    return ", ".join(f"{np.mean([psnr_db(scene, light) for scene in scenes]):.2f}" for light in LIGHTS)


def honesty_of(scenes, layout, model, method):
    pairs = [denoised(scene, layout, light, model, method, variance=True) for scene in scenes for light in LIGHTS[:2]]
    ratio = np.exp(np.mean([np.log(np.mean(error**2) / np.mean(stated)) for error, stated in pairs]))
    held = np.mean([np.mean(error**2 < 4 * stated) for error, stated in pairs])
    return f"{ratio:.2f}, {100 * held:.1f}"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--layouts", nargs="+", default=["mono", "bayer-rggb", "polar-mono", "polar-bayer-rggb"])
    parser.add_argument("--methods", nargs="+", default=["nl-ridge", "nl-ridge/fast", "bm3d"])
    parser.add_argument("--pictures", nargs="+", default=[])
    parser.add_argument("--errors", action="store_true")
    options = parser.parse_args()
    warnings.simplefilter("ignore")
    groups = {group: [scene_of(kind, np.random.default_rng(7)) for kind in kinds] for group, kinds in KINDS.items()}
    if options.pictures:
        groups["pictures"] = [picture_scene(path) for path in options.pictures]
    for layout in options.layouts:
        model = calibrated(layout, np.random.default_rng(1))
        print(f"{layout}, at {', '.join(map(str, LIGHTS))} electrons\n\n| scene | " + " | ".join(options.methods) + " |\n|---|" + "---|" * len(options.methods))
        for group, scenes in groups.items():
            measured = honesty_of if options.errors else psnr_of
            print(f"| {group} | " + " | ".join(measured(scenes, layout, model, method) for method in options.methods) + " |", flush=True)
        print()


if __name__ == "__main__":
    main()
