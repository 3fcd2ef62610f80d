"""Measure a camera's noise, imitate it and remove it.

    import malus
    model = malus.Model("imx250myr-simulated")
    noisy = model.synthesize(clean, gain=24, seed=1)          # NumPy array, or a torch tensor on the CPU
    result = malus.denoise(malus.load_frame("raw.png", layout="polar-bayer-rggb", black=82), model=model, gain=24)
    dolp = malus.stokes(result["dn"], layout="polar-bayer-rggb")["dolp"]

Arrays are [row, column] mosaics or [channel, row, column] packed planes, float32, in DN above the black level unless said
otherwise. The same seed, frame and pixel give the same noise for any number of threads. Bad input raises malus.InputError
(a ValueError) with the words that the command line prints.
"""

from ._malus import (
    Frame,
    FrameGroup,
    InputError,
    Model,
    Noise,
    Session,
    __version__,
    calibrate,
    compare_noise,
    denoise,
    evaluate,
    jsd_bits,
    kld_nats,
    layouts,
    load_frame,
    set_threads,
    stokes,
)

__all__ = [
    "Frame",
    "FrameGroup",
    "InputError",
    "Model",
    "Noise",
    "Session",
    "calibrate",
    "compare_noise",
    "denoise",
    "evaluate",
    "jsd_bits",
    "kld_nats",
    "layouts",
    "load_frame",
    "set_threads",
    "stokes",
]
