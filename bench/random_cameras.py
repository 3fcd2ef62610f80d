#!/usr/bin/env python3
"""Random cameras, lights and scenes: by how much the default is better than other methods, and where it is not.

    PYTHONPATH=build/release/python /usr/bin/python3 bench/random_cameras.py [--cases N] [--first N] [--layouts LAYOUT...] [--methods METHOD[/PROFILE]...] [--scenes SCENE...] [--pictures PICTURE...] [--each] [--errors [--without-model]]

Every case draws a sensor layout, bits, gain, read and row noise of a NumPy camera (Poisson, rows, rounding, clipping), calibrates it from frames of its own, draws a light between a few electrons and full well, a
lens, a scene of 256 pixels with its polarization (the scenes of like_pixels.py and, of --pictures, sRGB made linear) and denoises one frame. A method may be a network's weight file. The table holds the mean of the default's lead, its least and
greatest, and in how many cases the default has the higher image PSNR; --each prints the cases, which their number draws again. With --errors, what the default states of its error instead: the squared error over it
(geometric mean, least and greatest), how often two stated deviations hold the truth [%], the mean image PSNR [dB], and the cases in which they do in less than 85 %; --without-model: the noise is that of the
picture itself.
"""
import argparse
import warnings

import like_pixels
import malus
import numpy as np
from like_pixels import COLS, KINDS, ROWS, SIDE, Scene
from PIL import Image
from scipy.ndimage import gaussian_filter

DEFAULT = "nl-ridge"
LAYOUTS = ["mono", "bayer-rggb", "bayer-gbrg", "polar-mono", "polar-bayer-rggb", "polar-bayer-grbg"]
DRAWN = [kind for kinds in KINDS.values() for kind in kinds]


def log_uniform(random, least, most):
    return float(np.exp(random.uniform(np.log(least), np.log(most))))


class Camera:
    """One gain of a sensor; a frame takes the random words that it is given."""

    def __init__(self, random, layout):
        self.layout = layout
        bits = int(random.choice([8, 10, 12, 14, 16], p=[.1, .15, .5, .15, .1]))
        self.white = 2**bits - 1
        self.gain_dn_per_e = self.white / log_uniform(random, 600, 60000)
        self.read_e = max(log_uniform(random, .8, 20), .45 / self.gain_dn_per_e)  # a converter that shows its noise
        self.row_e = self.read_e * random.choice([0, 0, .1, .5, 1])
        # No noise is cut off at 0.
        lowest = 5 * self.gain_dn_per_e * np.hypot(self.read_e, self.row_e)
        self.black = float(np.ceil(max(lowest, random.choice([.004, .015, .06]) * self.white)))
        self.well_e = .95 * (self.white - self.black) / self.gain_dn_per_e

    def exposed(self, electrons, random):
        noise = random.poisson(electrons) + random.normal(0, self.read_e, electrons.shape) + self.row_e * random.normal(size=(len(electrons), 1))
        return np.clip(np.round(self.black + self.gain_dn_per_e * noise), 0, self.white).astype(np.uint16)

    def calibrated(self, random):
        even = np.ones((SIDE, SIDE))
        sets = [malus.FrameSet("bias", [self.exposed(0 * even, random) for _ in range(16)], gain_db=0)]
        for share in (.02, .06, .2, .45, .8):
            sets.append(malus.FrameSet("flat", [self.exposed(share * self.well_e * even, random) for _ in range(2)], gain_db=0, exposure_s=.01 * share))
        return malus.calibrate(sets, layout=self.layout, black=self.black, white=self.white)

    def __str__(self):
        return f"{self.layout}, white {self.white}, {self.gain_dn_per_e:.3g} DN/e-, read {self.read_e:.2g} and rows {self.row_e:.2g} e-"


def piece_of(path, random):
    picture = np.asarray(Image.open(path).convert("RGB"), float)
    row, col = (random.integers(0, length - SIDE + 1) for length in picture.shape[:2])
    light = (picture[row:row + SIDE, col:col + SIDE] / 255)**2.2
    scene, kind = Scene(.97 * np.moveaxis(light, 2, 0) + .005), random.integers(3)
    if kind == 0:  # waves of it
        scene.dolp += .1 * np.sin(COLS / 37) * np.sin(ROWS / 29)
    elif kind == 1:  # as fine as the picture
        shade = gaussian_filter(scene.light.mean(0), 2)
        scene.dolp, scene.aolp = .05 + .5 * np.abs(np.sin(6 * shade)), 3 * shade % np.pi
    else:  # a film whose angle changes
        scene.dolp[:], scene.aolp = random.uniform(0, .6), .5 + .7 * np.sin(COLS / 51 + ROWS / 43)
    return scene


def behind_lens(scene, blur):
    """The light of all angles is softened, and so are its Stokes parameters."""
    mean = scene.light.mean(0)
    softened = [gaussian_filter(mean * scene.dolp * turn(2 * scene.aolp), blur) / gaussian_filter(mean, blur) for turn in (np.cos, np.sin)]
    scene.light = np.stack([gaussian_filter(plane, blur) for plane in scene.light])
    scene.dolp, scene.aolp = np.hypot(*softened), np.arctan2(*softened[::-1]) / 2
    return scene


class Case:
    """What number, layouts and pictures draw."""

    def __init__(self, number, layouts, pictures, scenes):
        random = np.random.default_rng(number)
        self.camera = Camera(random, str(random.choice(layouts)))
        few = 6 + 2 * self.camera.read_e
        self.light_e = log_uniform(random, min(few, self.camera.well_e / 2), self.camera.well_e)
        blur = random.choice([0, 0, .5, .8, 1.2])
        self.of_picture = bool(pictures) and random.random() < .6
        self.name = str(random.choice(pictures if self.of_picture else scenes))
        scene = piece_of(self.name, random) if self.of_picture else like_pixels.scene_of(self.name, random)
        self.electrons = self.light_e * (behind_lens(scene, blur) if blur else scene).seen_by(self.camera.layout)
        self.noise = np.random.default_rng([number, 1])

    def frame(self):
        camera = self.camera
        return malus.Frame(camera.exposed(self.electrons, self.noise), camera.layout, black=camera.black, white=camera.white, gain_db=0)

    def calibrated_frame(self):
        model = self.camera.calibrated(self.noise)
        return model, self.frame()

    def honesty(self, with_model):
        """Squared error over what is stated of it, how often two stated deviations hold the truth, of pixels below white; and image PSNR."""
        if with_model:
            model, frame = self.calibrated_frame()
            result = malus.denoise(frame, model=model, gain=0, variance=True)
        else:
            result = malus.denoise(self.frame(), variance=True)
        gain = self.camera.gain_dn_per_e
        square, stated = (result["dn"] - gain * self.electrons)**2, result["variance"]
        known = np.isfinite(stated)
        return np.mean(square[known]) / np.mean(stated[known]), np.mean(square[known] < 4 * stated[known]), 10 * np.log10((gain * self.light_e)**2 / np.mean(square[known]))

    def scores(self, methods):
        """Image PSNR, and of polarization DoLP PSNR [dB] and AoLP error [deg], of every method."""
        camera = self.camera
        model, frame = self.calibrated_frame()
        truth, peak_dn = (camera.gain_dn_per_e * self.electrons).astype(np.float32), camera.gain_dn_per_e * self.light_e

        def score(method):
            name, _, profile = (method, "", "") if method.endswith(".safetensors") else method.partition("/")
            result = malus.denoise(frame, model=model, gain=0, method=name, profile=profile or "normal")["dn"]
            if not camera.layout.startswith("polar"):
                return [10 * np.log10(peak_dn**2 / np.mean((result - truth)**2))]
            measured = malus.evaluate(truth, result, camera.layout, peak_dn)
            return [measured["image_psnr"], measured["dolp_psnr"], measured["aolp_circular"]]

        return [np.array(score(method)) for method in methods]

    def __str__(self):
        return f"{self.name}, {self.light_e:.0f} e-, {self.camera}"


def table(leads, methods):
    lines = ["| scenes | " + " | ".join(methods) + " |", "|---|" + "---|" * len(methods)]
    for group, rows in sorted(leads.items()):
        cells = []
        for found in np.moveaxis(np.array(rows), 1, 0):
            figures = ["{:.2f} ({:.2f} to {:.2f})".format(figure.mean(), figure.min(), figure.max()) for figure in found.T]
            cells.append(f"{' / '.join(figures)}; {np.sum(found[:, 0] > 0)} of {len(found)}")
        lines.append(f"| {group} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def print_errors(cases, each, with_model):
    ratios, shares, decibels = [], [], []
    for number, case in cases:
        ratio, share, psnr = case.honesty(with_model)
        ratios.append(ratio)
        shares.append(share)
        decibels.append(psnr)
        if each or share < .85:
            print(f"{number} {case}: {ratio:.2f}, {100 * share:.0f} %, {psnr:.2f} dB", flush=True)
    print(f"{len(ratios)} cases: {np.exp(np.mean(np.log(ratios))):.2f} ({min(ratios):.2f} to {max(ratios):.2f}), {100 * np.mean(shares):.1f} %, {np.mean(decibels):.2f} dB")


def print_leads(cases, methods, each):
    leads = {}
    for number, case in cases:
        default, *others = case.scores([DEFAULT, *methods])
        lead = [(default - other) * [1, 1, -1][:len(default)] for other in others]
        kind = "polarization" if case.camera.layout.startswith("polar") else "others"
        leads.setdefault(f"{kind}, {'pictures' if case.of_picture else 'drawn'}", []).append(lead)
        if each:
            print(f"{number} {case}: " + ", ".join(f"{method} {np.round(one, 2).tolist()}" for method, one in zip(methods, lead)), flush=True)
    count = sum(len(rows) for rows in leads.values())
    print(f"{count} cases: lead of {DEFAULT}, image PSNR and of polarization DoLP PSNR [dB], AoLP [deg]: mean (least to greatest); cases won\n\n{table(leads, methods)}")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", type=int, default=60)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--layouts", nargs="+", default=LAYOUTS)
    parser.add_argument("--methods", nargs="+", default=["plane-bm3d", "bm3d"])
    parser.add_argument("--scenes", nargs="+", default=DRAWN, choices=DRAWN)
    parser.add_argument("--pictures", nargs="+", default=[])
    parser.add_argument("--each", action="store_true")
    parser.add_argument("--errors", action="store_true")
    parser.add_argument("--without-model", action="store_true")
    options = parser.parse_args()
    warnings.simplefilter("ignore")
    numbers = range(options.first, options.first + options.cases)
    cases = ((number, Case(number, options.layouts, options.pictures, options.scenes)) for number in numbers)
    if options.errors:
        print_errors(cases, options.each, not options.without_model)
    else:
        print_leads(cases, options.methods, options.each)


if __name__ == "__main__":
    main()
