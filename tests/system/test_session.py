"""Sessions that frames of their own black level are part of, and sessions that are not what they say."""

import numpy as np
import pytest
from PIL import Image

CAMERA = {0: (80, 0.1), 24: (100, 1.6)}  # gain in dB: black level in DN, K in DN/e-


def save(rng, path, gain, light):
    black, K = CAMERA[gain]
    dn = black + K * rng.poisson(light / K, (96, 96)) + rng.normal(0, 3, (96, 96))
    tag = f"[malus layout=mono black={black} white=4095 gain_db={gain}]"
    Image.fromarray(np.clip(np.round(dn), 0, 4095).astype(np.uint16)).save(path, description=tag)


def test_a_black_level_that_differs_between_gains_is_counted_once(malus, tmp_path):
    """A signal of 50 DN came out as 70 at the gain whose files tell 20 DN less than those of the highest gain."""
    rng = np.random.default_rng(3)
    text = '[sensor]\nlayout = "mono"\nrow_group = 1\n'
    for gain in CAMERA:
        for n in range(8):
            save(rng, tmp_path / f"b{gain}_{n}.tif", gain, 0)
        text += f'[[frames]]\nkind = "bias"\nexposure_s = 0\npaths = ["b{gain}_*.tif"]\n'
        for level in range(1, 6):
            for n in range(2):
                save(rng, tmp_path / f"f{gain}_{level}_{n}.tif", gain, 300 * level)
            text += f'[[frames]]\nkind = "flat"\nlevel = {level}\npaths = ["f{gain}_{level}_*.tif"]\n'
        save(rng, tmp_path / f"scene{gain}.tif", gain, 50)
    (tmp_path / "s.toml").write_text(text)
    run = malus("calibrate", tmp_path / "s.toml", "-o", tmp_path / "m.h5")
    assert "its files tell a black level of 80 DN" in run.err
    for gain in CAMERA:
        malus("denoise", tmp_path / f"scene{gain}.tif", "--model", tmp_path / "m.h5", "-o", tmp_path)
        # The pixels' own scatter, √(50 K + 9) / 96, and the bias's error.
        assert np.array(Image.open(tmp_path / f"scene{gain}_denoised.tif")).mean() == pytest.approx(50, abs=0.5)


def test_the_same_data_twice_is_refused(refused, tmp_path):
    rng = np.random.default_rng(4)
    for n in range(4):
        save(rng, tmp_path / f"b{n}.tif", 0, 0)
    (tmp_path / "s.toml").write_text('[[frames]]\nkind = "bias"\npaths = ["b*.tif"]\n'
                                     '[[frames]]\nkind = "flat"\npaths = ["b3.tif"]\n')
    assert "b3.tif, of bias frames already" in refused("calibrate", tmp_path / "s.toml", "-o", tmp_path / "m.h5")
    (tmp_path / "s.toml").write_text('[[frames]]\nkind = "bias"\npaths = ["b*.tif"]\n')
    (tmp_path / "b4.tif").symlink_to("b2.tif")
    assert "b4.tif, the same file as" in refused("calibrate", tmp_path / "s.toml", "-o", tmp_path / "m.h5")
    (tmp_path / "b4.tif").unlink()
    (tmp_path / "b4.tif").write_bytes((tmp_path / "b2.tif").read_bytes())
    line = refused("calibrate", tmp_path / "s.toml", "-o", tmp_path / "m.h5")
    assert "b4.tif: has the same pixels as" in line and "b2.tif" in line


def test_a_picture_is_no_session_file(refused, examples, tmp_path):
    """Its first byte had been called invalid UTF-8, to be corrected in the TOML."""
    told = refused("calibrate", examples / "imx250mzr/fruits.png", "-o", tmp_path / "m.h5")
    assert told.endswith("fruits.png: holds no text; give the session file, a TOML file")
