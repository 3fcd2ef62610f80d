"""A torch data set that draws noisy/clean pairs while the network trains.

    python3 noisy_pairs.py [--workers 2]

Noise is a function of (seed, frame number, pixel): the frame number is made from the epoch and the index, so any number of
workers gives the same pairs, no two of them draw the same noise, and every epoch sees new noise on the same pictures.
"""

import argparse
import time

import malus
import numpy as np
import torch


class NoisyPairs(torch.utils.data.Dataset):
    """Pairs (noisy, clean) of packed planes [channel, row, column], float32, DN above black.

    clean: array [picture, channel, row, column]; ratio: how much darker the noisy one was taken (and amplified again).
    Every item draws its own gain over the model's calibrated range.
    """

    def __init__(self, clean, model, ratio=10.0, seed=0):
        self.clean, self.name, self.ratio, self.seed = clean, model, ratio, seed
        self.epoch = 0
        self.model = None  # opened by each worker for itself

    def __len__(self):
        return len(self.clean)

    def __getitem__(self, index):
        if self.model is None:
            self.model = malus.Model(self.name)
        clean = torch.from_numpy(self.clean[index])
        noisy = torch.empty_like(clean)
        frame = (self.epoch * len(self) + index) % 2**32
        self.model.synthesize(clean, gain=None, seed=self.seed, frame=frame, out=noisy,
                              ratio=self.ratio, amplify=True, debias=True)
        return noisy, clean


def polarized_ramps(count, rows=64, cols=64):
    """Clean pictures to try it with: smooth light whose polarization turns over the picture."""
    r, c = np.mgrid[0:4 * rows, 0:4 * cols]
    axis = np.deg2rad(np.array([[90, 45], [135, 0]]))[r % 2, c % 2]
    mosaics = [(400 + 300 * np.sin(0.02 * (i + 1) * r)) * (1 + 0.5 * np.cos(2 * axis - 0.03 * c)) for i in range(count)]
    return np.stack([[m[i::4, j::4] for i in range(4) for j in range(4)] for m in mosaics]).astype(np.float32)


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--epochs", type=int, default=2)
    arguments = parser.parse_args()
    pairs = NoisyPairs(polarized_ramps(64), "imx250myr-simulated")
    loader = torch.utils.data.DataLoader(pairs, batch_size=8, shuffle=True, num_workers=arguments.workers)
    for epoch in range(arguments.epochs):
        pairs.epoch = epoch  # workers start anew with every epoch and see it
        start, squares = time.perf_counter(), []
        for noisy, clean in loader:
            squares.append(torch.mean((noisy - clean) ** 2).item())
        seconds = time.perf_counter() - start
        print(f"epoch {epoch}: {len(pairs)} pairs of 16x64x64 in {seconds:.2f} s, noise sd {np.mean(squares) ** 0.5:.1f} DN")


if __name__ == "__main__":
    main()
