"""The physics noise model in PyTorch, the way LED draws it: torch.poisson, the Tukey-lambda
quantile of torch.rand, row and quantisation noise; 16 channels packed from 2448 x 2048, float32."""
import json
import os
import sys
import time

try:
    import torch
except ImportError:
    print("[]")
    sys.exit(0)

CHANNELS, ROWS, COLS = 16, 512, 612
K, LAM, SIGMA_TL, SIGMA_ROW = 0.6, 0.1, 1.2, 0.3


def as_led(clean):
    noisy = torch.poisson(clean / K) * K
    u = torch.rand_like(clean).clamp_(1e-7, 1 - 1e-7)
    noisy += SIGMA_TL * (u ** LAM - (1 - u) ** LAM) / LAM
    noisy += torch.randn(CHANNELS, clean.shape[1], 1) * SIGMA_ROW
    noisy += torch.rand_like(clean) - 0.5
    return noisy


def main():
    quick = "--quick" in sys.argv
    rows = 16 if quick else ROWS
    torch.set_num_threads(os.cpu_count())
    clean = torch.linspace(0, 4000, CHANNELS * rows * COLS)
    clean = clean[torch.randperm(clean.numel())].reshape(CHANNELS, rows, COLS)
    times = []
    for _ in range(1 if quick else 5):
        start = time.perf_counter()
        as_led(clean)
        times.append(time.perf_counter() - start)
    value = clean.numel() / sorted(times)[len(times) // 2] * 1e-6
    print(json.dumps([{"name": "peer: PyTorch as LED", "value": value, "unit": "Mpx/s",
                       "note": f"PyTorch {torch.__version__}, {torch.get_num_threads()} threads"}]))


if __name__ == "__main__":
    main()
