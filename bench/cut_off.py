"""Noise that a camera cuts off at its lowest code (docs/denoising.md, "Noise cut off at 0").

A NumPy camera of its own (0.4 DN/e-, 1.2 DN of read noise, mono polarization, 12 bit) looks at a spot of light that falls off to
darkness, everywhere half polarized. Its black level is given in deviations of the read noise. Mean S0 and DoLP of places by their
true light, of the raw frame and denoised: with the noise estimated from the picture, and with a model calibrated from the camera's
own frames (whose dark frames are cut off too).

    PYTHONPATH=build/release/python /usr/bin/python3 bench/cut_off.py
    PYTHONPATH=build/release/python /usr/bin/python3 bench/cut_off.py --layout polar-bayer-rggb --network models/polar-bayer.safetensors
"""
import argparse
import subprocess
import tempfile
import warnings
from pathlib import Path

import malus
import numpy as np

GAIN_DN_PER_E, READ_DN, WHITE_DN = 0.4, 1.2, 4095
SIZE = 512
ANGLES = np.deg2rad(np.array([[90, 45], [135, 0]]))  # of polar-mono and polar-bayer-rggb
DOLP = 0.5
BLACKS = (0, 1, 2, 5)  # in deviations of the read noise
LIGHTS = ((0, 0.5), (0.5, 1), (1, 2), (2, 4))  # of S0, DN


def scene():
    rows, cols = np.mgrid[:SIZE, :SIZE]
    s0 = 9.6 * np.exp(-((cols - SIZE / 2) ** 2 + (rows - SIZE / 2) ** 2) / (2 * 120**2))
    angle = np.deg2rad(cols / 3)
    return 0.5 * s0 * (1 + DOLP * np.cos(2 * (ANGLES[rows % 2, cols % 2] - angle)))


def exposed(light_dn, black_dn, random):
    electrons = random.poisson(light_dn / GAIN_DN_PER_E)
    dn = GAIN_DN_PER_E * electrons + random.normal(0, READ_DN, light_dn.shape) + black_dn
    return np.clip(np.round(dn), 0, WHITE_DN).astype(np.uint16)


def calibrated(layout, black_dn, folder, random):
    flat = np.ones((SIZE, SIZE))
    parts = [f'[sensor]\nlayout = "{layout}"\nblack = {black_dn}\nwhite = {WHITE_DN}\n']
    for number in range(20):
        np.save(folder / f"dark_{number}.npy", exposed(0 * flat, black_dn, random))
    parts.append('[[frames]]\nkind = "bias"\ngain_db = 0\npaths = ["dark_*.npy"]\n')
    for level, light in enumerate((50, 150, 400, 800, 1500)):
        for number in range(2):
            np.save(folder / f"flat_{level}_{number}.npy", exposed(light * flat, black_dn, random))
        parts.append(f'[[frames]]\nkind = "flat"\ngain_db = 0\nlevel = {level}\npaths = ["flat_{level}_*.npy"]\n')
    (folder / "session.toml").write_text("\n".join(parts))
    return malus.calibrate(folder / "session.toml")


def denoised_by_network(program, weights, raw, layout, black_dn, folder):
    np.save(folder / "raw.npy", raw)
    subprocess.run([program, "denoise", folder / "raw.npy", "--layout", layout, "--black", str(black_dn), "--white", str(WHITE_DN),
                    "--method", weights, "--format", "npy", "-q", "-o", folder], check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    return np.load(folder / "raw_denoised.npy")


def measured(dn, truth, layout):
    """(mean S0, DoLP of the mean light) per range of the true S0; DoLP from sums of S1 and S2 along the angle."""
    found, true = malus.stokes(dn.astype(np.float32), layout), malus.stokes(truth.astype(np.float32), layout)
    row = []
    for low, high in LIGHTS:
        there = (true["s0"] >= low) & (true["s0"] < high)
        along = sum(found[s][there] * true[s][there] for s in ("s1", "s2")).sum()
        length = sum(true[s][there] ** 2 for s in ("s1", "s2")).sum()
        s0 = found["s0"][there].mean()
        dolp = along / length * np.hypot(true["s1"][there], true["s2"][there]).sum() / found["s0"][there].sum()
        row.append((s0, dolp))
    return row


def cells(row):
    return "".join(f" {s0:.2f} / {dolp:.2f} |" for s0, dolp in row)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--layout", default="polar-mono", choices=["polar-mono", "polar-bayer-rggb"])
    parser.add_argument("--network", type=Path, help="also with these weights")
    parser.add_argument("--program", type=Path, default=Path("build/release/malus"))
    arguments = parser.parse_args()
    warnings.simplefilter("ignore")
    layout, truth = arguments.layout, scene()
    print("| black level | at 0 | |" + "".join(f" S0 {low} to {high} DN: S0 / DoLP |" for low, high in LIGHTS))
    print("|---|---|---|" + "---|" * len(LIGHTS))
    print("| | | true |" + cells(measured(truth, truth, layout)))
    for deviations in BLACKS:
        random = np.random.default_rng(1000 + deviations)
        black_dn = deviations * READ_DN
        raw = exposed(truth, black_dn, random)
        given = dict(layout=layout, black=black_dn, white=WHITE_DN)
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            model = calibrated(layout, black_dn, folder, random)
            rows = {
                "raw": raw - black_dn,
                "denoised": malus.denoise(raw, **given)["dn"],
                "denoised, model": malus.denoise(raw, model=model, gain=0, **given)["dn"],
            }
            if arguments.network:
                rows["network"] = denoised_by_network(arguments.program, arguments.network, raw, layout, black_dn, folder)
        for name, dn in rows.items():
            print(f"| {deviations} σ | {100 * (raw == 0).mean():.0f} % | {name} |" + cells(measured(dn, truth, layout)), flush=True)


if __name__ == "__main__":
    main()
