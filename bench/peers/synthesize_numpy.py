"""The physics noise model in NumPy and SciPy: 16 channels packed from 2448 x 2048, float32.

"as ELD": scipy.stats.poisson and tukeylambda, one channel after the other, the way of the published
code. "NumPy": the same distribution with numpy.random.Generator and the closed-form quantile.
"""
import json
import sys
import time

import numpy as np
from scipy import stats

CHANNELS, ROWS, COLS = 16, 512, 612
K, LAM, SIGMA_TL, SIGMA_ROW = 0.6, 0.1, 1.2, 0.3


def as_eld(clean):
    noisy = np.empty_like(clean)
    for c in range(CHANNELS):
        shot = stats.poisson.rvs(clean[c] / K) * K
        read = stats.tukeylambda.rvs(LAM, scale=SIGMA_TL, size=clean[c].shape)
        row = np.random.randn(ROWS, 1) * SIGMA_ROW
        quantisation = np.random.uniform(-0.5, 0.5, size=clean[c].shape)
        noisy[c] = shot + read + row + quantisation
    return noisy


def plain_numpy(clean, rng=np.random.default_rng(1)):
    noisy = (rng.poisson(clean * np.float32(1 / K)) * np.float32(K)).astype(np.float32)
    u = rng.random(clean.shape, dtype=np.float32)
    np.clip(u, 1e-7, 1 - 1e-7, out=u)
    noisy += np.float32(SIGMA_TL / LAM) * (u ** np.float32(LAM) - (1 - u) ** np.float32(LAM))
    noisy += rng.standard_normal((CHANNELS, ROWS, 1), dtype=np.float32) * np.float32(SIGMA_ROW)
    noisy += rng.random(clean.shape, dtype=np.float32) - np.float32(0.5)
    return noisy


def rate(work, clean, repetitions):
    times = []
    for _ in range(repetitions):
        start = time.perf_counter()
        work(clean)
        times.append(time.perf_counter() - start)
    return clean.size / sorted(times)[len(times) // 2] * 1e-6


def main():
    global ROWS
    quick = "--quick" in sys.argv
    if quick:
        ROWS = 16
    clean = np.linspace(0, 4000, CHANNELS * ROWS * COLS, dtype=np.float32)
    clean = np.random.default_rng(0).permutation(clean).reshape(CHANNELS, ROWS, COLS)
    repetitions = 1 if quick else 5
    print(json.dumps([
        {"name": "peer: NumPy + SciPy as ELD", "value": rate(as_eld, clean, repetitions),
         "unit": "Mpx/s", "note": f"NumPy {np.__version__}, 1 thread"},
        {"name": "peer: best plain NumPy", "value": rate(plain_numpy, clean, repetitions),
         "unit": "Mpx/s", "note": "1 thread"},
    ]))


if __name__ == "__main__":
    main()
