"""The Python module on the batch of `malus bench --only packed`: 16 packed planes of 512 x 512 into an existing array.

The module has to be on PYTHONPATH where it is not installed.
"""
import json
import sys
import time

try:
    import malus
    import numpy as np
except ImportError:
    print("[]")
    sys.exit(0)

CHANNELS, SIDE, TOP_DN, REPETITIONS = 16, 512, 4000, 25


def main():
    quick = "--quick" in sys.argv
    rows = 16 if quick else SIDE
    model = malus.Model("imx250myr-simulated")
    clean = np.random.default_rng(0).uniform(0, TOP_DN, (CHANNELS, rows, SIDE)).astype(np.float32)
    noisy = np.empty_like(clean)
    times = []
    for frame in range(1 if quick else REPETITIONS + 1):
        start = time.perf_counter()
        model.synthesize(clean, gain=12, seed=1, frame=frame, out=noisy)
        times.append(time.perf_counter() - start)
    times = sorted(times[-REPETITIONS:])  # the first one warms up
    print(json.dumps([{"name": "Python module", "value": clean.size / times[len(times) // 2] * 1e-6, "unit": "Mpx/s",
                       "note": f"{malus.set_threads(0)} threads"}]))


if __name__ == "__main__":
    main()
