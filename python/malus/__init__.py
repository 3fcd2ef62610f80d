"""Measure a camera's noise, imitate it and remove it.

    import malus
    model = malus.Model("imx250myr-simulated")
    noisy = model.synthesize(clean, gain=24, seed=1)          # NumPy array, or a torch tensor on the CPU
    result = malus.denoise(malus.load_frame("raw.png", layout="polar-bayer-rggb", black=82), model=model, gain=24)
    dolp = malus.stokes(result["dn"], layout="polar-bayer-rggb")["dolp"]

Arrays are [row, column] mosaics or [channel, row, column] packed planes, float32, in DN above the black level unless said
otherwise. The same seed, frame and pixel give the same noise for any number of threads. Bad input raises malus.InputError
(a ValueError): what is wrong with what, and what to do.
"""

import os as _os

# GCC's OpenMP, which LibRaw brings along, reads this when it is loaded (apps/doors/network_environment.cpp says what for).
if _os.getloadavg()[0] > (_os.cpu_count() or 1) and "OMP_WAIT_POLICY" not in _os.environ:
    _os.environ.setdefault("GOMP_SPINCOUNT", "1000")

from ._malus import (
    Frame,
    FrameGroup,
    FrameSet,
    InputError,
    Model,
    Noise,
    Session,
    __version__,
    average,
    calibrate,
    check_layout,
    compare_noise,
    denoise,
    estimate_noise,
    evaluate,
    frames,
    info,
    jsd_bits,
    kld_nats,
    layouts,
    load_frame,
    models,
    mosaic,
    normals,
    pack,
    renoise,
    set_threads,
    simulate,
    stokes,
    unpack,
)

__all__ = [
    "Frame",
    "FrameGroup",
    "FrameSet",
    "InputError",
    "Model",
    "Noise",
    "Session",
    "average",
    "calibrate",
    "check_layout",
    "compare_noise",
    "denoise",
    "estimate_noise",
    "evaluate",
    "frames",
    "info",
    "jsd_bits",
    "kld_nats",
    "layouts",
    "load_frame",
    "models",
    "mosaic",
    "normals",
    "pack",
    "renoise",
    "set_threads",
    "simulate",
    "stokes",
    "unpack",
]
