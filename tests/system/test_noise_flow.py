"""Noise Flow from the command line: trained on pairs, drawn from, compared with the truth."""

import fcntl
import io
import json
import os
import shutil
import tarfile

import numpy as np
import pytest
from PIL import Image

from conftest import needs_networks

pytestmark = [pytest.mark.slow, needs_networks]

BLACK, WHITE, SLOPE, OFFSET = 64, 1087, 2.5, 30
RAW = ["--layout", "bayer-rggb", "--gain", "12"]
CONFIG = f"""
[network]
architecture = "noise-flow"
[sensor]
layout = "bayer-rggb"
black = {BLACK}
white = {WHITE}
[[pairs]]
noisy = "noisy_*.npy"
clean = "clean.npy"
gain_db = 12
[train]
couplings = 2
width = 4
steps = 150
batch = 4
crop = 16
"""


def write_pairs(folder):
    clean = np.tile(np.repeat(np.linspace(40, 700, 12), 16), (160, 1)).astype(np.float32)
    np.save(folder / "clean.npy", clean)
    rng = np.random.default_rng(2)
    for k in range(4):
        noisy = clean + rng.normal(0, 1, clean.shape) * np.sqrt(SLOPE * clean + OFFSET)
        np.save(folder / f"noisy_{k}.npy", (noisy + BLACK).round().clip(0, WHITE).astype(np.uint16))
    (folder / "flow.toml").write_text(CONFIG)
    return folder


@pytest.fixture
def pairs(tmp_path):
    return write_pairs(tmp_path)


def test_what_came_of_it_is_printed_and_several_processes_are_refused(malus, refused, pairs):
    short = ["train", pairs / "flow.toml", "--set", "train.steps=2", "-o", pairs / "short"]
    assert "log-likelihood of a noisy pixel" in malus(*short).out
    line = refused(*short, "--force", env={**os.environ, "RANK": "0", "WORLD_SIZE": "2"})
    assert "by one process" in line
    line = refused("train", pairs / "flow.toml", "--set", "sensor.white=500", "-o", pairs / "dark")
    assert "noisy_0.npy: " in line and "of its pixels lie above the white of 500 DN" in line


@pytest.fixture(scope="module")
def training(malus, tmp_path_factory):
    """Pairs and the flow that was trained on them, once for all tests."""
    folder = write_pairs(tmp_path_factory.mktemp("training"))
    run = malus("train", folder / "flow.toml", "-o", folder / "flow", "--json").json
    assert run["log"][-1]["log_likelihood"] > run["log"][0]["log_likelihood"] - 0.05
    return folder


@pytest.fixture
def trained(training, tmp_path):
    """A copy of them that a test may change."""
    return shutil.copytree(training, tmp_path / "trained")


def test_a_finished_flow_is_not_trained_again(malus, refused, trained):
    weights = trained / "flow/weights.safetensors"
    before = weights.read_bytes()
    again = malus("train", trained / "flow.toml", "-o", trained / "flow", "--resume")
    assert "nothing was left to train" in again.out and "no checkpoint" not in again.err
    assert weights.read_bytes() == before
    line = refused("train", trained / "flow.toml", "-o", trained / "flow", "--resume", "--set", "train.steps=3")
    assert "belongs to a run with another train.steps: 150, now 3" in line
    np.save(trained / "noisy_0.npy", np.load(trained / "noisy_1.npy"))
    assert "other files of data.pairs" in refused("train", trained / "flow.toml", "-o", trained / "flow", "--resume")
    # A folder without weights: from the start, which is said.
    assert "training began at step 0" in malus("train", trained / "flow.toml", "-o", trained / "new", "--resume", "--set", "train.steps=2").err


def test_equal_trainings_give_equal_files(malus, pairs):
    for name in ("a", "b"):
        malus("train", pairs / "flow.toml", "--set", "train.steps=2", "-o", pairs / name)
    assert (pairs / "a/weights.safetensors").read_bytes() == (pairs / "b/weights.safetensors").read_bytes()


def test_two_trainings_do_not_share_a_folder(malus, refused, pairs):
    short = ["train", pairs / "flow.toml", "--set", "train.steps=2", "-o", pairs / "flow", "--force"]
    (pairs / "flow").mkdir()
    with open(pairs / "flow/.lock", "w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        assert "another training is writing into this folder" in refused(*short)
    malus(*short)
    assert not (pairs / "flow/.lock").exists()


NETWORK = """
[network]
architecture = "unet"
width = 2
levels = 2
[package]
layout = "bayer-rggb"
domain = "linear"
amplification = "auto"
[data]
{data}
example = 64
patch = 32
pool = 1
polarized = false
[noise]
models = ["flow/weights.safetensors"]
[train]
steps = 3
batch = 2
warm_up = 1
"""
PICTURES = 'pictures = ["picture.png"]'


def test_a_network_is_trained_on_its_noise(malus, refused, trained):
    rows, cols = np.mgrid[0:96, 0:96]
    light = 120 + 60 * np.sin(cols / 7) + 40 * np.cos(rows / 11)
    Image.fromarray(np.clip(light[..., None] * (1, 0.9, 0.7), 0, 255).astype(np.uint8)).save(trained / "picture.png")
    config = trained / "network.toml"
    config.write_text(NETWORK.format(data=PICTURES))
    malus("train", config, "-o", trained / "run")
    malus("train", config, "-o", trained / "again")
    weights = [(trained / run / "weights.safetensors").read_bytes() for run in ("run", "again")]
    assert weights[0] == weights[1]
    # Other weights of the flow are another noise.
    (trained / "flow/weights.safetensors").replace(trained / "flow/before.safetensors")
    malus("train", trained / "flow.toml", "-o", trained / "flow", "--set", "train.steps=2", "--force")
    assert "belongs to a run with other files of noise.models" in refused("train", config, "-o", trained / "run", "--resume")
    for setting, word in (("noise.jitter=0.2", "jitter in [noise] means nothing"), ("noise.kind=gaussian", "kind in [noise] means nothing"),
                          ("noise.kind=physics", "kind in [noise] means nothing"),
                          ("noise.gains=[24]", "the flow was trained from 12 dB to 12 dB"), ("package.layout=bayer-bggr", "layout")):
        assert word in refused("train", config, "-o", trained / "none", "--set", setting)
    assert not (trained / "none").exists()


def test_a_data_set_of_its_noise_trains_a_network(malus, refused, trained):
    plan = trained / "plan.toml"
    text = ('model = "flow/weights.safetensors"\nclean = ["clean.npy"]\n[dataset]\nsamples = 40\nshard_size = 20\npatch = 64\n'
            'ratios = [2, 8]\n')
    plan.write_text(text)
    malus("dataset", plan, "-o", trained / "shards")
    assert json.loads((trained / "shards/dataset.json").read_text())["noise"] == {"amplify": True, "debias": True}
    square, count = 0.0, 0
    for shard in sorted((trained / "shards").glob("*.tar")):
        with tarfile.open(shard) as tar:
            files = {member.name: tar.extractfile(member).read() for member in tar}
        for name in (n for n in files if n.endswith(".json")):
            facts = json.loads(files[name])
            assert facts["gain_db"] == 12 and abs(facts["removed_bias_dn"]) < 3
            clean, noisy = (np.load(io.BytesIO(files[name.replace("json", f"{what}.npy")])) for what in ("clean", "noisy"))
            light = clean / facts["ratio"]
            noise = (noisy - clean) / facts["ratio"]
            square += (noise ** 2 / (SLOPE * light + OFFSET)).sum()
            count += noise.size
    # 164,000 samples, 0.35 % standard error; the flow's training is brief, as above.
    assert square / count == pytest.approx(1, abs=0.15)
    config = trained / "network.toml"
    config.write_text(NETWORK.replace("polarized = false\n", "").format(data='shards = ["shards/*.tar"]'))
    malus("train", config, "-o", trained / "run")
    malus("train", trained / "flow.toml", "--set", "train.steps=2", "-o", trained / "other")
    line = refused("train", config, "-o", trained / "none", "--set", 'noise.models=["other/weights.safetensors"]')
    assert "shards were drawn from a model of the sensor" in line
    plan.write_text(text + "gains = [24]\n")
    line = refused("dataset", plan, "-o", trained / "none")
    assert "plan.toml:8: gains" in line and "from 12 dB to 12 dB" in line
    plan.write_text(text + "[noise]\nshot = false\n")
    assert "weights.safetensors: a Noise Flow has none of the parts" in refused("dataset", plan, "-o", trained / "none")
    plan.write_text(text + "[noise]\nkind = 'physics'\n")
    assert "plan.toml:9: kind in [noise] means nothing to the noise of a Noise Flow" in refused("dataset", plan, "-o", trained / "none")


def test_weights_are_not_replaced_unasked_but_those_beside_do_not_matter(malus, refused, pairs):
    short = ["--set", "train.steps=2", "--set", "train.couplings=0"]
    malus("train", pairs / "flow.toml", *short, "-o", pairs / "flows")
    assert "exists" in refused("train", pairs / "flow.toml", *short, "-o", pairs / "flows")
    malus("train", pairs / "flow.toml", *short, "-o", pairs / "flows/new")
    assert (pairs / "flows/new/weights.safetensors").exists()


def test_drawn_frames_are_near_the_truth_and_repeat_with_the_seed(malus, trained):
    malus("synthesize", trained / "clean.npy", "--model", trained / "flow/weights.safetensors", *RAW, "--frames", "4",
          "--format", "npy", "-o", trained / "drawn", "--seed", "3")
    drawn = sorted((trained / "drawn").glob("*.npy"))
    assert len(drawn) == 4 and np.load(drawn[0]).dtype == np.uint16
    compared = malus("evaluate", "--noise", "--reference", *sorted(trained.glob("noisy_*.npy")), "--test", *drawn,
                     "--clean", trained / "clean.npy", *RAW, "--black", BLACK, "--white", WHITE, "--json").json
    pooled = compared["pooled"]
    # 123,000 samples on both sides: the floor is what two samples of one law show; the training is brief.
    assert pooled["sqrt_jsd"] < pooled["sqrt_jsd_floor"] + 0.03, json.dumps(pooled)
    frames = []
    for name, seed in (("a", 5), ("b", 5), ("c", 6)):
        malus("synthesize", trained / "clean.npy", "--model", trained / "flow/weights.safetensors", *RAW, "--format",
              "npy", "--seed", seed, "-o", trained / name)
        frames.append(np.load(trained / name / "clean_000.npy"))
    assert (frames[0] == frames[1]).all() and (frames[0] != frames[2]).any()


def test_a_flow_is_compared_like_any_noise_model(malus, trained):
    flow, clean = trained / "flow/weights.safetensors", trained / "clean.npy"
    compare = ["evaluate", "--noise", "--reference", *sorted(trained.glob("noisy_*.npy")), "--clean", clean, *RAW,
               "--black", BLACK, "--white", WHITE, "--json"]
    compared = malus(*compare, "--model", flow, "--seed", "3").json
    # The flow draws what synthesize draws, from frame 2**31 on: the same frames through files give the same numbers.
    malus("synthesize", clean, "--model", flow, *RAW, "--frames", "4", "--first-frame", str(2**31), "--format", "npy",
          "--seed", "3", "-o", trained / "compared")
    assert compared == malus(*compare, "--test", *sorted((trained / "compared").glob("*.npy"))).json
    levels = {round(level["signal_dn"]): level["sqrt_jsd"] for level in compared["levels"]}
    assert len(levels) == 12 and max(levels) > 650 and compared["pooled"]["sqrt_jsd"] < 0.1


def test_what_a_flow_cannot_do_is_refused(refused, trained):
    flow = trained / "flow/weights.safetensors"
    base = ["synthesize", trained / "clean.npy", "--layout", "bayer-rggb", "-o", trained / "out"]
    assert "24" in refused(*base, "--model", flow, "--gain", "24")
    assert "random" in refused(*base, "--model", flow, "--gain", "random")
    assert "--model" in refused(*base, "--model", flow, "--gain", "12", "--no-shot")
    noise = ["evaluate", "--noise", "--reference", trained / "noisy_0.npy", "--clean", trained / "clean.npy", "--black",
             BLACK, "--white", WHITE, "--model", flow]
    assert "--kind" in refused(*noise, *RAW, "--kind", "gaussian")
    for kind in ("physics", "gaussian"):
        line = refused(*base, "--model", flow, "--gain", "12", "--kind", kind)
        assert f"--kind {kind}: means nothing to a Noise Flow" in line
    assert "layout" in refused(*noise, "--layout", "bayer-bggr", "--gain", "12")
    assert "24" in refused(*noise, "--layout", "bayer-rggb", "--gain", "24")
    line = refused("denoise", trained / "noisy_0.npy", "--method", flow, "--black", BLACK, "--white", WHITE,
                   "--layout", "bayer-rggb", "-o", trained / "out")
    assert "is a Noise Flow" in line and "malus synthesize" in line
    whole = flow.read_bytes()
    flow.write_bytes(whole[:-8])
    assert "weights.safetensors" in refused(*base, "--model", flow, "--gain", "12")


@pytest.mark.parametrize("old,new,word", [("couplings", "cuplings", "couplings"), ("clean.npy", "none.npy", "none.npy"),
                                          ("black = 64", "black = [1, 2]", "black"), ("noisy_*", "nosy_*", "noisy"),
                                          ("noise-flow", "noise-flwo", 'bad.toml:3: architecture in [network] is "noise-flwo"; did you mean "noise-flow"?'),
                                          ("bayer-rggb", "bayer-rgbg", "bad.toml:5: layout in [sensor]"),
                                          (CONFIG[CONFIG.index("[[pairs]]"):CONFIG.index("[train]")], "", "bad.toml:1: pairs in the training configuration is missing")])
def test_bad_configurations_are_refused(refused, pairs, old, new, word):
    (pairs / "bad.toml").write_text(CONFIG.replace(old, new))
    assert word in refused("train", pairs / "bad.toml", "-o", pairs / "bad")
    assert not (pairs / "bad").exists()
