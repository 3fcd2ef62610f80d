"""Noise that a camera cuts off at its lowest code (docs/denoising.md, "Noise cut off at 0").

A NumPy camera of its own (0.4 DN/e-, 1.2 DN of read noise, mono polarization, 12 bit) looks at a spot of light that falls off to
darkness, everywhere half polarized. Its black level is so many deviations of the read noise. Mean S0 and DoLP of places by their
true light, of the raw frame and denoised: with the noise estimated from the picture, and with a model calibrated from the camera's
own frames (whose dark frames are cut off too).

    PYTHONPATH=build/release/python /usr/bin/python3 bench/cut_off.py
"""
import tempfile
import warnings
from pathlib import Path

import malus
import numpy as np

GAIN_DN_PER_E, READ_DN, WHITE_DN = 0.4, 1.2, 4095
SIZE, LAYOUT = 512, "polar-mono"
ANGLES = np.deg2rad(np.array([[90, 45], [135, 0]]))
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


def calibrated(black_dn, folder, random):
    flat = np.ones((SIZE, SIZE))
    parts = [f'[sensor]\nlayout = "{LAYOUT}"\nblack = {black_dn}\nwhite = {WHITE_DN}\n']
    for number in range(20):
        np.save(folder / f"dark_{number}.npy", exposed(0 * flat, black_dn, random))
    parts.append('[[frames]]\nkind = "bias"\ngain_db = 0\npaths = ["dark_*.npy"]\n')
    for level, light in enumerate((50, 150, 400, 800, 1500)):
        for number in range(2):
            np.save(folder / f"flat_{level}_{number}.npy", exposed(light * flat, black_dn, random))
        parts.append(f'[[frames]]\nkind = "flat"\ngain_db = 0\nlevel = {level}\npaths = ["flat_{level}_*.npy"]\n')
    (folder / "session.toml").write_text("\n".join(parts))
    return malus.calibrate(folder / "session.toml")


def measured(dn, truth):
    """(mean S0, DoLP of the mean light) per range of the true S0; DoLP from sums of S1 and S2 along the angle."""
    found, true = malus.stokes(dn.astype(np.float32), LAYOUT), malus.stokes(truth.astype(np.float32), LAYOUT)
    row = []
    for low, high in LIGHTS:
        there = (true["s0"][0] >= low) & (true["s0"][0] < high)
        along = sum(found[s][0][there] * true[s][0][there] for s in ("s1", "s2")).sum()
        length = sum(true[s][0][there] ** 2 for s in ("s1", "s2")).sum()
        s0 = found["s0"][0][there].mean()
        dolp = along / length * np.hypot(true["s1"][0][there], true["s2"][0][there]).sum() / found["s0"][0][there].sum()
        row.append((s0, dolp))
    return row


def cells(row):
    return "".join(f" {s0:.2f} / {dolp:.2f} |" for s0, dolp in row)


def main():
    warnings.simplefilter("ignore")
    truth = scene()
    print("| black level | at 0 | |" + "".join(f" S0 {low} to {high} DN: S0 / DoLP |" for low, high in LIGHTS))
    print("|---|---|---|" + "---|" * len(LIGHTS))
    print("| | | true |" + cells(measured(truth, truth)))
    for deviations in BLACKS:
        random = np.random.default_rng(1000 + deviations)
        black_dn = deviations * READ_DN
        raw = exposed(truth, black_dn, random)
        given = dict(layout=LAYOUT, black=black_dn, white=WHITE_DN)
        with tempfile.TemporaryDirectory() as folder:
            model = calibrated(black_dn, Path(folder), random)
        rows = {
            "raw": raw - black_dn,
            "denoised": malus.denoise(raw, **given)["dn"],
            "denoised, model": malus.denoise(raw, model=model, gain=0, **given)["dn"],
        }
        for name, dn in rows.items():
            print(f"| {deviations} σ | {100 * (raw == 0).mean():.0f} % | {name} |" + cells(measured(dn, truth)), flush=True)


if __name__ == "__main__":
    main()
