"""The examples run as their first lines say, and the data set's workers draw what they should."""

import os
import pathlib
import subprocess
import sys

import numpy as np
import pytest

malus = pytest.importorskip("malus", reason="the Python module is not built (pybind11 is missing)")

EXAMPLES = pathlib.Path(__file__).resolve().parents[2] / "examples/python"
ENVIRONMENT = {**os.environ, "PYTHONPATH": str(pathlib.Path(malus.__file__).parents[1])}


def run(name, *arguments, **options):
    return subprocess.run([sys.executable, EXAMPLES / name, *arguments], check=True, capture_output=True, text=True,
                          env=ENVIRONMENT, timeout=300, **options).stdout


@pytest.fixture
def example():
    pytest.importorskip("torch", reason="needs PyTorch")
    sys.path.insert(0, str(EXAMPLES))
    try:
        import noisy_pairs
        yield noisy_pairs
    finally:
        sys.path.remove(str(EXAMPLES))


def noise_of(example, workers, start=None, epoch=0):
    """The noise of every item of one clean picture, taken twelve times: any two are comparable."""
    import torch
    pairs = example.NoisyPairs(np.repeat(example.polarized_ramps(1, 32, 32), 12, axis=0), "imx250myr-simulated")
    pairs.epoch = epoch
    loader = torch.utils.data.DataLoader(pairs, batch_size=2, num_workers=workers, multiprocessing_context=start)
    return np.concatenate([(noisy - clean).numpy() for noisy, clean in loader])


@pytest.mark.parametrize("start", ["fork", "spawn"])
def test_two_workers_draw_what_one_process_draws(example, start, monkeypatch):
    # The parent's threads exist before it forks.
    malus.Model("imx250myr-simulated").synthesize(np.zeros((1024, 1024), np.float32), gain=12)
    monkeypatch.setenv("PYTHONPATH", ENVIRONMENT["PYTHONPATH"] + os.pathsep + str(EXAMPLES))
    assert np.array_equal(noise_of(example, 2, start), noise_of(example, 0))


def test_no_two_items_have_the_same_noise(example):
    """Correlation of the noise of any two items, of two epochs too: 5 standard errors of 16384 samples."""
    noise = np.concatenate([noise_of(example, 2, "fork", epoch) for epoch in (0, 1)]).reshape(24, 16, -1)
    noise = (noise - noise.mean(axis=2, keepdims=True)) / noise.std(axis=2, keepdims=True)
    correlation = np.corrcoef(noise.reshape(24, -1))
    assert np.abs(correlation - np.eye(24)).max() < 5 / np.sqrt(noise[0].size)


def test_documentation_runs():
    code = (EXAMPLES.parents[1] / "docs/python.md").read_text().split("```python")[1].split("```")[0]
    names = {}
    exec(code, names)
    assert names["batch"].shape == (4, 16, 512, 512)
    assert np.array_equal(names["out"], names["model"].synthesize(names["packed"], gain=None, seed=1, frame=7))


def test_data_set_example_runs(example):
    out = run("noisy_pairs.py", "--workers", "2", "--epochs", "1")
    assert "64 pairs of 16x64x64" in out


def test_notebook_example_makes_its_plots(tmp_path):
    pytest.importorskip("matplotlib", reason="needs matplotlib")
    out = run("frames_to_plots.py", tmp_path)
    assert "K = 0.28" in out
    assert sorted(path.name for path in tmp_path.glob("*.png")) == ["dark_noise.png", "dolp.png", "photon_transfer.png"]
    assert all(path.stat().st_size > 10_000 for path in tmp_path.glob("*.png"))
