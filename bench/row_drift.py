#!/usr/bin/env python3
"""What it is worth that the removal of row noise knows how rows drift: the table of docs/row-noise.md.

    PYTHONPATH=build/release/python /usr/bin/python3 bench/row_drift.py

A NumPy camera of mono polarization whose rows are lifted by a first-order autoregressive and a white sequence, calibrated from its own
frames, and even light with a slow wave. Prints, per share and length of the drift and light [DN]: squared error of the result
[dB re 1 DN^2] and over what is stated of it, means of four frames. PYTHONPATH names the version that is measured.
"""
import pathlib
import tempfile
import warnings

import malus
import numpy as np

ROWS, COLS, K, READ, ROW, BLACK, WHITE = 512, 640, 0.5, 2.0, 2.0, 64, 4095
DRIFTS = ((0.33, 2.2), (0.6, 8), (0.8, 20))
LEVELS = (0, 300, 900, 1800)


def offsets(share, length, random):
    keep, slow = np.exp(-1 / length), random.standard_normal()
    drawn = np.empty(ROWS)
    for row in range(ROWS):
        slow = keep * slow + np.sqrt(1 - keep**2) * random.standard_normal()
        drawn[row] = np.sqrt(share) * slow + np.sqrt(1 - share) * random.standard_normal()
    return ROW * drawn[:, None]


def frame(light, drift, random):
    dn = K * random.poisson(light / K, (ROWS, COLS)) + random.normal(0, READ, (ROWS, COLS)) + offsets(*drift, random)
    return np.clip(np.round(BLACK + dn), 0, WHITE).astype(np.uint16)


def calibrated(drift, folder):
    random = np.random.default_rng(3)
    text = f'[sensor]\nlayout = "polar-mono"\nblack = {BLACK}\nwhite = {WHITE}\n'
    for level, light in enumerate(LEVELS):
        names = [f"{level}_{i}.npy" for i in range(6 if level else 30)]
        for name in names:
            np.save(folder / name, frame(light, drift, random))
        text += f'[[frames]]\nkind = "{"flat" if level else "bias"}"\ngain_db = 0\n' + (f"level = {level}\n" if level else "")
        text += f"paths = {names}\n".replace("'", '"')
    (folder / "session.toml").write_text(text)
    return malus.calibrate(malus.Session(folder / "session.toml"))


def main():
    warnings.simplefilter("ignore")
    r, c = np.mgrid[:ROWS, :COLS]
    for drift in DRIFTS:
        with tempfile.TemporaryDirectory() as folder:
            model = calibrated(drift, pathlib.Path(folder))
        cells = []
        for light in (20, 200):
            clean = light * (0.6 + 0.4 * np.sin(c / 37 + r / 90))
            squares, stated = [], []
            for seed in range(4):
                raw = frame(clean, drift, np.random.default_rng(50 + seed))
                done = malus.denoise(raw, layout="polar-mono", black=BLACK, white=WHITE, model=model, gain=0, variance=True)
                squares.append(np.mean((done["dn"] - clean) ** 2))
                stated.append(squares[-1] / np.nanmean(done["variance"]))
            cells.append(f"{10 * np.log10(np.mean(squares)):.1f}, {np.mean(stated):.2f}")
        print(f"| {100 * drift[0]:.0f} %, {drift[1]} | " + " | ".join(cells) + " |", flush=True)


if __name__ == "__main__":
    main()
