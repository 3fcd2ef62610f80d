"""A session that tells no gain: calibrate says so where its frames look odd, and who uses its model at a gain says what that gain is taken for."""

import numpy as np
import pytest

from conftest import needs_networks

BLACK, WHITE, K = 100, 4095, 0.5


def taken(rng, light_dn):
    return np.clip(np.round(BLACK + K * rng.poisson(light_dn / K, (64, 64)) + rng.normal(0, 3, (64, 64))), 0, WHITE).astype(np.uint16)


@pytest.fixture(scope="module")
def camera(tmp_path_factory):
    folder = tmp_path_factory.mktemp("camera")
    rng = np.random.default_rng(3)
    np.save(folder / "clean.npy", np.full((64, 64), 500, np.float32))
    np.save(folder / "grey.npy", np.full((64, 64), 0.3, np.float32))
    text = f'[sensor]\nlayout = "mono"\nblack = {BLACK}\nwhite = {WHITE}\nrow_group = 1\n'
    for n in range(20):
        np.save(folder / f"bias_{n}.npy", taken(rng, 0))
    text += '[[frames]]\nkind = "bias"\nexposure_s = 0\nGAIN\npaths = ["bias_*.npy"]\n'
    for level in range(1, 9):
        for n in range(4):
            np.save(folder / f"flat_{level}_{n}.npy", taken(rng, 300 * level))
        text += f'[[frames]]\nkind = "flat"\nexposure_s = {level / 1000}\nGAIN\npaths = ["flat_{level}_*.npy"]\n'
    (folder / "told.toml").write_text(text.replace("GAIN", "gain_db = 12"))
    (folder / "untold.toml").write_text(text.replace("GAIN\n", ""))
    (folder / "pairs.toml").write_text(
        text.split("[[frames]]")[0]
        + '[[frames]]\nkind = "reference"\nexposure_s = 0.008\ngain_db = 6\npaths = ["flat_8_*.npy"]\n'
        + '[[frames]]\nkind = "short"\nexposure_s = 0.001\ngain_db = 6\npaths = ["flat_1_*.npy"]\n')
    return folder


def warnings_of(result):
    return [line for line in result.err.splitlines() if line.startswith("warning:")]


@pytest.fixture
def models(malus, camera):
    for name in ("told", "untold"):
        if not (camera / f"{name}.h5").exists():
            result = malus("calibrate", camera / f"{name}.toml", "-o", camera / f"{name}.h5", "--kind", "physics", "gaussian")
            assert not warnings_of(result)
    return {name: camera / f"{name}.h5" for name in ("told", "untold")}


def test_frames_of_two_gains_that_nobody_told_are_said_to_count_as_of_one(malus, camera):
    rng = np.random.default_rng(4)
    for n in range(4):
        twice = BLACK + 2 * (taken(rng, 1200).astype(int) - BLACK)  # as of 6 dB more
        np.save(camera / f"other_{n}.npy", np.clip(twice, 0, WHITE).astype(np.uint16))
    text = (camera / "untold.toml").read_text() + '[[frames]]\nkind = "flat"\nexposure_s = 0.004\nlevel = 9\npaths = ["other_*.npy"]\n'
    (camera / "two.toml").write_text(text)
    lines = warnings_of(malus("calibrate", camera / "two.toml", "-o", camera / "two.h5"))
    assert len(lines) > 1 and sum("the gain is not told" in line and "give gain_db or iso" in line for line in lines) == 1


def commands(camera, model, out):
    """Every command that asks the model for a gain, and the gains that it is then taken for."""
    frame, clean = camera / "flat_3_0.npy", camera / "clean.npy"
    levels = ["--layout", "mono", "--black", BLACK, "--white", WHITE]
    (out / "plan.toml").write_text(
        f'model = "{model}"\nclean = ["{clean}"]\n[dataset]\nsamples = 2\nshard_size = 2\npatch = 32\ngains = [12]\n')
    return [(["synthesize", clean, "--model", model, "--gain", 12, "-o", out / "s"], "12 dB"),
            (["synthesize", clean, "--model", model, "--kind", "gaussian", "--gain", 12, "-o", out / "g"], "12 dB"),
            (["renoise", frame, "--model", model, "--from", 12, "--to", 12, "-o", out / "r", *levels], "12 dB"),
            (["dataset", out / "plan.toml", "-o", out / "d"], "12 dB"),
            (["evaluate", "--noise", "--reference", frame, camera / "flat_3_1.npy", "--model", model, "--gain", 12, *levels], "12 dB"),
            (["experiment", "denoise", camera / "grey.npy", "--model", model, "--cases", "12:2", "--crop", 64, "--methods", "bm3d/fast"], "12 dB"),
            (["model", "show", model, "--gain", 12], "12 dB")]


def test_whatever_gain_it_is_taken_for_is_said(malus, camera, models, tmp_path):
    for name, model in models.items():
        out = tmp_path / name
        out.mkdir()
        for command, gain in commands(camera, model, out):
            lines = [line for line in warnings_of(malus(*command)) if "does not say its gain" in line]
            assert len(lines) == (name == "untold"), (command, lines)
            assert all(str(model) in line and line.endswith(f"it is taken for {gain}") for line in lines)


def test_a_camera_of_one_gain_is_used_without_a_word(malus, camera, models, tmp_path):
    assert warnings_of(malus("synthesize", camera / "clean.npy", "--model", models["untold"], "-o", tmp_path / "s")) == []


def test_pairs_say_what_gain_a_model_is_taken_for(malus, camera, models, tmp_path):
    lines = warnings_of(malus("pairs", camera / "pairs.toml", "--model", models["untold"], "-o", tmp_path / "p"))
    assert [line for line in lines if line.endswith("does not say its gain; it is taken for 6 dB")], lines


TRAINING = """
[network]
architecture = "unet"
width = 4
levels = 2
[package]
layout = "mono"
[data]
pictures = ["{clean}"]
example = 32
patch = 32
pool = 2
[noise]
models = ["{model}"]
gains = [12]
[validation]
scenes = ["{clean}"]
cases = ["{case}"]
crop = 32
[train]
steps = 1
batch = 2
"""


@needs_networks
@pytest.mark.slow
@pytest.mark.parametrize("case,gains", [("12:2", ["12 dB"]), ("6:2", ["12 dB", "6 dB"])])
def test_training_says_what_gains_of_examples_and_of_validation_are_taken_for(malus, camera, models, tmp_path, case, gains):
    (tmp_path / "net.toml").write_text(TRAINING.format(clean=camera / "grey.npy", model=models["untold"], case=case))
    lines = [line for line in warnings_of(malus("train", tmp_path / "net.toml", "-o", tmp_path / "run")) if "does not say its gain" in line]
    assert [line.rsplit("taken for ", 1)[1] for line in lines] == gains, lines
