#!/usr/bin/env python3
"""Cameras and sessions that are not what calibration takes them for: the table of docs/calibration.md, "Sessions with a fault".

    /usr/bin/python3 bench/session_faults.py [--program build/release/malus] [--seeds N] [--details] [FAULT ...]

A NumPy camera: 12 bits, 0.4 DN/e-, 2.5 e- of read noise, rows, 0.4 DN of DSNU, 1 % of PRNU, light that falls to the corners; 20 bias
frames and 8 levels of 4 flats. Each fault changes its light, its frames or its session file. Prints, per fault and as medians over the
seeds: K and PRNU over the truth (of the camera as its files show it), K's error in standard errors, the temporal dark noise over the
truth, the exit code, and how many sessions had a warning or an error. --details prints these, too.
"""
import argparse
import io
import json
import pathlib
import subprocess
import tempfile

import numpy as np
from PIL import Image

SIDE, K, READ, ROW, DSNU, PRNU, BLACK, WHITE = 192, 0.4, 2.5, 0.2, 0.4, 0.01, 64, 4095
LEVELS, FLATS, BIASES = (0.01, 0.03, 0.06, 0.12, 0.22, 0.35, 0.5, 0.64), 4, 20
ROWS, COLS = np.mgrid[:SIDE, :SIDE] / (SIDE - 1.0) * 2 - 1
COLOUR = np.tile([[0.55, 1], [1, 0.7]], (SIDE // 2, SIDE // 2))


class Camera:
    """light(electrons, shot) and recorded(dn, shot) are what faults replace; shot tells kind, level, number and rng."""

    name, layout, black, white, scale, falloff, k_truth = "none", "mono", BLACK, WHITE, 1.0, 0.1, 1.0
    count = {"bias": BIASES, "flat": FLATS}
    exposure_s = staticmethod(lambda share: share / 10)
    colour = None
    k, read, row, dsnu, prnu, tails, crop = K, READ, ROW, DSNU, PRNU, None, SIDE

    def __init__(self, seed):
        self.rng = np.random.default_rng(seed)
        self.offset = self.dsnu * self.rng.standard_normal((SIDE, SIDE))
        self.response = 1 + self.prnu * self.rng.standard_normal((SIDE, SIDE))
        self.shade = 1 - self.falloff * (ROWS**2 + COLS**2) / 2
        self.state = {}

    def light(self, electrons, shot):
        return electrons

    def analog(self, electrons, shot):
        rows = self.row * self.rng.standard_normal((SIDE, 1))
        noise = self.rng.standard_t(self.tails, (SIDE, SIDE)) if self.tails else self.rng.standard_normal((SIDE, SIDE))
        return BLACK + self.k * (electrons + self.read * noise) + rows + self.offset

    def recorded(self, dn, shot):
        return self.coded(dn)

    def coded(self, dn):
        return np.clip(np.round(dn), 0, WHITE)

    def frame(self, kind, share, number):
        shot = {"kind": kind, "share": share, "number": number}
        electrons = share * (WHITE - BLACK) / self.k * self.shade * self.response * (1 if self.colour is None else self.colour)
        electrons = self.rng.poisson(np.maximum(self.light(electrons, shot), 0)).astype(float)
        return self.recorded(self.analog(electrons, shot), shot)

    def sensor(self):
        return f'layout = "{self.layout}"\nblack = {self.black}\nwhite = {self.white}\n'

    def save(self, path, dn):
        np.save(path, dn.astype(np.uint16)[:self.crop, :self.crop])

    def session(self, folder):
        text = "[sensor]\n" + self.sensor()
        for level, share in enumerate((0,) + LEVELS):
            kind = "flat" if share else "bias"
            names = [f"{level}_{i}.npy" for i in range(self.count[kind])]
            for i, name in enumerate(names):
                self.save(folder / name, self.frame(kind, share, i))
            text += f'[[frames]]\nkind = "{kind}"\ngain_db = 0\nexposure_s = {self.exposure_s(share) if share else 1e-5:.6g}\n'
            text += (f"level = {level}\n" if share else "") + f"paths = {names}\n".replace("'", '"')
        (folder / "session.toml").write_text(text)


FAULTS = {"none": Camera}
TWO_FLATS = {"bias": 10, "flat": 2}


def bent(self, dn, shot):
    """Full range is 3 % short of a straight line."""
    return self.coded(dn - 0.03 * (dn - BLACK) ** 2 / (WHITE - BLACK))


def with_hot_pixels(self, electrons, shot):
    """A thousandth of the pixels with 20 to 2000 e- of dark signal, another with telegraph noise."""
    if "hot" not in self.state:
        self.state["hot"] = np.where(self.rng.random((SIDE, SIDE)) < 1e-3, 10 ** self.rng.uniform(1.3, 3.3, (SIDE, SIDE)), 0)
        self.state["telegraph"] = np.where(self.rng.random((SIDE, SIDE)) < 1e-3, 30, 0)
        self.state["up"] = self.rng.random((SIDE, SIDE)) < 0.5
    self.state["up"] ^= self.rng.random((SIDE, SIDE)) < 0.2
    return electrons + self.state["hot"] + self.state["telegraph"] * self.state["up"]


def variant(fault_name, base=Camera, **changes):
    FAULTS[fault_name] = type("Variant", (base,), changes)


def in_16_bits(bits, write):
    """Codes of that many bits, written into 16 by `write`."""

    def coded(self, dn):
        return write(np.clip(np.round(dn / 2 ** (12 - bits)), 0, 2**bits - 1).astype(np.int64))

    black, white = (int(write(np.array([v // 2 ** (12 - bits)]))[0]) for v in (BLACK, WHITE))
    return {"coded": coded, "black": black, "white": white, "k_truth": white / (2**bits - 1) / 2 ** (12 - bits)}


GREY = np.kron(np.tile([[0.55, 1], [1, 0.7]], (SIDE // 4, SIDE // 4)), np.ones((2, 2)))
variant("ordinary: Bayer", layout="bayer-rggb", colour=COLOUR)
variant("ordinary: polar-Bayer", layout="polar-bayer-rggb", colour=GREY)
variant("ordinary: polar-mono", layout="polar-mono")
variant("ordinary: mono, 64x64, 2 flats, 10 bias frames", crop=64, count=TWO_FLATS)
variant("ordinary: polar-Bayer, 64x64, 2 flats, 10 bias frames", crop=64, count=TWO_FLATS, layout="polar-bayer-rggb", colour=GREY)
variant("ordinary: 24 dB", k=6.3, read=2.3, row=2.0)
variant("ordinary: 24 dB, Bayer, 64x64, 2 flats", k=6.3, read=2.3, row=2.0, crop=64, count=TWO_FLATS, layout="bayer-rggb", colour=COLOUR)
variant("ordinary: heavy tails (Student's t, 4), rows as strong", tails=4, row=1.5)
variant("ordinary: hot and telegraph pixels", light=with_hot_pixels)
variant("ordinary: response bent by 3 %, shading of 50 %", recorded=bent, falloff=0.5)
variant("ordinary: response bent by 3 %, shading of 10 %", recorded=bent)
variant("ordinary: lamp flickers by 1.5 %", light=lambda self, e, shot: e * (1 + 0.015 * self.rng.standard_normal()))
variant("ordinary: lamp flickers by 3 %", light=lambda self, e, shot: e * (1 + 0.03 * self.rng.standard_normal()))
variant("ordinary: lamp flickers by 3 %, 10 flats", light=lambda self, e, shot: e * (1 + 0.03 * self.rng.standard_normal()), count={"bias": BIASES, "flat": 10})
variant("ordinary: lamp flickers by 3 %, polar-Bayer, shading of 50 %", light=lambda self, e, shot: e * (1 + 0.03 * self.rng.standard_normal()), layout="polar-bayer-rggb", colour=GREY, falloff=0.5)
variant("ordinary: lamp flickers by 3 %, response bent by 3 %", light=lambda self, e, shot: e * (1 + 0.03 * self.rng.standard_normal()), recorded=bent)
variant("ordinary: lamp drifts by 1 % a frame, 10 flats", light=lambda self, e, shot: e * (1 - 0.01 * shot["number"]), count={"bias": BIASES, "flat": 10})
variant("ordinary: 10 flats", count={"bias": BIASES, "flat": 10})
variant("ordinary: noise of 0.3 DN", k=0.1, read=2.5, row=0.02, dsnu=0.1)
variant("ordinary: no PRNU, no DSNU, no shading", prnu=0.0, dsnu=0.0, falloff=0.0)
variant("10 bits replicated into 16", **in_16_bits(10, lambda v: v << 6 | v >> 4))
variant("12 bits replicated into 16", **in_16_bits(12, lambda v: v << 4 | v >> 8))
variant("12 bits shifted into 16", **in_16_bits(12, lambda v: v << 4))
variant("10 bits times 4.7", **in_16_bits(10, lambda v: np.floor(v * 4.7 + 0.5).astype(np.int64)))
variant("digital gain 1.5", coded=lambda self, dn: np.minimum(np.floor(np.clip(np.round(dn), 0, WHITE) * 1.5), WHITE), black=96, k_truth=1.5)
variant("digital gain 1.25 above black", coded=lambda self, dn: np.clip(BLACK + np.floor((np.round(dn) - BLACK) * 1.25 + 0.5), 0, WHITE), k_truth=1.25)


def corrected(self, dn, shot):
    """Flat-field correction in the camera: shading and response divided out."""
    gain = 1 / (self.shade * self.response)
    return self.coded(BLACK + (dn - BLACK) * gain / gain.min())


def corrected_dark(self, dn, shot):
    return self.coded(BLACK + (dn - self.offset - BLACK) / (self.shade * self.response))


variant("flat-field correction, shading of 10 %", recorded=corrected, k_truth=None)
variant("flat-field correction, shading of 50 %", recorded=corrected, falloff=0.5, k_truth=None)
variant("flat-field and dark correction, 50 %", recorded=corrected_dark, falloff=0.5, k_truth=None)
variant("shading of 50 %, not corrected", falloff=0.5)
variant("response of pixels corrected (PRNU 1 %)", recorded=lambda self, dn, shot: self.coded(BLACK + (dn - BLACK) / self.response))

SHIFTED = in_16_bits(12, lambda v: v << 4)
variant("black of 12 bits for 16", **{**SHIFTED, "black": BLACK})
variant("black of 16 bits for 12", black=BLACK * 16 - 1)
variant("black 0 for 64", black=0)
variant("white of 16 bits for 12", white=65535)
variant("white of 14 bits for 12", white=16383)
variant("white of 10 bits for 12", white=1023)

variant("mono declared Bayer", layout="bayer-rggb")
variant("mono declared polar-mono", layout="polar-mono")
variant("mono declared polar-bayer", layout="polar-bayer-rggb")
variant("Bayer", layout="bayer-rggb", colour=COLOUR)
variant("Bayer declared mono", colour=COLOUR)
variant("Bayer RGGB declared GBRG", layout="bayer-gbrg", colour=COLOUR)
variant("polar-Bayer declared Bayer", layout="bayer-rggb", colour=np.kron(COLOUR[:SIDE // 2, :SIDE // 2], np.ones((2, 2))))
variant("polar-Bayer declared mono", colour=np.kron(COLOUR[:SIDE // 2, :SIDE // 2], np.ones((2, 2))))
variant("polar-Bayer declared polar-mono", layout="polar-mono", colour=np.kron(COLOUR[:SIDE // 2, :SIDE // 2], np.ones((2, 2))))
ANGLES = np.tile(1 + 0.02 * np.array([[-0.5, 0.1], [0.3, 1]]), (SIDE // 2, SIDE // 2))
variant("polar-mono, light unpolarized to 2 %, declared mono", colour=ANGLES)
variant("mono, wide rows of another gain (2 %)", colour=np.tile([[1.0], [1.02]], (SIDE // 2, SIDE)))

variant("knee at half of the range, slope 1/4", analog=lambda self, e, shot: (lambda dn: np.where(dn > 2048, 2048 + (dn - 2048) / 4, dn))(Camera.analog(self, e, shot)))
variant("gamma 0.45", coded=lambda self, dn: np.round(WHITE * np.clip((dn - BLACK) / (WHITE - BLACK), 0, 1) ** 0.45 * (1 - BLACK / WHITE) + BLACK), k_truth=None)
variant("gamma 0.9", coded=lambda self, dn: np.round((WHITE - BLACK) * np.sign(dn - BLACK) * np.abs((dn - BLACK) / (WHITE - BLACK)) ** 0.9 + BLACK), k_truth=None)
variant("14 bits, gamma 0.45", coded=lambda self, dn: np.round(16383 * np.clip(dn / WHITE, 0, 1) ** 0.45), black=16383 * (BLACK / WHITE) ** 0.45, white=16383, k_truth=None)


def recursive(weight):
    def recorded(self, dn, shot):
        if shot["number"] == 0:
            self.state["last"] = np.mean([dn] + [self.analog(self.rng.poisson(np.maximum(dn - BLACK, 0) / K).astype(float), shot) for _ in range(7)], axis=0) if shot["kind"] == "flat" else dn
        self.state["last"] = weight * dn + (1 - weight) * self.state["last"]
        return self.coded(self.state["last"])
    return recorded


def lagging(share):
    """Each frame holds that share of the charge that the pixels held before."""

    def analog(self, electrons, shot):
        if shot["number"] == 0:
            self.state["charge"] = electrons * 1.0
            for _ in range(4):
                mean = np.maximum(shot["share"] * (WHITE - BLACK) / K * self.shade * self.response, 0)
                self.state["charge"] = (1 - share) * self.rng.poisson(mean) + share * self.state["charge"]
        self.state["charge"] = (1 - share) * electrons + share * self.state["charge"]
        return Camera.analog(self, self.state["charge"], shot)
    return analog


def averaged(frames):
    def frame(self, kind, share, number):
        parts = [Camera.analog(self, self.rng.poisson(share * (WHITE - BLACK) / K * self.shade * self.response).astype(float), {}) for _ in range(frames)]
        return self.coded(np.mean(parts, axis=0))
    return frame


variant("4 frames averaged in the camera", frame=averaged(4))
variant("image lag of 1 %", analog=lagging(0.01))
variant("image lag of 2 %", analog=lagging(0.02))
variant("image lag of 3 %", analog=lagging(0.03))
variant("image lag of 2 %, 10 flats", analog=lagging(0.02), count={"bias": BIASES, "flat": 10})
variant("recursive temporal filter, weight 0.5", recorded=recursive(0.5))
variant("recursive temporal filter, weight 0.8", recorded=recursive(0.8))
variant("auto-exposure between frames", light=lambda self, e, shot: e * (1 + 0.04 * np.sin(2.1 * shot["number"])))
variant("lamp flickers by 1 %", light=lambda self, e, shot: e * (1 + 0.01 * self.rng.standard_normal()))
variant("rolling shutter, mains bands of 1 %", light=lambda self, e, shot: e * (1 + 0.01 * np.sin(8 * ROWS + self.rng.uniform(0, 6.28))))
variant("rolling shutter, mains bands of 5 %", light=lambda self, e, shot: e * (1 + 0.05 * np.sin(8 * ROWS + self.rng.uniform(0, 6.28))))
variant("lamp warms up, 1 % a frame", light=lambda self, e, shot: e * (1 + 0.01 * shot["number"]))
variant("lamp warms up, 20 % over the session", light=lambda self, e, shot: e * (0.8 + 0.2 * shot["share"]))
variant("lamp moves, 2 % across the frame", light=lambda self, e, shot: e * (1 + 0.02 * (shot["number"] - 1.5) * COLS))


def leak(amount, where=1.0):
    return lambda self, e, shot: e + (amount * where if shot["kind"] == "bias" else 0)


variant("dark frames with light: 25 e- everywhere", light=leak(25))
variant("dark frames with light: 250 e- everywhere", light=leak(250))
variant("dark frames with light: 0 to 25 e-", light=leak(12.5, 1 + COLS))
variant("dark frames with light: 0 to 2.5 e-", light=leak(1.25, 1 + COLS))
variant("dark frames lit one by one", light=lambda self, e, shot: e + (20 * self.rng.random() if shot["kind"] == "bias" else 0))
variant("stray light of 50 e- in the flats", light=lambda self, e, shot: e + (50 if shot["kind"] == "flat" else 0))


def jpeg(quality):
    def recorded(self, dn, shot):
        stream = io.BytesIO()
        Image.fromarray(np.clip(np.round(dn / 16), 0, 255).astype(np.uint8)).save(stream, "JPEG", quality=quality)
        return np.asarray(Image.open(stream)).astype(float)
    return {"recorded": recorded, "black": BLACK / 16, "white": 255, "k_truth": 1 / 16}


def blocks_quantized(step):
    """Lossy as a wavelet or DCT coder is: the transform of 8x8 blocks is rounded."""
    basis = np.array([[np.cos(np.pi * (2 * x + 1) * u / 16) * np.sqrt((1 if u == 0 else 2) / 8) for x in range(8)] for u in range(8)])

    def recorded(self, dn, shot):
        blocks = np.round(dn).reshape(SIDE // 8, 8, SIDE // 8, 8).transpose(0, 2, 1, 3)
        coded = np.round(basis @ blocks @ basis.T / step) * step
        return self.coded((basis.T @ coded @ basis).transpose(0, 2, 1, 3).reshape(SIDE, SIDE))
    return recorded


variant("JPEG, quality 95, 8 bits", **jpeg(95))
variant("JPEG, quality 80, 8 bits", **jpeg(80))
variant("8 bits", coded=lambda self, dn: np.clip(np.round(dn / 16), 0, 255), black=4, white=255, k_truth=1 / 16)
variant("8x8 transform rounded to 4 DN", recorded=blocks_quantized(4))
variant("8x8 transform rounded to 10 DN", recorded=blocks_quantized(10))


def dead(self, dn, shot):
    out = self.coded(dn)
    out[40:42] = BLACK
    out[100] = WHITE
    return out


def median_where_far(self, dn, shot):
    """Defect correction that takes pixels beyond 2.5 deviations of their neighbours for defects."""
    around = np.stack([np.roll(dn, s, a) for s, a in ((1, 0), (-1, 0), (1, 1), (-1, 1))])
    middle = np.median(around, axis=0)
    far = np.abs(dn - middle) > 2.5 * np.sqrt(np.maximum((dn - BLACK) * K, 0) + (K * READ) ** 2)
    return self.coded(np.where(far, middle, dn))


variant("dead rows", recorded=dead)
variant("defect correction at 2.5 deviations", recorded=median_where_far)
variant("a frame of another size", recorded=lambda self, dn, shot: self.coded(dn)[: SIDE - 2 if shot["kind"] == "flat" and shot["share"] == 0.22 and shot["number"] == 2 else SIDE])
variant("exposures in milliseconds", exposure_s=staticmethod(lambda share: share * 100))
variant("exposures all alike", exposure_s=staticmethod(lambda share: 0.01))
variant("one exposure is wrong (12 % for 35 %)", exposure_s=staticmethod(lambda share: (0.12 if share == 0.35 else share) / 10))


def two_cameras(kinds):
    def recorded(self, dn, shot):
        if kinds(shot):
            other = self.state.setdefault("other", Camera(99))
            return other.coded(other.analog(self.rng.poisson(shot["share"] * (WHITE - BLACK) / K * 0.8 * other.response * other.shade).astype(float), shot) + 3)
        return self.coded(dn)
    return recorded


variant("bias frames of another camera (3 DN of black)", recorded=two_cameras(lambda shot: shot["kind"] == "bias"))
variant("half of the bias frames of another camera", recorded=two_cameras(lambda shot: shot["kind"] == "bias" and shot["number"] >= BIASES // 2))
variant("half of the levels of another camera (no K differs)", recorded=two_cameras(lambda shot: shot["share"] in LEVELS[::2]))
variant("half of each level's frames of another camera", recorded=two_cameras(lambda shot: shot["kind"] == "flat" and shot["number"] % 2))
variant("half of the levels at twice the gain", recorded=lambda self, dn, shot: self.coded(BLACK + 2 * (dn - BLACK) if shot["share"] in LEVELS[:4] else dn), k_truth=None)
variant("bias frames at twice the gain", recorded=lambda self, dn, shot: self.coded(BLACK + 2 * (dn - BLACK) if shot["kind"] == "bias" else dn))
variant("bias frames at a quarter of the gain", recorded=lambda self, dn, shot: self.coded(BLACK + (dn - BLACK) / 4 if shot["kind"] == "bias" else dn))
variant("gain differs by 5 % between odd and even columns", recorded=lambda self, dn, shot: self.coded(BLACK + (dn - BLACK) * (1 + 0.025 * (-1.0) ** np.arange(SIDE))))
variant("left half has 5 % more gain", recorded=lambda self, dn, shot: self.coded(BLACK + (dn - BLACK) * np.where(np.arange(SIDE) < SIDE // 2, 1.05, 1)))
variant("dark frame subtracted in the camera, cut at 0", coded=lambda self, dn: np.clip(np.round(dn - BLACK), 0, WHITE), black=0)
variant("smoothed along the rows", recorded=lambda self, dn, shot: self.coded(0.7 * dn + 0.15 * (np.roll(dn, 1, 1) + np.roll(dn, -1, 1))))
variant("one code is missing in 8", coded=lambda self, dn: (lambda v: np.where(v % 8 == 7, v - 1, v))(np.clip(np.round(dn), 0, WHITE)))


def textured(amount):
    picture = np.random.default_rng(4).standard_normal((SIDE, SIDE))
    picture = sum(np.roll(picture, (r, c), (0, 1)) for r in range(3) for c in range(3)) / 3
    return lambda self, e, shot: e * (1 + amount * picture)


def lost(kind, share, number):
    """The last quarter of one frame is missing: 0."""

    def recorded(self, dn, shot):
        out = self.coded(dn)
        if (shot["kind"], shot["share"], shot["number"]) == (kind, share, number):
            out[-SIDE // 4:] = 0
        return out
    return recorded


def stale(self, dn, shot):
    """The last quarter of a frame is that of the frame before."""
    out = self.coded(dn)
    before, self.state["before"] = self.state.get("before"), out.copy()
    if shot["kind"] == "bias" and shot["number"] == 7 or shot["share"] == 0.35 and shot["number"] == 2:
        out[-SIDE // 4:] = before[-SIDE // 4:]
    return out


variant("flats of a surface with a texture of 0.5 %", light=textured(0.005))
variant("flats of a surface with a texture of 2 %", light=textured(0.02))
variant("a flat has lost its last quarter (0)", recorded=lost("flat", 0.35, 2))
variant("a bias frame has lost its last quarter (0)", recorded=lost("bias", 0, 7))
variant("a bias frame and a flat hold a quarter of the frame before", recorded=stale)
variant("flats of 8 bits, bias frames of 12", recorded=lambda self, dn, shot: self.coded(dn / 16 if shot["kind"] == "flat" else dn))
variant("bias frames of 8 bits, flats of 12", recorded=lambda self, dn, shot: self.coded(dn / 16 if shot["kind"] == "bias" else dn))
variant("bytes of one flat exchanged", recorded=lambda self, dn, shot: self.coded(dn).astype(np.uint16).byteswap() if shot["share"] == 0.12 and shot["number"] == 1 else self.coded(dn))


def measured(fault, seed, program, kind):
    camera = FAULTS[fault](seed)
    camera_k = camera.k_truth
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        camera.session(folder)
        done = subprocess.run([program, "calibrate", folder / "session.toml", "-o", folder / "m.h5", "--json", "-q", "--kind", kind],
                              capture_output=True, text=True)
    said = [line for line in done.stderr.splitlines() if line]
    row = {"code": done.returncode, "said": said, "K": np.nan, "z": np.nan, "prnu": np.nan, "dark": np.nan}
    if done.returncode == 0:
        gain = json.loads(done.stdout)["gains"][0]
        scale = camera.k * (camera_k or 1)
        k, error = (gain.get("K") or {}).get("value"), (gain.get("K") or {}).get("stderr")
        if k:
            row["K"], row["z"] = np.mean(k) / scale, np.median((np.array(k) / scale - 1) / (np.array(error) / scale))
        prnu = gain.get("prnu", {}).get("value")
        row["prnu"] = np.mean(prnu) / camera.prnu if prnu and camera.prnu else np.nan
        truth = np.sqrt((camera.k * camera.read) ** 2 * (2 if camera.tails else 1) + camera.row**2 + 1 / 12) * (camera_k or 1)
        row["dark"] = np.mean(gain["temporal_sd_dark"]["value"]) / truth
    return row


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("faults", nargs="*", metavar="FAULT", help="(parts of) names; all where none is given")
    parser.add_argument("--program", default="build/release/malus")
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--kind", default="physics")
    parser.add_argument("--details", action="store_true")
    arguments = parser.parse_args()
    for fault in FAULTS:
        if arguments.faults and not any(part in fault for part in arguments.faults):
            continue
        rows = [measured(fault, seed, arguments.program, arguments.kind) for seed in range(arguments.seeds)]
        cells = [f"{np.median([row[key] for row in rows]):.3g}" for key in ("K", "z", "prnu", "dark")]
        warned = sum(bool(row["said"]) for row in rows)
        print(f"| {fault} | " + " | ".join(cells) + f" | {max(row['code'] for row in rows)} | {warned} of {len(rows)} |", flush=True)
        said = sorted({line for row in rows for line in row["said"]}) if fault.startswith("ordinary") else sorted(rows[0]["said"])
        for line in said if arguments.details else []:
            print("    " + line[:330], flush=True)


if __name__ == "__main__":
    main()
