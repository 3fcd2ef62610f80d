"""Ink (SIDE, SIDE), 0 to 1, of the drawn print among the training data: codes, letters, strokes."""
import numpy as np

SIDE = 512


def dots(random):
    """Ink of squares by chance, as codes have them: some, in a quarter of the calls, far between."""
    side = random.integers(2, 11)
    some = random.choice([0.5, 0.5, 0.5, 0.1])
    return (random.random((SIDE // side + 1,) * 2) < some).repeat(side, 0).repeat(side, 1)[:SIDE, :SIDE].astype(float)


def letters(random):
    """Ink of lines of letters that nobody reads: dots by chance on 5 x 7, the same 26 of them again and again."""
    pixels = random.integers(1, 5)
    alphabet = random.random((27, 7, 5)) < 0.45
    alphabet[26] = False
    gap = random.integers(2, 5)
    rows, cols = SIDE // (pixels * (7 + gap)) + 1, SIDE // (pixels * 6) + 1
    cells = np.zeros((rows, 7 + gap, cols, 6))
    cells[:, :7, :, :5] = alphabet[random.integers(0, 27, (rows, cols))].transpose(0, 2, 1, 3)
    return cells.reshape(rows * (7 + gap), cols * 6).repeat(pixels, 0).repeat(pixels, 1)[:SIDE, :SIDE]


def strokes(random, count, wide):
    ink = np.zeros((SIDE, SIDE))
    for x0, y0, x1, y1 in random.uniform(0, SIDE - wide, (count, 4)):
        steps = np.linspace(0, 1, 2 * SIDE)
        for k in range(wide * wide):
            ink[(y0 + (y1 - y0) * steps).astype(int) + k // wide, (x0 + (x1 - x0) * steps).astype(int) + k % wide] = 1
    return ink


def softened(ink, sigma):
    taps = np.exp(-np.arange(-3, 4) ** 2 / (2 * sigma**2))
    taps /= taps.sum()
    for axis in (0, 1):
        ink = sum(tap * np.roll(ink, k - 3, axis) for k, tap in enumerate(taps))
    return ink


def any_ink(random):
    """In two of five calls as a lens softens it."""
    ink = [dots, letters, lambda r: strokes(r, r.integers(10, 80), r.integers(1, 4))][random.integers(3)](random)
    return softened(ink, random.uniform(0.3, 0.8)) if random.random() < 0.4 else ink


def on_paper(ink, random):
    """Light (SIDE, SIDE, 3): paper, and what ink leaves of it, grey or of a colour each."""
    paper = random.uniform(0.2, 0.95) * (np.ones(3) if random.random() < 0.4 else random.uniform(0.5, 1, 3))
    left = np.exp(random.uniform(np.log(0.04), np.log(0.9))) * (np.ones(3) if random.random() < 0.6 else random.uniform(0.3, 1, 3))
    return paper * (1 + ink[..., None] * (left - 1))
