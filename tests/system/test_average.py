"""Means of several frames of a scene: made by `average`, taken by denoise and stokes for what they are."""

import numpy as np
import pytest

from test_confidence import GAIN_DB, MODEL, SIDE, camera, planes  # noqa: F401  (camera is a fixture)
from test_levels import mosaic

FRAMES = 8
MODEL_AT = (*MODEL, "--gain", GAIN_DB)


def light(side=SIDE):
    """A slope with an edge, in DN above black."""
    return mosaic(side=side) * (0.2 + 0.6 * np.arange(side) / side + 0.4 * (np.arange(side)[:, None] > side // 2))


def burst(camera, folder, frames=FRAMES, bright=1.0, moved=0, type_=np.uint16):  # noqa: F811
    """Shot noise, read noise and row noise of some camera whose K and bias are the model's, one file a frame."""
    random = np.random.default_rng(5)
    folder.mkdir()
    rows = 0.15  # as the model's rows [DN]; all but nothing
    for i in range(frames):
        clean = bright * np.roll(light(), moved if i >= frames // 2 else 0, axis=1)
        dn = camera["gain"] * random.poisson(clean / camera["gain"]) + random.normal(0, camera["read"], clean.shape)
        dn += rows * random.normal(size=(SIDE, 1)) + camera["black"] + np.tile(camera["bias"], (SIDE // 2, SIDE // 2))
        np.save(folder / f"{i}.npy", np.clip(np.round(dn), 0, 4095).astype(type_))
    return sorted(folder.iterdir())


@pytest.fixture
def noisy_camera(malus, camera):  # noqa: F811
    gain = malus("model", "show", MODEL[1], "--gain", GAIN_DB, "--json").json["gains"][0]
    sigma, shape = np.mean(gain["sigma_tl"]["mean"]), np.mean(gain["lambda"]["mean"])
    # Variance of a Tukey-lambda law (Joiner and Rosenblatt, 1971), by Gauss-Legendre of its quantile function.
    u, weight = np.polynomial.legendre.leggauss(2000)
    u = 0.5 * (u + 1)
    quantile = (u**shape - (1 - u) ** shape) / shape
    return camera | {"read": sigma * np.sqrt(0.5 * np.sum(weight * quantile**2))}


def test_a_mean_is_denoised_by_the_noise_that_is_left(malus, noisy_camera, tmp_path):
    files = burst(noisy_camera, tmp_path / "burst")
    taken = ("--layout", "polar-mono", "--white", 4095, "--gain", GAIN_DB)
    black = noisy_camera["black"]
    made = malus("average", *files, *taken, "--black", black, "-o", tmp_path / "mean.tif", "--json").json
    assert made["frames"] == FRAMES and made["changed_share"] < 0.002
    np.save(tmp_path / "clean.npy", light().astype(np.float32))
    clean = ("--reference", tmp_path / "clean.npy", "--json")
    one = malus("denoise", files[0], *MODEL_AT, "--black", black, "-o", tmp_path / "one", *clean)
    # The file tells all but the model.
    mean = malus("denoise", tmp_path / "mean.tif", *MODEL, "-o", tmp_path / "out", "--uncertainty", *clean)
    assert "its noise is" not in mean.err and "black level" not in mean.err
    assert mean.json["mean_of"] == FRAMES and one.json["mean_of"] == 1
    assert np.mean(mean.json["sigma_used_dn"]) == pytest.approx(np.mean(one.json["sigma_used_dn"]) / np.sqrt(FRAMES), rel=0.05)
    assert mean.json["against_reference"]["after"]["image_psnr"] > one.json["against_reference"]["after"]["image_psnr"] + 3

    # A mean of one's own, and what is not said of it.
    np.save(tmp_path / "own.npy", np.mean([np.load(f) for f in files], axis=0).astype(np.float32))
    own = malus("denoise", tmp_path / "own.npy", *MODEL_AT, "--white", 4095, "--mean-of", FRAMES, "-o", tmp_path / "own", "--format", "npy")
    assert "its noise is" not in own.err and "black level" not in own.err
    untold = malus("denoise", tmp_path / "own.npy", *MODEL_AT, "--black", black, "-o", tmp_path / "untold")
    assert "--mean-of" in untold.err and "its noise is" in untold.err


def test_stated_errors_of_a_mean_are_true(malus, noisy_camera, tmp_path):
    files = burst(noisy_camera, tmp_path / "burst")
    malus("average", *files, "--layout", "polar-mono", "--black", noisy_camera["black"], "--white", 4095, "-o", tmp_path / "mean.fits")
    malus("stokes", tmp_path / "mean.fits", *MODEL_AT, "--format", "npy", "--no-pictures", "-o", tmp_path)
    s0, s0_sd, s1, s1_sd = planes(tmp_path, "mean", "s0", "s0_sd", "s1", "s1_sd")
    clean = light().reshape(SIDE // 2, 2, SIDE // 2, 2)
    truth = 0.5 * clean.sum((1, 3)), clean[:, 1, :, 1] - clean[:, 0, :, 0]
    # Of 4096 cells: ±2.2 %.
    for value, stated, true in ((s0, s0_sd, truth[0]), (s1, s1_sd, truth[1])):
        assert np.mean(((value - true) / stated) ** 2) == pytest.approx(1, abs=0.12)


def test_a_scene_that_moved_is_told(malus, camera, tmp_path):  # noqa: F811
    camera["read"] = 2.0
    taken = ("--layout", "polar-mono", "--black", camera["black"], "--white", 4095)
    still = malus("average", *burst(camera, tmp_path / "still"), *taken, "-o", tmp_path / "still.tif")
    assert "move" not in still.err
    moved = malus("average", *burst(camera, tmp_path / "moved", moved=8), *taken, "-o", tmp_path / "moved.tif")
    assert "did scene or camera move?" in moved.err


def test_what_is_cut_off_at_0_is_told(malus, camera, tmp_path):  # noqa: F811
    camera |= {"read": 4.0, "black": 2.0, "bias": np.zeros((2, 2))}
    files = burst(camera, tmp_path / "dark", bright=0.01)
    made = malus("average", *files, "--layout", "polar-mono", "--black", 2, "-o", tmp_path / "mean.tif")
    assert "too bright" in made.err


def test_what_is_no_burst_is_refused(malus, refused, misused, camera, tmp_path):  # noqa: F811
    camera["read"] = 2.0
    files = burst(camera, tmp_path / "burst", frames=3)
    out = ("-o", tmp_path / "mean.tif")
    assert "one frame" in refused("average", files[0], *out)
    np.save(tmp_path / "other.npy", np.zeros((8, 8), np.uint16))
    assert "other.npy" in refused("average", files[0], tmp_path / "other.npy", *out)
    assert "is given twice" in refused("average", *files, tmp_path / "burst" / ".." / "burst" / files[0].name, *out)
    np.save(tmp_path / "copy.npy", np.load(files[0]))
    assert "copy.npy: has the same pixels as" in refused("average", *files, tmp_path / "copy.npy", *out)
    assert "no floating-point values" in misused("average", *files, "-o", tmp_path / "mean.png")
    assert not (tmp_path / "mean.tif").exists()
    assert "is an input" in refused("average", *files, "-o", files[0], "--force")
    malus("average", *files, "--layout", "polar-mono", "--black", camera["black"], *out)
    assert "--force" in refused("average", *files, *out)
    assert "mean of 3 frames" in refused("average", tmp_path / "mean.tif", files[0], "-o", tmp_path / "more.tif")
    assert "mean of 3" in refused("renoise", tmp_path / "mean.tif", *MODEL, "--from", GAIN_DB, "--to", 30, "-o", tmp_path)
    assert "mean of" in malus("info", tmp_path / "mean.tif").out
    npy = malus("average", *files, "--layout", "polar-mono", "--black", camera["black"], "-o", tmp_path / "mean.npy")
    assert "white level not known; what is saturated in some" in npy.err and "black level not known" not in npy.err
    assert "--mean-of 3" in npy.err
