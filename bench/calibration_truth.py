#!/usr/bin/env python3
"""What `malus calibrate` finds of cameras whose noise is known, with its errors in its own standard errors: figures of docs/calibration.md.

    /usr/bin/python3 bench/calibration_truth.py [--program build/release/malus] [--seeds N] [--shape ppcc] [CAMERA ...]

A NumPy camera of one channel: Poisson light of K DN/e-, Tukey-lambda read noise, rows, a fixed pattern in the dark and of the response,
rounded to whole numbers and cut off at 0 and white. Prints, per camera and parameter, the truth, the mean over the sessions (and over
the truth), and mean and root mean square of (estimate - truth) / standard error, which are 0 and 1 where both are right; then the
warnings, with the number of sessions that had them. CAMERA: (parts of) names, all where none is given.
"""
import argparse
import collections
import json
import math
import pathlib
import re
import subprocess
import tempfile

import numpy as np


def tukey_lambda_variance(shape):
    if abs(shape) < 1e-6:
        return math.pi**2 / 3
    return 2 / shape**2 * (1 / (1 + 2 * shape) - math.exp(2 * math.lgamma(shape + 1) - math.lgamma(2 * shape + 2)))


class Camera:
    """read_dn: deviation of the read noise; exposure: of a share of the range, s; bent: what full range lacks of a straight line."""

    side, biases, flats, levels = 128, 20, 4, (0.01, 0.03, 0.06, 0.12, 0.22, 0.35, 0.5, 0.64)
    k, read_dn, shape, row_dn, dsnu_dn, prnu, mu_dn, black, white = 0.4, 1.2, 0.14, 0.3, 0.4, 0.01, 0.0, 64, 4095
    shift, falloff, bent, hot, dark_e_per_s, dark_sets, period, full_well_e = 0, 0.1, 0.0, 0.0, 0.0, 0, 1, math.inf
    seconds = 0.1  # at full range
    coded = staticmethod(np.round)

    def __init__(self, seed):
        self.rng = np.random.default_rng(seed)
        rows, cols = np.mgrid[: self.side, : self.side] / (self.side - 1.0) * 2 - 1
        self.shade = 1 - self.falloff * (rows**2 + cols**2) / 2
        shape = (self.side, self.side)
        self.offset = self.dsnu_dn * self.rng.standard_normal(shape)
        self.response = 1 + self.prnu * self.rng.standard_normal(shape)
        self.offset += np.where(self.rng.random(shape) < self.hot, 10 ** self.rng.uniform(1.5, 3, shape), 0)
        self.dark_e = self.dark_e_per_s * np.maximum(1 + 0.3 * self.rng.standard_normal(shape), 0)
        self.scale = self.read_dn / math.sqrt(tukey_lambda_variance(self.shape))

    def read_noise(self):
        u = np.clip(self.rng.random((self.side, self.side)), 1e-15, 1 - 1e-15)
        if self.shape == 0:
            return self.scale * np.log(u / (1 - u))
        return self.scale * (u**self.shape - (1 - u) ** self.shape) / self.shape

    def frame(self, share, exposure_s):
        electrons = share * (self.white - self.black) / self.k * self.shade * self.response + self.dark_e * exposure_s
        signal = self.k * np.minimum(self.rng.poisson(electrons), self.full_well_e)
        signal = signal - self.bent * signal**2 / (self.white - self.black)
        rows = np.repeat(self.row_dn * self.rng.standard_normal(-(-self.side // self.period)), self.period)[: self.side, None]
        dn = self.black + self.mu_dn + signal + self.offset + rows + self.read_noise()
        return np.clip(self.coded(dn), 0, self.white).astype(np.uint16) << self.shift

    def session(self, folder):
        step = 2**self.shift
        text = f'[sensor]\nlayout = "mono"\nblack = {self.black * step}\nwhite = {self.white * step}\n'
        sets = [("bias", 0, 1e-5, self.biases)]
        for share in self.levels:
            sets.append(("flat", share, share * self.seconds, self.flats))
            sets += [("bias", 0, share * self.seconds, self.dark_sets)] if self.dark_sets else []
        for number, (kind, share, exposure_s, frames) in enumerate(sets):
            names = [f"{number}_{i}.npy" for i in range(frames)]
            for name in names:
                np.save(folder / name, self.frame(share, exposure_s))
            text += f'[[frames]]\nkind = "{kind}"\ngain_db = 0\nexposure_s = {exposure_s:.6g}\npaths = {json.dumps(names)}\n'
            text += f"level = {number}\n" if kind == "flat" else ""
        (folder / "session.toml").write_text(text)

    def truth(self):
        step = 2**self.shift
        dark_dn = math.sqrt(self.read_dn**2 + self.row_dn**2 + 1 / 12)
        return {"K": self.k * step, "mu": self.mu_dn * step, "sigma_row": self.row_dn * step, "sigma_tl": self.scale * step,
                "lambda": self.shape, "temporal_sd_dark": dark_dn * step, "dsnu": self.dsnu_dn * step, "prnu": self.prnu}


CAMERAS = {"ordinary": Camera}


def camera(camera_name, **changes):
    CAMERAS[camera_name] = type("Variant", (Camera,), changes)


# The gains of one sensor: K and read noise in DN rise, electrons stay.
camera("gain of 0 dB")
camera("gain of 0 dB, noise of 0.94 DN, 100 frames of 64x64", side=64, biases=100, read_dn=0.94, row_dn=0.1)
camera("gain of 12 dB", k=1.6, read_dn=4.6, row_dn=1.0, dsnu_dn=1.0)
camera("gain of 36 dB", k=25.2, read_dn=69.0, row_dn=12.0, dsnu_dn=12.0, black=400)
for shape in (0.0, -0.1, -0.2, -0.27):
    camera(f"tails, lambda {shape}, 30 DN", shape=shape, read_dn=30.0, row_dn=3.0, k=4.0, dsnu_dn=2.0, black=1000, white=16383)
for shape in (0.5, 0.8, 1.0):
    camera(f"abrupt ends, lambda {shape}, 3 DN", shape=shape, read_dn=3.0)
camera("abrupt ends, lambda 0.8, 3 DN, no pattern or rows", shape=0.8, read_dn=3.0, row_dn=0.0, dsnu_dn=0.0)
camera("abrupt ends, lambda 0.8, 30 DN", shape=0.8, read_dn=30.0, row_dn=3.0, k=4.0, dsnu_dn=2.0, black=1000, white=16383)
camera("tails, lambda -0.27, 3 DN, 4 bias frames", shape=-0.27, read_dn=3.0, biases=4)
camera("tails, lambda -0.27, 3 DN, 8 bias frames", shape=-0.27, read_dn=3.0, biases=8)
camera("tails, lambda -0.27, 3 DN, 20 bias frames", shape=-0.27, read_dn=3.0)
for shape, frames in ((-0.1, 2), (-0.27, 2), (-0.27, 4), (-0.27, 20)):
    camera(f"tails, lambda {shape}, 3 DN, DSNU of 3 DN, {frames} bias frames", shape=shape, read_dn=3.0, dsnu_dn=3.0, biases=frames)
camera("tails, lambda -0.27, 30 DN, 32x32", shape=-0.27, read_dn=30.0, row_dn=3.0, k=4.0, dsnu_dn=2.0, side=32, black=1000, white=16383)
CUT = {"read_dn": 8.0, "k": 1.0, "row_dn": 0.8, "dsnu_dn": 1.0}
for black in (24, 20, 16, 13, 8):
    camera(f"cut off, black at {black / 8:.2g} deviations", black=black, **CUT)
for half in ({"dsnu_dn": 4.0}, {"row_dn": 4.0}):
    camera(f"cut off, black at 1.4 deviations, {next(iter(half))} half of the noise", black=11, **{**CUT, **half})
camera("cut off, lambda 0, black at 2.5 deviations", shape=0.0, black=20, **CUT)
camera("cut off, lambda -0.2, black at 3 deviations", shape=-0.2, black=24, **CUT)
camera("cut off, lambda -0.27, black at 6.4 deviations", shape=-0.27, read_dn=10.0, k=4.0, row_dn=3.0, dsnu_dn=2.0)
for mu in (0.0, 0.3, 0.5):
    camera(f"rounded, 0.25 DN, bias of {mu} DN", read_dn=0.25, dsnu_dn=0.15, k=0.1, row_dn=0.05, mu_dn=mu)
camera("few frames: 4 bias frames, 2 flats", biases=4, flats=2)
camera("8 bits", k=0.05, read_dn=0.6, row_dn=0.1, dsnu_dn=0.3, black=8, white=255)
camera("12 bits in 16", shift=4)
CODES = {
    "every 4th in use": lambda dn: 4 * np.round(dn / 4), "every 4th missing": lambda dn: np.round(dn) - (np.round(dn) % 4 == 3),
    "digital gain of 1.25": lambda dn: np.round(np.round(dn / 1.25) * 1.25), "digital gain of 0.8": lambda dn: np.round(np.round(dn / 0.8) * 0.8),
}
for name, coded in CODES.items():
    for read_dn in (2.0, 5.0):
        camera(f"codes, {name}, noise of {read_dn:.0f} DN", read_dn=read_dn, row_dn=read_dn / 5, coded=staticmethod(coded))
camera("16 bits, binned", k=2.0, read_dn=9.0, row_dn=1.5, dsnu_dn=3.0, black=500, white=65535)
camera("rows in groups of 2", period=2)
camera("hot pixels, a thousandth", hot=1e-3)
camera("response bent by 3 %", bent=0.03)
camera("full well at 55 % of the range", full_well_e=5500)
camera("strong PRNU, 5 %", prnu=0.05)
camera("dark current, 40 e-/s, dark sets", dark_e_per_s=40.0, seconds=10.0, dark_sets=4)
camera("dark current, 40 e-/s, bias frames alone", dark_e_per_s=40.0, seconds=10.0)


# Several gains of one sensor, and one between them: read noise in electrons before the amplifier and in DN after it, bias in e-.
BETWEEN = {
    "gains of 0, 12 and 36 dB, at 18 dB": {"gains_db": (0, 12, 36), "at_db": 18, "read_e": 2.3, "read_dn": 0.0, "bias_e": 0.5},
    "gains of 0 and 30 dB, at 10 dB": {"gains_db": (0, 30), "at_db": 10, "read_e": 2.0, "read_dn": 1.0, "bias_e": 0.0},
}
K_AT_0_DB = 0.25


def camera_at(gain_db, read_e, read_dn, bias_e):
    k = K_AT_0_DB * 10 ** (gain_db / 20)
    return type("AtGain", (Camera,), {"k": k, "read_dn": math.hypot(read_e * k, read_dn), "mu_dn": bias_e * k, "row_dn": 0.1 * k,
                                      "dsnu_dn": 0.2 * k, "black": 400})


def print_between(name, seeds, program):
    case = BETWEEN[name]
    noise = {key: case[key] for key in ("read_e", "read_dn", "bias_e")}
    found = collections.defaultdict(list)
    for seed in range(seeds):
        with tempfile.TemporaryDirectory() as root:
            text = ""
            for gain_db in case["gains_db"]:
                folder = pathlib.Path(root) / str(gain_db)
                folder.mkdir()
                camera_at(gain_db, **noise)(seed).session(folder)
                sensor, *sets = (folder / "session.toml").read_text().split("[[frames]]")
                for part in sets:
                    text += "[[frames]]" + re.sub(r'"(\d+_\d+\.npy)"', rf'"{gain_db}/\1"', part.replace("gain_db = 0", f"gain_db = {gain_db}"))
            (pathlib.Path(root) / "session.toml").write_text(sensor + text)
            subprocess.run([program, "calibrate", f"{root}/session.toml", "-o", f"{root}/m.h5", "-q"], check=True, capture_output=True)
            shown = subprocess.run([program, "model", "show", f"{root}/m.h5", "--gain", str(case["at_db"]), "--json"], check=True, capture_output=True, text=True)
        gain = json.loads(shown.stdout)["gains"][0]
        for parameter in ("K", "mu", "sigma_row", "read_noise"):
            found[parameter].append((gain[parameter].get("value") or gain[parameter].get("mean"))[0])
    truth = camera_at(case["at_db"], **noise)
    print(f"{name} ({seeds} sessions)")
    for parameter, true in (("K", truth.k), ("mu", truth.mu_dn), ("sigma_row", truth.row_dn), ("read_noise", truth.read_dn / truth.k)):
        mean = np.mean(found[parameter])
        print(f"  {parameter:17} {true:9.5g} {mean:9.5g} " + (f"{100 * (mean / true - 1):+7.2f} %" if true else ""))
    print(flush=True)


def measured(kind, seed, program, shape="likelihood"):
    """Estimates and standard errors by name, and warnings; None and the error where it was refused."""
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        kind(seed).session(folder)
        done = subprocess.run([program, "calibrate", folder / "session.toml", "-o", folder / "m.h5", "--json", "-q", "--shape", shape],
                              capture_output=True, text=True)
    said = [re.sub(r"[-+]?\d[\d.e-]*", "#", line) for line in done.stderr.splitlines() if line]
    if done.returncode:
        return None, said
    gain = json.loads(done.stdout)["gains"][0]
    values = {}
    for parameter, entry in gain.items():
        value = isinstance(entry, dict) and (entry.get("value") or entry.get("mean"))
        if value and isinstance(value, list):
            error = (entry.get("stderr") or [None])[0]
            values[parameter] = (value[0], math.nan if error is None else error)
    return values, said


def print_camera(name, seeds, program, shape):
    found, warnings = collections.defaultdict(list), collections.Counter()
    for seed in range(seeds):
        values, said = measured(CAMERAS[name], seed, program, shape)
        warnings.update(said)
        for parameter, value in (values or {}).items():
            found[parameter].append(value)
    print(f"{name} ({seeds} sessions)")
    for parameter, truth in CAMERAS[name](0).truth().items():
        if not found[parameter]:
            print(f"  {parameter:17} {truth:9.5g}  not measured")
            continue
        value, error = np.array(found[parameter]).T
        off = (value - truth) / error
        relative = f"{100 * (value.mean() / truth - 1):+7.2f} %" if truth else " " * 9
        known = f"{off.mean():+7.2f} {math.sqrt(np.mean(off**2)):6.2f}" if np.isfinite(off).all() else "no standard error"
        print(f"  {parameter:17} {truth:9.5g} {value.mean():9.5g} {relative}  {known}")
    for line, count in warnings.most_common():
        print(f"  [{count}] {line[:200]}")
    print(flush=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("cameras", nargs="*", metavar="CAMERA", help="(parts of) names; all where none is given")
    parser.add_argument("--program", default="build/release/malus")
    parser.add_argument("--shape", default="likelihood", help="that of calibrate")
    parser.add_argument("--seeds", type=int, default=12)
    arguments = parser.parse_args()
    for name in CAMERAS:
        if not arguments.cameras or any(part in name for part in arguments.cameras):
            print_camera(name, arguments.seeds, arguments.program, arguments.shape)
    for name in BETWEEN:
        if not arguments.cameras or any(part in name for part in arguments.cameras):
            print_between(name, arguments.seeds, arguments.program)


if __name__ == "__main__":
    main()
