"""A camera with a hot and a stuck pixel, from its frames to a denoised one."""

import h5py
import numpy as np
import pytest
from PIL import Image

ROWS, COLS, BLACK, WHITE, K = 96, 120, 80, 4095, 0.5
HOT, STUCK = (41, 50), (60, 71)


def taken(rng, electrons):
    dn = BLACK + K * rng.poisson(electrons) + rng.normal(0, 1.5, (ROWS, COLS))
    dn[HOT] += 300
    dn[STUCK] = WHITE
    return np.clip(np.round(dn), 0, WHITE).astype(np.uint16)


@pytest.fixture(scope="module")
def camera(tmp_path_factory):
    folder = tmp_path_factory.mktemp("camera")
    rng = np.random.default_rng(3)
    text = f'[sensor]\nlayout = "polar-bayer-rggb"\nblack = {BLACK}\nwhite = {WHITE}\nrow_group = 2\n'
    for level in range(7):
        for n in range(4 if level else 20):
            Image.fromarray(taken(rng, np.full((ROWS, COLS), 700.0 * level))).save(folder / f"{level}_{n}.png")
        kind = "flat" if level else "bias"
        text += f'[[frames]]\nkind = "{kind}"\nexposure_s = {level / 100}\ngain_db = 0\npaths = ["{level}_*.png"]\n'
    (folder / "s.toml").write_text(text)
    Image.fromarray(taken(rng, np.full((ROWS, COLS), 400.0))).save(folder / "raw.png")
    return folder


def test_defects_of_the_model_are_filled(malus, camera, tmp_path):
    malus("calibrate", camera / "s.toml", "-o", tmp_path / "m.h5")
    with h5py.File(tmp_path / "m.h5") as model:
        listed = set(zip(model["defects/row"][:].tolist(), model["defects/col"][:].tolist()))
        assert np.isfinite(model["physics/000/K/mean"][:]).all()  # the stuck pixel did not cost it
    assert listed == {HOT, STUCK}
    run = ("denoise", camera / "raw.png", "--model", tmp_path / "m.h5", "--gain", 0, "--format", "npy", "--json")
    assert malus(*run, "-o", tmp_path / "out").json["defect_pixels"] == 2
    dn = np.load(tmp_path / "out" / "raw_denoised.npy").reshape(ROWS, COLS)
    assert abs(dn - 200).max() < 20
    assert malus(*run, "--no-defects", "-o", tmp_path / "left").json["defect_pixels"] == 0
    left = np.load(tmp_path / "left" / "raw_denoised.npy").reshape(ROWS, COLS)
    assert left[HOT] > 300 and left[STUCK] > 4000


def test_a_crop_of_the_sensor_is_left_alone(malus, camera, tmp_path):
    malus("calibrate", camera / "s.toml", "-o", tmp_path / "m.h5")
    Image.open(camera / "raw.png").crop((0, 0, 80, 80)).save(tmp_path / "crop.png")
    done = malus("denoise", tmp_path / "crop.png", "--model", tmp_path / "m.h5", "--gain", 0, "-o", tmp_path / "out", "--json")
    assert done.json["defect_pixels"] == 0
