"""Weight files for tests, written without malus: the layers of a See-in-the-Dark U-Net by name and shape, and the format."""

import json

import numpy as np

POLAR_CHANNELS = ["R90", "R45", "G1_90", "G1_45", "R135", "R0", "G1_135", "G1_0",
                  "G2_90", "G2_45", "B90", "B45", "G2_135", "G2_0", "B135", "B0"]


def unet_shapes(channels_in, channels_out, width):
    shapes, size = {}, channels_in
    for level in range(1, 6):
        for part in (1, 2):
            shapes[f"conv{level}_{part}"] = (width << (level - 1), size, 3, 3)
            size = width << (level - 1)
    for level in range(6, 10):
        half = size // 2
        shapes[f"upv{level}"] = (size, half, 2, 2)
        shapes[f"conv{level}_1"], shapes[f"conv{level}_2"] = (half, size, 3, 3), (half, half, 3, 3)
        size = half
    shapes["conv10_1"] = (channels_out, size, 1, 1)
    return shapes


def unet_weights(channels_in, channels_out, width, scale=0.0, seed=1):
    """Normal weights of deviation scale / sqrt(fan in); 0 gives a network that returns 0."""
    rng, tensors = np.random.default_rng(seed), {}
    for name, shape in unet_shapes(channels_in, channels_out, width).items():
        fan_in = shape[0] if name.startswith("upv") else np.prod(shape[1:])
        tensors[f"{name}.weight"] = rng.normal(0, 1, shape) * scale / np.sqrt(fan_in)
        biases = shape[1] if name.startswith("upv") else shape[0]
        tensors[f"{name}.bias"] = rng.normal(0, 0.1, biases) * scale
    return {name: tensor.astype(np.float32) for name, tensor in tensors.items()}


def write_safetensors(path, tensors, metadata):
    header, offset = {"__metadata__": metadata}, 0
    for name, tensor in sorted(tensors.items()):
        header[name] = {"dtype": "F32", "shape": list(tensor.shape), "data_offsets": [offset, offset + tensor.nbytes]}
        offset += tensor.nbytes
    text = json.dumps(header).encode()
    with open(path, "wb") as file:
        file.write(len(text).to_bytes(8, "little") + text)
        for _, tensor in sorted(tensors.items()):
            file.write(np.ascontiguousarray(tensor, "<f4").tobytes())


def unet_package(path, scale=0.0, width=4, change=lambda tensors, metadata: None, channels=POLAR_CHANNELS, **package):
    """A U-Net for polar-bayer-rggb (or another layout with as many channels) as a network package."""
    settings = {"layout": "polar-bayer-rggb", "domain": "linear", "noise_input": "none", "guide": "none",
                "guide_profile": "fast", "amplification": "auto", "residual": True, "row_noise": False, "remove_bias": True, **package}
    planes = len(channels)
    inputs = planes * (1 + (settings["guide"] != "none"))
    if settings["noise_input"] == "level":
        inputs += 1 if settings["domain"] == "stabilised" else planes
    metadata = {"architecture": "unet",
                "settings": json.dumps({"in_channels": inputs, "out_channels": planes, "width": width}),
                "malus_package": json.dumps({"version": 1, "settings": settings, "channels": channels, "training": None})}
    tensors = unet_weights(inputs, planes, width, scale)
    change(tensors, metadata)
    write_safetensors(path, tensors, metadata)
    return path
