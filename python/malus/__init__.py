"""Measure a camera's noise, imitate it and remove it.

    import malus
    model = malus.Model("imx250myr-simulated")
    noisy = model.synthesize(clean, gain=24, seed=1)          # NumPy array, or a torch tensor through .numpy()
    result = malus.denoise(raw, layout="polar-bayer-rggb", black=82, white=4095, model=model, gain=24)
    dolp = malus.stokes(result["dn"], layout="polar-bayer-rggb")["dolp"]

Arrays are [row, column] mosaics or [channel, row, column] packed planes, float32, in DN above the black level unless said
otherwise. The same seed, frame and pixel give the same noise for any number of threads. Bad input raises malus.InputError
(a ValueError) with the words that the command line prints.
"""

from ._malus import (  # noqa: F401
    Frame,
    InputError,
    Model,
    calibrate,
    denoise,
    evaluate,
    jsd_bits,
    kld_nats,
    layouts,
    load_frame,
    set_threads,
    stokes,
)

__all__ = [name for name in dir() if not name.startswith("_")]
