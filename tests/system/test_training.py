"""`malus train`: what it writes, mistakes in configurations."""

import json
import re

import numpy as np
import pytest

from conftest import needs_networks
from training_files import CONFIG, config, same, tensors  # noqa: F401 (a fixture)

pytestmark = [pytest.mark.slow, needs_networks]


def test_a_run_leaves_weights_log_checkpoint_and_report(malus, config, tmp_path):
    out = tmp_path / "run"
    run = malus("train", config(6), "-o", out, "--json", "--report", tmp_path / "run.html").json
    assert run["steps"] == 6 and run["workers"] == 1
    lines = [json.loads(line) for line in (out / "log.jsonl").read_text().splitlines()]
    assert [line["step"] for line in lines] == [1, 2, 3, 4, 5, 6]
    assert all(np.isfinite(line["loss"]) and line["seconds"] > 0 for line in lines)
    weights, metadata = tensors(out / "weights.safetensors")
    assert metadata["architecture"] == "unet"
    assert weights["conv1_1.weight"].shape == (4, 5, 3, 3)  # four planes and the noise level
    package = json.loads(metadata["malus_package"])
    assert package["training"]["steps"] == 6 and package["training"]["scenes"] == 1
    assert sum(w.size for w in weights.values()) == run["parameters"]
    assert "<html" in (tmp_path / "run.html").read_text()[:2000].lower()
    # The weights denoise.
    frame = np.full((64, 64), 300, np.uint16)
    np.save(tmp_path / "frame.npy", frame)
    malus("denoise", tmp_path / "frame.npy", "--method", out / "weights.safetensors", "--model", "imx250mzr-simulated",
          "--gain", "12", "--black", "82", "--white", "4095", "-o", tmp_path / "denoised")


def test_the_page_shows_what_validation_saw(malus, config, tmp_path):
    text = CONFIG + '[validation]\nscenes = ["scene"]\ncases = ["12:10"]\ncrop = 64\nevery = 3\n'
    told = malus("train", config(6, text=text), "-o", tmp_path / "run", "--report", tmp_path / "run.html").out
    assert [line.split(":")[0] for line in told.splitlines()[-3:]] == ["noisy", "step 3", "step 6"]
    page = (tmp_path / "run.html").read_text(encoding="utf-8")
    report = json.loads(re.search(r'id="malus-report">(.*?)</script>', page, re.S).group(1))
    pictures = [b for b in report["sections"][0]["blocks"] if b["kind"] == "pictures"]
    assert [p["name"] for p in pictures[0]["pictures"]] == ["noisy", "network", "clean"]
    # The clean sample is the scene in DN: the middle 64 pixels of the mosaic of its four pictures.
    clean = np.load(tmp_path / "run" / "sample" / "clean.npy")
    noisy = np.load(tmp_path / "run" / "sample" / "noisy.npy")
    assert clean.shape == noisy.shape == (64, 64)
    assert abs(noisy.mean() / clean.mean() - 1) < 0.05
    assert 0.02 < (noisy - clean).std() / clean.mean() < 1


@pytest.mark.parametrize(
    "old,new,word",
    [
        ('"unet"', '"unnet"', "unet"),
        ('"polar-mono"', '"polar-bayer-rggb"', "layout"),
        ('["scene"]', '["nowhere/*"]', "nowhere"),
        ("width = 4", "depth = 4", "depth"),
        ("patch = 32", "patch = 96", "patch"),
        ('["imx250mzr-simulated"]', '["nobody.h5"]', "nobody"),
        ("batch = 4", "batch = 0", "batch"),
        ("patch = 32", "patch = 63", "config.toml:12: patch in [data] = 63 is not made of whole cells and row groups; use a multiple of 2"),
        ('models = ["imx250mzr-simulated"]\n', "", "config.toml:15: models in [noise] is missing; name one or more noise models"),
        ('["imx250mzr-simulated"]', '["nobody"]', "config.toml:16: models in [noise]: nobody: "),
        ("gains = [6, 12]", "gains = [6, 90]", "config.toml: gains in [noise]: 90 dB: outside the calibrated range"),
        ("levels = 2", "levels = 40", 'config.toml:5: levels in [network]: settings of unet: "levels"'),
        ("batch = 4", 'device = "cuda"\nprecision = "half"', "precision"),
        ("[train]", "[train", "config.toml"),
        ("batch = 4", "batch = 1.5", "config.toml:23: batch in [train] is not a whole number in plain digits; give 1 to 65536"),
        ('["scene"]', "[]", "config.toml:10: scenes in [data] is an empty list"),
        ('scenes = ["scene"]', 'scenes = ["scene"]\ntone = "srbg"', 'did you mean "srgb"? known: auto, srgb, linear'),
        ("[train]", '[validation]\nscenes = ["scene"]\ncases = ["90:10"]\n[train]', "config.toml: cases in [validation]: 90 dB: outside the calibrated range"),
        ("[noise]", "exposure_low = 3\n[noise]", "exposure_high"),
        ("[train]", '[validation]\ncases = ["12:10"]\n[train]', "scenes"),
    ],
)
def test_a_bad_configuration_is_one_line(refused, config, tmp_path, old, new, word):
    assert old in CONFIG
    line = refused("train", config(3, 2, CONFIG.replace(old, new)), "-o", tmp_path / "run")
    assert word in line
    assert not (tmp_path / "run").exists()


def test_runs_are_not_replaced_or_mixed(malus, refused, config, tmp_path):
    out = tmp_path / "run"
    malus("train", config(2), "-o", out)
    held = refused("train", config(2), "-o", out)
    assert "exists" in held and "--resume" in held and "--force" in held
    assert "steps" in refused("train", config(4), "-o", out, "--resume")
    done = malus("train", config(2), "-o", out, "--resume")
    assert "2 steps" in done.out and "finished before" in done.out and done.err == ""
    malus("train", config(2), "-o", out, "--force")
    (out / "checkpoint.safetensors").write_bytes((out / "checkpoint.safetensors").read_bytes()[:-100])
    refused("train", config(2), "-o", out, "--resume")
    (out / "checkpoint.safetensors").unlink()
    begun = malus("train", config(2), "-o", out, "--resume", "--force").err
    assert "run: held no checkpoint, training began at step 0" in begun


VALIDATED = CONFIG + '[validation]\nscenes = ["scene"]\ncases = ["12:10"]\ncrop = 64\nevery = 3\n'


@pytest.mark.parametrize("told,changed", [
    ("another package.guide: \"none\", now \"bm3d\"", ["package.guide=bm3d"]),
    ("another network.width: 4, now 2", ["network.width=2"]),
    ("another data.pool: 3, now 5", ["data.pool=5"]),
    ("another noise.jitter: 0.2, now 0.0", ["noise.jitter=0"]),
    ("another train.learning_rate: 0.001, now 0.1", ["train.learning_rate=0.1"]),
    ("another validation.crop: 64, now 32", ["validation.crop=32"]),
    ("another validation.cases: [\"12:10\"], now [\"12:20\"]", ["validation.cases=12:20"]),
    ("another noise.models", ["noise.models=imx250myr-simulated", "package.layout=polar-mono"]),
    ("another seed: 0, now 3", ["--seed", "3"])])
def test_what_another_run_was_of_is_told(malus, refused, config, tmp_path, told, changed):
    path, out = config(2, text=VALIDATED), tmp_path / "run"
    malus("train", path, "-o", out)
    flags = changed if changed[0] == "--seed" else [word for value in changed for word in ("--set", value)]
    line = refused("train", path, "-o", out, "--resume", *flags)
    assert f"belongs to a run with {told}" in line and line.endswith("; set it as it was, or train in another folder")
    done = malus("train", path, "-o", out, "--resume", "--set", "validation.every=1", "--set", "data.memory=900")
    assert "finished before" in done.out


def test_a_run_goes_on_with_another_log_and_where_the_rate_allows_longer(malus, refused, config, tmp_path):
    constant, path = ("--set", 'train.schedule="constant"', "--threads", "1"), config(8)
    malus("train", path, "-o", tmp_path / "once", *constant)
    out = tmp_path / "parts"
    malus("train", path, "-o", out, *constant, "--set", "train.steps=5", "--set", "train.log_every=2")
    assert "beyond" in refused("train", path, "-o", out, *constant, "--set", "train.steps=4", "--resume")
    malus("train", path, "-o", out, *constant, "--resume", "--set", "train.checkpoint_every=3")
    # No times in it: equal trainings, equal files, but for what was asked for.
    malus("train", path, "-o", tmp_path / "again", *constant)
    assert (tmp_path / "again/weights.safetensors").read_bytes() == (tmp_path / "once/weights.safetensors").read_bytes()
    assert same(tmp_path / "once/weights.safetensors", out / "weights.safetensors")
    assert "train.learning_rate" in refused("train", path, "-o", out, *constant, "--resume", "--set", "train.learning_rate=1e-4")
    training = json.loads(tensors(out / "weights.safetensors")[1]["malus_package"])["training"]
    assert "seconds" not in training and training["steps"] == 8


def test_weights_of_a_loss_that_exploded_are_warned_of(malus, config, tmp_path):
    wild = ("--set", "train.learning_rate=1", "--set", "train.warm_up=0", "--set", "train.clip=0", "--set", "train.schedule=constant")
    err = malus("train", config(12), "-o", tmp_path / "run", *wild).err
    assert "the loss has exploded" in err and "of no use" in err and "--force" in err


def test_gains_outside_the_calibrated_range_are_taken_when_asked_for(malus, refused, config, tmp_path):
    far = ("-o", tmp_path / "run", "--set", "noise.gains=[35]")
    assert "35 dB: outside the calibrated range" in refused("train", config(2), *far)
    validated = CONFIG + '[validation]\nscenes = ["scene"]\ncases = ["35:10"]\ncrop = 64\nevery = 2\n'
    for text in (validated, CONFIG.replace("jitter = 0.2", "")):
        malus("train", config(2, text=text), *far, "--set", "noise.extrapolate_gain=true", "--force")


def test_a_folder_that_cannot_be_written_is_said_before_the_work(malus, refused, config, tmp_path):
    malus("train", config(2), "-o", tmp_path / "run")
    (tmp_path / "file").write_text("in the way")
    assert "file/run" in refused("train", config(2), "-o", tmp_path / "file" / "run")
    (tmp_path / "run" / "checkpoint.safetensors").unlink()
    (tmp_path / "run" / "checkpoint.safetensors").mkdir()
    assert "folder" in refused("train", config(2), "-o", tmp_path / "run", "--resume")
