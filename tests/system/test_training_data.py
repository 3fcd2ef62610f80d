"""`malus train`: shards and recorded pairs come with their own noise, pictures and files of every kind."""

import json
import os

import numpy as np
import pytest
from PIL import Image

from conftest import needs_networks
from training_files import CONFIG, clean, config  # noqa: F401 (fixtures)

pytestmark = [pytest.mark.slow, needs_networks]


OF_DRAWN_NOISE = ("gains = [6, 12]\n", "ratio_low = 5\n", "ratio_high = 20\n", "jitter = 0.2\n")


def recorded(text):
    """The configuration without what says nothing of shards and captured pairs."""
    for line in OF_DRAWN_NOISE:
        text = text.replace(line, "")
    return text


def base_loss(malus, folder, data, *more, text=CONFIG):
    """L1 distance of noisy and clean planes, in units of the stated noise, mean over some steps of no learning."""
    text = text.replace("jitter = 0.2", "") if "scenes" in data else recorded(text)
    text = text.replace('scenes = ["scene"]', data).replace("batch = 4", 'batch = 4\nloss = "l1"')
    path = folder / "config.toml"
    path.write_text(text.format(steps=8, checkpoint_every=100).replace("1e-3", "0"))
    malus("train", path, "-o", folder / "run", "--force", *more)
    lines = (folder / "run" / "log.jsonl").read_text().splitlines()
    return np.mean([json.loads(line)["base_loss"] for line in lines])


# Unit Gaussian noise has a mean absolute value of sqrt(2/pi) = 0.798; Tukey-lambda read noise and what the removal of
# row noise and the bias of a frame leave make it a little different.
def test_shards_are_taken_with_the_noise_they_were_made_with(malus, clean, tmp_path):
    (tmp_path / "dataset.toml").write_text(
        'model = "imx250mzr-simulated"\nclean = ["clean.npy"]\n[dataset]\nsamples = 12\npatch = 64\nratios = [5, 20]\n')
    malus("dataset", tmp_path / "dataset.toml", "-o", tmp_path / "shards")
    assert abs(base_loss(malus, tmp_path, 'shards = ["shards/*.tar"]') - 0.8) < 0.06


def test_shards_that_are_too_small_are_told_by_how_much(refused, malus, clean, tmp_path):
    (tmp_path / "dataset.toml").write_text(
        'model = "imx250mzr-simulated"\nclean = ["clean.npy"]\n[dataset]\nsamples = 2\npatch = 16\n')
    malus("dataset", tmp_path / "dataset.toml", "-o", tmp_path / "shards")
    text = recorded(CONFIG).replace('scenes = ["scene"]', 'shards = ["shards/*.tar"]')
    (tmp_path / "config.toml").write_text(text.format(steps=2, checkpoint_every=100))
    line = refused("train", tmp_path / "config.toml", "-q", "-o", tmp_path / "run")
    assert "planes of 8 x 8, a step of the training takes 16 x 16" in line and "smaller patch in [data]" in line


def test_captured_pairs_are_taken_with_their_ratio_and_gain(malus, clean, tmp_path):
    pairs = []
    for gain, ratio in ((6, 5), (12, 20)):
        folder = tmp_path / f"g{gain}"
        malus("synthesize", clean, "--model", "imx250mzr-simulated", "--gain", gain, "--ratio", ratio, "-o", folder)
        noisy = next(folder.glob("clean_000.*"))
        pairs.append({"name": folder.name, "short": f"{folder.name}/{noisy.name}", "reference": "clean.npy",
                      "ratio": ratio, "gain_db": gain, "iso": None})
    (tmp_path / "pairs.json").write_text(json.dumps({"pairs": pairs}))
    assert abs(base_loss(malus, tmp_path, 'pairs = ["pairs.json"]') - 0.8) < 0.06


@pytest.fixture
def biased_camera(malus, tmp_path):
    """A noise model whose channels have unlike biases: -12, -4, 4 and 12 DN."""
    random = np.random.default_rng(1)
    bias = np.tile([[-12.0, -4.0], [4.0, 12.0]], (64, 64))
    levels = [0, 0] * 6 + [300, 300, 900, 900, 1800, 1800]
    for number, level in enumerate(levels):
        shot = 100 + bias + 2 * random.poisson(level / 2, bias.shape) + random.normal(0, 3, bias.shape)
        np.save(tmp_path / f"{number:02}.npy", np.round(shot).astype(np.uint16))
    frames = '[[frames]]\nkind = "bias"\ngain_db = 12\npaths = ["0*.npy", "10.npy", "11.npy"]\n'
    for k in range(3):
        frames += f'[[frames]]\nkind = "flat"\ngain_db = 12\nlevel = {k}\npaths = ["{12 + 2 * k}.npy", "{13 + 2 * k}.npy"]\n'
    sensor = '[sensor]\nname = "biased"\nlayout = "polar-mono"\nblack = 100\nwhite = 4095\nrow_group = 1\n'
    (tmp_path / "session.toml").write_text(sensor + frames)
    malus("calibrate", tmp_path / "session.toml", "-o", tmp_path / "biased.h5")
    return "biased.h5"


@pytest.fixture(params=["with its model", "without"])
def biased_pairs(malus, biased_camera, tmp_path, request):
    """What `malus pairs` makes of dim frames by that camera and a tenfold exposure."""
    random = np.random.default_rng(2)
    rows, cols = np.mgrid[0:128, 0:128]
    scene = 300 + 200 * np.sin(rows / 31) * np.cos(cols / 23)
    bias = np.tile([[-12.0, -4.0], [4.0, 12.0]], (64, 64))
    text = '[sensor]\nlayout = "polar-mono"\nblack = 100\nwhite = 4095\nrow_group = 1\n'
    for kind, light, seconds in (("reference", scene, 0.01), ("short", scene / 10, 0.001)):
        for number in range(8):
            shot = 100 + bias + 2 * random.poisson(light / 2) + random.normal(0, 3, bias.shape)
            np.save(tmp_path / f"{kind}{number}.npy", np.round(shot).astype(np.uint16))
        text += f'[[frames]]\nkind = "{kind}"\nlevel = 1\ngain_db = 12\nexposure_s = {seconds}\npaths = ["{kind}?.npy"]\n'
    (tmp_path / "scenes.toml").write_text(text)
    model = ["--model", tmp_path / biased_camera] if request.param == "with its model" else []
    malus("pairs", tmp_path / "scenes.toml", *model, "-o", tmp_path / "pairs")
    return 'pairs = ["pairs/pairs.json"]'


# The model lies beside the configuration, which names it. Its bias is taken out and its noise is the unit: 0.8, as above.
def test_captured_pairs_are_taken_with_the_model_that_the_configuration_names(malus, biased_pairs, biased_camera, tmp_path):
    def loss(model):
        own = CONFIG.replace('["imx250mzr-simulated"]', f'["{model}"]')
        return base_loss(malus, tmp_path, biased_pairs, text=own)

    assert abs(loss(biased_camera) - 0.8) < 0.06
    assert loss("imx250mzr-simulated") > 1.2


def test_captured_pairs_are_of_one_model(refused, biased_pairs, biased_camera, tmp_path):
    text = recorded(CONFIG).replace('scenes = ["scene"]', biased_pairs)
    both = f'["imx250mzr-simulated", "{biased_camera}"]'
    (tmp_path / "config.toml").write_text(text.replace('["imx250mzr-simulated"]', both).format(steps=2, checkpoint_every=1))
    line = refused("train", tmp_path / "config.toml", "-o", tmp_path / "run")
    assert "config.toml: names 2 noise models; name the one that describes the recorded pairs" in line
    assert not (tmp_path / "run").exists()


NO_NOISE = {"shot": "false", "read": "false", "row": "false", "quantization": "false"}
LINEAR = ["--set", 'package.domain="linear"', "--set", 'package.noise_input="none"']


# Without noise what is left is bias that was not taken out, or taken out though it was not there: 8 DN are 0.005 of the amplified light.
@pytest.mark.parametrize("debias", ["true", "false"])
@pytest.mark.parametrize("bias", ["true", "false"])
def test_shards_hold_the_bias_that_training_takes_out(malus, clean, biased_camera, tmp_path, bias, debias):
    noise = {**NO_NOISE, "bias": bias, "debias": debias, "parameters": '"mean"'}
    (tmp_path / "dataset.toml").write_text(
        f'model = "{biased_camera}"\nclean = ["clean.npy"]\n[dataset]\nsamples = 6\npatch = 64\nratios = [5]\ngains = [12]\n[noise]\n'
        + "".join(f"{key} = {value}\n" for key, value in noise.items()))
    malus("dataset", tmp_path / "dataset.toml", "-o", tmp_path / "shards")
    model = ["--set", f'noise.models=["{tmp_path / biased_camera}"]']
    assert base_loss(malus, tmp_path, 'shards = ["shards/*.tar"]', *LINEAR, *model) < 1e-6


@pytest.mark.parametrize("bias", ["true", "false"])
def test_bias_that_was_not_drawn_is_not_taken_out(malus, config, biased_camera, tmp_path, bias):
    off = [word for key, value in {**NO_NOISE, "bias": bias, "parameters": '"mean"'}.items() for word in ("--set", f"noise.{key}={value}")]
    model = ["--set", f'noise.models=["{tmp_path / biased_camera}"]']
    loss = base_loss(malus, tmp_path, 'scenes = ["scene"]', *LINEAR, "--set", "noise.gains=[12]", *model, *off)
    assert loss < 0.002  # raw frames are whole DN: 0.25 on average, of some 400 DN


@pytest.mark.parametrize("holed", ["clean.npy", "noisy.npy"])
def test_recorded_pairs_with_holes_are_named(refused, clean, tmp_path, holed):
    np.save(tmp_path / "noisy.npy", np.load(clean) / 5)
    frame = np.load(tmp_path / holed)
    frame[100, 90] = np.nan
    np.save(tmp_path / holed, frame)
    pair = {"name": "one", "short": "noisy.npy", "reference": "clean.npy", "ratio": 5, "gain_db": 12, "iso": None}
    (tmp_path / "pairs.json").write_text(json.dumps({"pairs": [pair]}))
    text = recorded(CONFIG).replace('scenes = ["scene"]', 'pairs = ["pairs.json"]').replace("= 64", "= 192")
    (tmp_path / "config.toml").write_text(text.format(steps=2, checkpoint_every=1))
    line = refused("train", tmp_path / "config.toml", "-o", tmp_path / "run")
    assert f"{holed}: 1 pixel is NaN" in line


def test_recorded_pairs_of_another_layout_are_refused(malus, refused, clean, tmp_path):
    malus("synthesize", clean, "-m", "imx250myr-simulated", "--gain", 12, "-o", tmp_path)
    pair = {"name": "one", "short": "clean_000.tif", "reference": "clean.npy", "ratio": 1, "gain_db": 12, "iso": None}
    (tmp_path / "pairs.json").write_text(json.dumps({"pairs": [pair]}))
    text = recorded(CONFIG).replace('scenes = ["scene"]', 'pairs = ["pairs.json"]').replace("= 64", "= 192")
    (tmp_path / "config.toml").write_text(text.format(steps=2, checkpoint_every=1))
    line = refused("train", tmp_path / "config.toml", "-o", tmp_path / "run")
    assert "clean_000.tif: has the layout polar-bayer-rggb, the noise model polar-mono" in line


def test_names_of_files_may_be_any_bytes(malus, config, tmp_path):
    with open(os.fsencode(tmp_path) + b"/caf\xe9.npy", "wb") as file:
        np.save(file, np.full((80, 96), 0.4, np.float32))
    text = CONFIG.replace('scenes = ["scene"]', 'pictures = ["caf*.npy"]')
    malus("train", config(2, 1, text), "-o", tmp_path / "run")
    malus("train", config(2, 1, text), "-o", tmp_path / "run", "--resume")


def test_clean_pictures_with_holes_are_named(refused, config, tmp_path):
    """As a renderer's fireflies are: taken for black, they would teach a network to draw black."""
    picture = np.full((80, 96), 0.4, np.float32)
    picture[40:48, 50] = np.nan
    picture[3, 4] = np.inf
    np.save(tmp_path / "holes.npy", picture)
    path = config(2, text=CONFIG.replace('scenes = ["scene"]', 'pictures = ["holes.npy"]'))
    assert "holes.npy: 9 pixels are NaN or infinite; networks cannot be trained" in refused("train", path, "-o", tmp_path / "run")


def test_pictures_may_be_jpeg(malus, config, tmp_path):
    rows, cols = np.mgrid[0:80, 0:96]
    Image.fromarray((120 + 60 * np.sin(rows / 9) * np.cos(cols / 7)).astype(np.uint8)).save(tmp_path / "photo.jpg")
    text = CONFIG.replace('scenes = ["scene"]', 'pictures = ["*.jpg"]')
    malus("train", config(2, 1, text), "-o", tmp_path / "run")
