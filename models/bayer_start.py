#!/usr/bin/env python3
"""A U-Net that knows a guide, from one of the same levels that does not: what models/bayer.toml began with.

    /usr/bin/python3 models/bayer_start.py WITHOUT_GUIDE NEW START

WITHOUT_GUIDE: weights of width W (5 inputs: noisy planes, noise). NEW: any weights of width W + 8 with guide (9 inputs: guide,
noisy - guide, noise), as `malus train` writes after one step. START gets NEW's description and the function of WITHOUT_GUIDE: to
take and give the noisy planes it sees guide + difference, and eight channels carry the difference, rectified both ways, past all
other layers of the first level to the output, for a guided network gives what is added to the guide. The values that are new in
deeper levels are drawn small, with no way into the old ones.
"""
import json
import struct
import sys

import numpy as np

PLANES, CARRIED = 4, 8
SEEN_DEVIATIONS = 8.0  # of neural/package.cpp: noisy planes are seen divided by it, the difference is not
LEAK = 0.2             # of the U-Net's rectifiers
LAYERS = "conv1_2 conv2_1 conv2_2 conv3_1 conv3_2 upv4 upv5 conv4_1 conv4_2 conv5_1 conv5_2 conv6_1".split()  # the order of the draws


def load(path):
    data = open(path, "rb").read()
    size = struct.unpack("<Q", data[:8])[0]
    header = json.loads(data[8:8 + size])
    values = data[8 + size:]
    meta = header.pop("__metadata__")
    return meta, {name: np.frombuffer(values[slice(*entry["data_offsets"])], "<f4").reshape(entry["shape"]).copy() for name, entry in header.items()}


def save(path, meta, tensors):
    header, values = {"__metadata__": meta}, b""
    for name, tensor in tensors.items():
        raw = tensor.astype("<f4").tobytes()
        header[name] = {"dtype": "F32", "shape": list(tensor.shape), "data_offsets": [len(values), len(values) + len(raw)]}
        values += raw
    text = json.dumps(header).encode()
    text += b" " * (-len(text) % 8)
    open(path, "wb").write(struct.pack("<Q", len(text)) + text + values)


def carry(weight, first_from, first_to):
    """The rectified differences at first_from become those at first_to: d = (r(d) - r(-d)) / (1 + LEAK)."""
    for plane in range(PLANES):
        for half, sign in enumerate((1, -1)):
            to, at = first_to + 2 * plane + half, first_from + 2 * plane
            weight[to, at, 1, 1], weight[to, at + 1, 1, 1] = sign / (1 + LEAK), -sign / (1 + LEAK)


def widened(old, new):
    random = np.random.default_rng(1)
    width = old["conv1_1.bias"].size
    wide = width + CARRIED
    for tensor in new.values():
        tensor[...] = 0
    for name, tensor in old.items():
        if name.endswith(".bias"):
            new[name][:tensor.size] = tensor
    first, before = new["conv1_1.weight"], old["conv1_1.weight"]
    first[:width, :PLANES] = before[:, :PLANES]
    first[:width, PLANES:2 * PLANES] = before[:, :PLANES] / SEEN_DEVIATIONS
    first[:width, 2 * PLANES] = before[:, PLANES]
    for plane in range(PLANES):
        first[width + 2 * plane, PLANES + plane, 1, 1], first[width + 2 * plane + 1, PLANES + plane, 1, 1] = 1, -1
    for layer in LAYERS:
        tensor, to = old[layer + ".weight"], new[layer + ".weight"]
        if layer.startswith("upv"):  # [in, out, 2, 2]
            to[:tensor.shape[0], :tensor.shape[1]] = tensor
            to[:, tensor.shape[1]:] = random.normal(0, 0.3 / np.sqrt(to.shape[0]), to[:, tensor.shape[1]:].shape)
            continue
        rows, half = tensor.shape[0], tensor.shape[1] // 2
        if layer in ("conv4_1", "conv5_1"):  # two joined inputs
            to[:rows, :half], middle = tensor[:, :half], to.shape[1] // 2
            to[:rows, middle:middle + half] = tensor[:, half:]
        else:
            to[:rows, :tensor.shape[1]] = tensor
        if layer[4] in "234":
            fan_in = np.prod(to.shape[1:])
            to[rows:] = random.normal(0, 0.3 * np.sqrt(2 / (1 + LEAK**2) / fan_in), to[rows:].shape)
    carry(new["conv1_2.weight"], width, width)
    carry(new["conv5_1.weight"], wide + width, width)
    carry(new["conv5_2.weight"], width, width)
    for plane in range(PLANES):
        new["conv6_1.weight"][plane, width + 2 * plane:width + 2 * plane + 2, 0, 0] = 1 / (1 + LEAK), -1 / (1 + LEAK)
    return new


if __name__ == "__main__":
    if len(sys.argv) != 4:
        sys.exit(__doc__)
    meta, tensors = load(sys.argv[2])
    save(sys.argv[3], meta, widened(load(sys.argv[1])[1], tensors))
