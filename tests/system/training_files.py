"""What tests of `malus train` train on: a small configuration with a scene beside it, a clean mosaic; the files it writes."""

import json
import struct

import numpy as np
import pytest
from PIL import Image

SMALL_NETWORK = """
[network]
architecture = "unet"
width = 4
levels = 2
[package]
layout = "polar-mono"
"""
CONFIG = SMALL_NETWORK + """noise_input = "units"
[data]
scenes = ["scene"]
example = 64
patch = 32
pool = 3
refresh = 0.5
[noise]
models = ["imx250mzr-simulated"]
gains = [6, 12]
ratio_low = 5
ratio_high = 20
jitter = 0.2
[train]
steps = {steps}
batch = 4
warm_up = 5
learning_rate = 1e-3
checkpoint_every = {checkpoint_every}
log_every = 1
timeout = 20
"""


@pytest.fixture
def config(tmp_path):
    """config(steps): a configuration beside four pictures of a smooth scene, polarized at 20 degrees."""
    (tmp_path / "scene").mkdir()
    rows, cols = np.mgrid[0:80, 0:96]
    light = 0.4 + 0.3 * np.sin(rows / 9) * np.cos(cols / 7)
    for angle in (0, 45, 90, 135):
        seen = 0.5 * light * (1 + 0.5 * np.cos(2 * np.radians(angle - 20)))
        Image.fromarray((seen * 65535).astype(np.uint16)).save(tmp_path / "scene" / f"I{angle}.png")

    def write(steps, checkpoint_every=2, text=CONFIG):
        path = tmp_path / "config.toml"
        path.write_text(text.format(steps=steps, checkpoint_every=checkpoint_every))
        return path

    return write


@pytest.fixture
def clean(tmp_path):
    rows, cols = np.mgrid[0:256, 0:192]
    np.save(tmp_path / "clean.npy", (1500 + 900 * np.sin(rows / 31) * np.cos(cols / 23)).astype(np.float32))
    return tmp_path / "clean.npy"


def tensors(path):
    """A safetensors file by its specification: {name: array}, metadata."""
    data = path.read_bytes()
    size = struct.unpack("<Q", data[:8])[0]
    header = json.loads(data[8 : 8 + size])
    metadata = header.pop("__metadata__")
    body = data[8 + size :]
    return {
        name: np.frombuffer(body[slice(*entry["data_offsets"])], np.float32).reshape(entry["shape"])
        for name, entry in header.items()
    }, metadata


def same(one, other):
    a, b = tensors(one)[0], tensors(other)[0]
    assert a.keys() == b.keys()
    return all(np.array_equal(a[name], b[name]) for name in a)
