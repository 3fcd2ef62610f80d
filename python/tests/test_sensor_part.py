"""A frame that is a part of the calibrated sensor."""

import warnings

import numpy as np
import pytest
from PIL import Image

malus = pytest.importorskip("malus", reason="the Python module is not built (pybind11 is missing)")

ROWS, COLS, BLACK, WHITE, HOT = 64, 96, 80, 4095, (41, 50)


def taken(rng, electrons):
    dn = BLACK + 0.5 * rng.poisson(electrons, (ROWS, COLS)) + rng.normal(0, 1.5, (ROWS, COLS))
    dn[HOT] += 300
    return np.clip(np.round(dn), 0, WHITE).astype(np.uint16)


def test_origin_tells_where_it_lies(tmp_path):
    rng = np.random.default_rng(3)
    text = f'[sensor]\nlayout = "polar-mono"\nblack = {BLACK}\nwhite = {WHITE}\nrow_group = 2\n'
    for level in range(4):
        for n in range(4 if level else 20):
            Image.fromarray(taken(rng, 700.0 * level)).save(tmp_path / f"{level}_{n}.png")
        kind = "flat" if level else "bias"
        text += f'[[frames]]\nkind = "{kind}"\nexposure_s = {level / 100 + 1e-4}\ngain_db = 0\npaths = ["{level}_*.png"]\n'
    (tmp_path / "s.toml").write_text(text)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of few levels
        model = malus.calibrate(tmp_path / "s.toml")
    part = taken(rng, 400.0)[20:60, 30:90]
    given = dict(model=model, gain=0, method="vst-bm3d")
    with pytest.warns(match="60 x 40 pixels of a sensor of 96 x 64: the model's 1 defect pixel and"):
        assert malus.denoise(part, **given)["defect_pixels"] == 0
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        told = malus.denoise(part, origin=(20, 30), **given)
    assert told["defect_pixels"] == 1 and abs(told["dn"][HOT[0] - 20, HOT[1] - 30] - 200) < 40
    with pytest.raises(malus.InputError, match="not a multiple of 2 rows and 2 columns"):
        malus.denoise(part, origin=(21, 30), **given)
    with pytest.raises(malus.InputError, match="reach beyond the model's sensor"):
        malus.denoise(part, origin=(30, 30), **given)
