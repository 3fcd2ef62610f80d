"""A camera whose columns are lifted anew in every frame, from its calibration to a denoised frame. Truth: the camera's own numbers."""

import json

import h5py
import numpy as np
import pytest
from conftest import needs_networks
from PIL import Image
from weight_files import unet_package

ROWS, COLS, BLACK, WHITE, K, READ, COLUMN = 192, 256, 80, 4095, 0.5, 2.0, 2.0
LIGHT = 60.0


def taken(rng, signal_dn, column_dn):
    """A frame, and what lifted its columns."""
    offsets = rng.normal(0, column_dn, COLS)
    dn = BLACK + K * rng.poisson(signal_dn / K) + rng.normal(0, READ, (ROWS, COLS)) + offsets
    return np.clip(np.round(dn), 0, WHITE).astype(np.uint16), offsets


def calibrated(malus, folder, column_dn):
    rng = np.random.default_rng(3)
    text = f'[sensor]\nlayout = "polar-bayer-rggb"\nblack = {BLACK}\nwhite = {WHITE}\nrow_group = 2\n'
    for level in range(6):
        for n in range(2 if level else 20):
            Image.fromarray(taken(rng, np.full((ROWS, COLS), 500.0 * level), column_dn)[0]).save(folder / f"{level}_{n}.png")
        text += f'[[frames]]\nkind = "{"flat" if level else "bias"}"\nexposure_s = {level / 100 + 1e-4}\ngain_db = 0\npaths = ["{level}_*.png"]\n'
    (folder / "s.toml").write_text(text)
    return malus("calibrate", folder / "s.toml", "-o", folder / "m.h5")


@pytest.fixture(scope="module")
def camera(malus, tmp_path_factory):
    """Its model, and a frame of even light with the offsets of its columns."""
    folder = tmp_path_factory.mktemp("camera")
    assert "denoise takes their offsets out" in calibrated(malus, folder, COLUMN).err
    dn, offsets = taken(np.random.default_rng(8), np.full((ROWS, COLS), LIGHT), COLUMN)
    Image.fromarray(dn).save(folder / "raw.png")
    return folder, offsets


def denoised(malus, folder, out, *flags, frame="raw.png"):
    done = malus("denoise", folder / frame, "--model", folder / "m.h5", "--gain", 0, "-o", out, "--format", "npy", "--profile", "fast",
                 "--force", *flags)
    name = frame.rsplit(".", 1)[0]
    return done, np.load(out / f"{name}_denoised.npy"), json.loads((out / f"{name}_denoised.json").read_text())["run"]


def test_the_read_noise_holds_what_the_columns_have(malus, camera):
    """So synthesis, which draws none, keeps their variance (level: 5 standard errors and 2 %)."""
    with h5py.File(camera[0] / "m.h5") as model:
        column, error = (model[f"physics/000/sigma_column/{name}"][:] for name in ("mean", "standard_error"))
    assert np.all(np.abs(column - COLUMN) < 5 * error + 0.02 * COLUMN)
    read = malus("model", "show", camera[0] / "m.h5", "--json").json["gains"][0]["read_noise"]["value"]
    assert np.mean(read) * K == pytest.approx(np.hypot(READ, COLUMN), rel=0.03)


def test_columns_are_taken_out_and_recorded(malus, camera, tmp_path):
    folder, offsets = camera
    (said, out, run), (_, left, kept) = denoised(malus, folder, tmp_path), denoised(malus, folder, tmp_path / "kept", "--no-column-noise")
    assert run["column_noise_removed_dn"] == pytest.approx(COLUMN, rel=0.2) and "and column noise " in said.out
    assert kept["column_noise_removed_dn"] == 0 and kept["settings"]["column_noise"] is False
    assert np.std(left.mean(0)) > 0.6 * np.std(offsets) and np.std(out.mean(0)) < 0.3 * np.std(offsets)
    assert np.mean((out - LIGHT) ** 2) < 0.15 * np.mean((left - LIGHT) ** 2)


def test_what_the_columns_leave_is_stated(malus, camera, tmp_path):
    """Of DoLP, which is 0: its mean square is the stated one of S1 and S2, over that of S0, or less (even light: docs/denoising.md)."""
    folder, _ = camera
    stated = {}
    for flag in ("--column-noise", "--no-column-noise"):
        out = tmp_path / flag
        denoised(malus, folder, out, flag, "--uncertainty")
        malus("stokes", out / "raw_denoised.npy", "--variance", out / "raw_variance.exr", "-o", out, "--layout", "polar-bayer-rggb",
              "--format", "npy", "--no-pictures")
        dolp, sd = (np.load(out / f"raw_denoised_{name}.npy") for name in ("dolp", "dolp_sd"))
        assert np.mean(dolp**2) < 2 * np.mean(sd**2)
        stated[flag] = np.median(sd)
    assert stated["--no-column-noise"] > 2 * stated["--column-noise"]


def test_a_frame_of_synthesis_is_denoised_with_the_whole_read_noise(malus, camera, tmp_path):
    """Its columns are even and its pixels have their variance: nothing is taken off, whatever the flag says."""
    folder, _ = camera
    np.save(tmp_path / "clean.npy", np.full((ROWS, COLS), LIGHT, np.float32))
    malus("synthesize", tmp_path / "clean.npy", "--model", folder / "m.h5", "--layout", "polar-bayer-rggb", "--gain", 0, "-o", tmp_path / "drawn")
    drawn = next((tmp_path / "drawn").glob("*.tif"))
    (folder / "drawn.tif").write_bytes(drawn.read_bytes())
    levels = ("--black", BLACK, "--white", WHITE)
    _, out, run = denoised(malus, folder, tmp_path, *levels, frame="drawn.tif")
    _, same, _ = denoised(malus, folder, tmp_path / "same", "--no-column-noise", *levels, frame="drawn.tif")
    assert run["column_noise_removed_dn"] == 0 and np.array_equal(out, same)
    assert np.mean(run["sigma_used_dn"]) == pytest.approx(np.sqrt(K * LIGHT + READ**2 + COLUMN**2), rel=0.03)


def test_a_camera_without_them_is_as_it_was(malus, tmp_path):
    calibrated(malus, tmp_path, 0)
    Image.fromarray(taken(np.random.default_rng(8), np.full((ROWS, COLS), LIGHT), COLUMN)[0]).save(tmp_path / "raw.png")
    (said, out, run), (_, same, _) = denoised(malus, tmp_path, tmp_path / "a"), denoised(malus, tmp_path, tmp_path / "b", "--no-column-noise")
    assert run["column_noise_removed_dn"] == 0 and "column noise" not in said.out and np.array_equal(out, same)


@needs_networks
def test_networks_get_frames_without_them(malus, camera, tmp_path):
    """One that gives back what it gets."""
    folder, offsets = camera
    weights = unet_package(tmp_path / "w.safetensors")
    flat = {}
    for flag in ("--column-noise", "--no-column-noise"):
        malus("denoise", folder / "raw.png", "--method", weights, "--model", folder / "m.h5", "--gain", 0, "--format", "npy", flag, "-o",
              tmp_path / flag)
        flat[flag] = np.load(tmp_path / flag / "raw_denoised.npy").mean(0)
    assert np.std(flat["--no-column-noise"]) > 0.9 * np.std(offsets) and np.std(flat["--column-noise"]) < 0.35 * np.std(offsets)
