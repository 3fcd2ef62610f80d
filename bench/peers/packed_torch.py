"""The same noise in PyTorch on the batch of `malus bench --only packed`: 16 packed planes of 512 x 512, float32."""
import json
import os
import sys
import time

try:
    import torch
except ImportError:
    print("[]")
    sys.exit(0)

from synthesize_torch import as_led

CHANNELS, SIDE, TOP_DN, REPETITIONS = 16, 512, 4000, 5


def main():
    quick = "--quick" in sys.argv
    rows = 16 if quick else SIDE
    torch.set_num_threads(os.cpu_count())
    torch.manual_seed(0)
    clean = torch.rand(CHANNELS, rows, SIDE) * TOP_DN
    times = []
    for _ in range(1 if quick else REPETITIONS + 1):
        start = time.perf_counter()
        as_led(clean)
        times.append(time.perf_counter() - start)
    times = sorted(times[-REPETITIONS:])
    print(json.dumps([{"name": "peer: PyTorch as LED", "value": clean.numel() / times[len(times) // 2] * 1e-6, "unit": "Mpx/s",
                       "note": f"PyTorch {torch.__version__}, {torch.get_num_threads()} threads"}]))


if __name__ == "__main__":
    main()
