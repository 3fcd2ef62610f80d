"""`malus train`: what it writes, that it goes on where it was killed, several workers, mistakes in configurations."""

import json
import os
import pathlib
import re
import signal
import socket
import struct
import subprocess
import time

import numpy as np
import pytest
from PIL import Image

from conftest import PROGRAM, needs_networks

pytestmark = [pytest.mark.slow, needs_networks]

CONFIG = """
[network]
architecture = "unet"
width = 4
levels = 2
[package]
layout = "polar-mono"
noise_input = "units"
[data]
scenes = ["scene"]
example = 64
patch = 32
pool = 3
refresh = 0.5
[noise]
models = ["imx250mzr-simulated"]
gains = [6, 12]
ratio_low = 5
ratio_high = 20
jitter = 0.2
[train]
steps = {steps}
batch = 4
warm_up = 5
learning_rate = 1e-3
checkpoint_every = {checkpoint_every}
log_every = 1
timeout = 20
"""


@pytest.fixture
def config(tmp_path):
    """config(steps): a configuration beside four pictures of a smooth scene, polarized at 20 degrees."""
    (tmp_path / "scene").mkdir()
    rows, cols = np.mgrid[0:80, 0:96]
    light = 0.4 + 0.3 * np.sin(rows / 9) * np.cos(cols / 7)
    for angle in (0, 45, 90, 135):
        seen = 0.5 * light * (1 + 0.5 * np.cos(2 * np.radians(angle - 20)))
        Image.fromarray((seen * 65535).astype(np.uint16)).save(tmp_path / "scene" / f"I{angle}.png")

    def write(steps, checkpoint_every=2, text=CONFIG):
        path = tmp_path / "config.toml"
        path.write_text(text.format(steps=steps, checkpoint_every=checkpoint_every))
        return path

    return write


def tensors(path):
    """A safetensors file by its specification: {name: array}, metadata."""
    data = path.read_bytes()
    size = struct.unpack("<Q", data[:8])[0]
    header = json.loads(data[8 : 8 + size])
    metadata = header.pop("__metadata__")
    body = data[8 + size :]
    return {
        name: np.frombuffer(body[slice(*entry["data_offsets"])], np.float32).reshape(entry["shape"])
        for name, entry in header.items()
    }, metadata


def step_of(folder):
    checkpoint = folder / "checkpoint.safetensors"
    if not checkpoint.exists():
        return -1
    return json.loads(tensors(checkpoint)[1]["malus_checkpoint"])["step"]


def start(*arguments, **environment):
    return subprocess.Popen(
        [PROGRAM, "train", *map(str, arguments), "-q", "--threads", "1"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, **environment},
    )


def wait_for_step(process, folder, step):
    deadline = time.time() + 120
    while step_of(folder) < step:
        assert process.poll() is None, process.communicate()[1]
        assert time.time() < deadline
        time.sleep(0.01)


def same(one, other):
    a, b = tensors(one)[0], tensors(other)[0]
    assert a.keys() == b.keys()
    return all(np.array_equal(a[name], b[name]) for name in a)


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
    malus("train", config(6, text=text), "-o", tmp_path / "run", "--report", tmp_path / "run.html")
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


def test_killed_at_any_instant_it_goes_on_to_the_same_bits(malus, config, tmp_path):
    path = config(24, 1)
    malus("train", path, "-o", tmp_path / "once", "--threads", "1")
    parts = tmp_path / "parts"
    for step in (1, 7, 8, 15):
        process = start(path, "-o", parts, "--resume")
        wait_for_step(process, parts, step)
        process.send_signal(signal.SIGKILL)
        process.communicate()
        assert not list(parts.glob("weights*"))
    malus("train", path, "-o", parts, "--resume", "--threads", "1")
    assert same(tmp_path / "once" / "weights.safetensors", parts / "weights.safetensors")
    assert same(tmp_path / "once" / "checkpoint.safetensors", parts / "checkpoint.safetensors")
    steps = [json.loads(line)["step"] for line in (parts / "log.jsonl").read_text().splitlines()]
    assert steps == list(range(1, 25))


def test_an_interrupt_stops_after_a_step_with_a_checkpoint(malus, config, tmp_path):
    path, out = config(100000, 2), tmp_path / "run"
    process = start(path, "-o", out)
    wait_for_step(process, out, 2)
    process.send_signal(signal.SIGINT)
    process.communicate(timeout=60)
    assert process.returncode == 130
    reached = step_of(out)
    assert [json.loads(line)["step"] for line in (out / "log.jsonl").read_text().splitlines()][-1] == reached


def free_port():
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        return s.getsockname()[1]


def start_two(path, out, rank="RANK", size="WORLD_SIZE", resume=False, second=()):
    """second: what worker 1 alone is told besides."""
    port = str(free_port())
    return [  # only worker 0 needs the folder
        start(path, "-o", out if i == 0 else out / "elsewhere", *(["--resume"] if resume else []), *(second if i else ()),
              **{rank: str(i), size: "2", "MASTER_ADDR": "127.0.0.1", "MASTER_PORT": port, "GLOO_SOCKET_IFNAME": "lo"})
        for i in range(2)
    ]


@pytest.mark.parametrize(
    "rank,size",
    [
        ("RANK", "WORLD_SIZE"),
        pytest.param("OMPI_COMM_WORLD_RANK", "OMPI_COMM_WORLD_SIZE", marks=pytest.mark.slow),
        pytest.param("PMI_RANK", "PMI_SIZE", marks=pytest.mark.slow),
        pytest.param("SLURM_PROCID", "SLURM_NTASKS", marks=pytest.mark.slow),
    ],
)
def test_two_workers_have_the_gradients_of_one_with_the_whole_batch(malus, config, tmp_path, rank, size):
    path = config(1)
    malus("train", path, "-o", tmp_path / "one", "--threads", "1")
    for process in start_two(path, tmp_path / "two", rank, size):
        out, err = process.communicate(timeout=120)
        assert process.returncode == 0, err
    one, two = (tensors(tmp_path / name / "checkpoint.safetensors")[0] for name in ("one", "two"))
    gradients = [name for name in one if name.startswith("first_moment/")]
    assert gradients
    for name in gradients:  # after one step the first moment is 0.1 of the gradient
        assert np.abs(10 * one[name] - 10 * two[name]).max() < 1e-6, name
    assert max(np.abs(one[name]).max() for name in gradients) > 1e-4


@pytest.mark.parametrize("second,setting", [(("--set", "train.learning_rate=0.1"), "train.learning_rate"),
                                            (("--set", "network.width=8"), "network.settings.width"), (("--seed", "7"), "seed")])
def test_workers_of_unlike_configurations_do_not_start(malus, config, tmp_path, second, setting):
    lines = []
    for process in start_two(config(3), tmp_path / "run", second=second):
        _, err = process.communicate(timeout=120)
        assert process.returncode == 1, err
        lines.append([line for line in err.splitlines() if line.startswith("malus: ")])
    assert [len(found) for found in lines] == [1, 1], lines
    assert "worker 0 of 2" in lines[0][0] and "another worker has another configuration" in lines[0][0]
    assert "worker 1 of 2" in lines[1][0] and f"has another {setting} than worker 0" in lines[1][0]
    assert not (tmp_path / "run" / "weights.safetensors").exists()


def test_a_lost_worker_stops_the_run_and_the_checkpoint_is_good(malus, config, tmp_path):
    path, out = config(100000, 1), tmp_path / "run"
    workers = start_two(path, out)
    wait_for_step(workers[0], out, 3)
    workers[1].send_signal(signal.SIGKILL)
    workers[1].communicate()
    _, err = workers[0].communicate(timeout=60)
    assert workers[0].returncode == 1
    lines = [line for line in err.splitlines() if line.startswith("malus: ")]
    assert len(lines) == 1 and "worker 0 of 2" in lines[0] and "--resume" in lines[0], err
    reached = step_of(out)
    assert reached >= 3
    again = start_two(path, out, resume=True)
    wait_for_step(again[0], out, reached + 2)
    for process in again:
        process.send_signal(signal.SIGINT)
    assert [process.wait(60) for process in again] == [130, 130]
    assert not (out / "elsewhere").exists()


@pytest.mark.slow
def test_two_hosts_train_together(malus, config, tmp_path):
    path = config(3)
    malus("train", path, "-o", tmp_path / "one", "--threads", "1")
    script = pathlib.Path(__file__).with_name("two_hosts.sh")
    done = subprocess.run([script, PROGRAM, path, tmp_path / "two"], capture_output=True, text=True, timeout=240)
    if done.returncode == 77:
        pytest.skip(done.stderr.strip())
    assert done.returncode == 0, done.stderr
    one, two = (tensors(tmp_path / name / "weights.safetensors")[0] for name in ("one", "two"))
    for name in one:
        assert np.abs(one[name] - two[name]).max() < 1e-5, name


def base_loss(malus, folder, data, *more):
    """L1 distance of noisy and clean planes, in units of the stated noise, mean over some steps of no learning."""
    text = CONFIG.replace('scenes = ["scene"]', data).replace("jitter = 0.2", "").replace("batch = 4", 'batch = 4\nloss = "l1"')
    path = folder / "config.toml"
    path.write_text(text.format(steps=8, checkpoint_every=100).replace("1e-3", "0"))
    malus("train", path, "-o", folder / "run", *more)
    lines = (folder / "run" / "log.jsonl").read_text().splitlines()
    return np.mean([json.loads(line)["base_loss"] for line in lines])


@pytest.fixture
def clean(tmp_path):
    rows, cols = np.mgrid[0:256, 0:192]
    np.save(tmp_path / "clean.npy", (1500 + 900 * np.sin(rows / 31) * np.cos(cols / 23)).astype(np.float32))
    return tmp_path / "clean.npy"


# Unit Gaussian noise has a mean absolute value of sqrt(2/pi) = 0.798; Tukey-lambda read noise and what the removal of
# row noise and the bias of a frame leave make it a little different.
def test_shards_are_taken_with_the_noise_they_were_made_with(malus, clean, tmp_path):
    (tmp_path / "dataset.toml").write_text(
        'model = "imx250mzr-simulated"\nclean = ["clean.npy"]\n[dataset]\nsamples = 12\npatch = 64\nratios = [5, 20]\n')
    malus("dataset", tmp_path / "dataset.toml", "-o", tmp_path / "shards")
    assert abs(base_loss(malus, tmp_path, 'shards = ["shards/*.tar"]') - 0.8) < 0.06


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


NO_NOISE = {"shot": "false", "read": "false", "row": "false", "quantization": "false"}
LINEAR = ["--set", 'package.domain="linear"', "--set", "noise.gains=[12]"]


# Without noise what is left is bias that was not taken out, or taken out though it was not there: 8 DN are 0.8 of the stated noise.
@pytest.mark.parametrize("debias", ["true", "false"])
@pytest.mark.parametrize("bias", ["true", "false"])
def test_shards_hold_the_bias_that_training_takes_out(malus, clean, biased_camera, tmp_path, bias, debias):
    noise = {**NO_NOISE, "bias": bias, "debias": debias, "parameters": '"mean"'}
    (tmp_path / "dataset.toml").write_text(
        f'model = "{biased_camera}"\nclean = ["clean.npy"]\n[dataset]\nsamples = 6\npatch = 64\nratios = [5]\ngains = [12]\n[noise]\n'
        + "".join(f"{key} = {value}\n" for key, value in noise.items()))
    malus("dataset", tmp_path / "dataset.toml", "-o", tmp_path / "shards")
    model = ["--set", f'noise.models=["{tmp_path / biased_camera}"]']
    assert base_loss(malus, tmp_path, 'shards = ["shards/*.tar"]', *LINEAR, *model) < 2e-5


@pytest.mark.parametrize("bias", ["true", "false"])
def test_bias_that_was_not_drawn_is_not_taken_out(malus, config, biased_camera, tmp_path, bias):
    off = [word for key, value in {**NO_NOISE, "bias": bias, "parameters": '"mean"'}.items() for word in ("--set", f"noise.{key}={value}")]
    model = ["--set", f'noise.models=["{tmp_path / biased_camera}"]']
    loss = base_loss(malus, tmp_path, 'scenes = ["scene"]', *LINEAR, *model, *off)
    assert loss < 0.05  # raw frames are whole DN: 0.25 on average, in units of some 10 DN


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
        ("batch = 4", 'device = "cuda"\nprecision = "half"', "precision"),
        ("[train]", "[train", "config.toml"),
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
    assert "exists" in refused("train", config(2), "-o", out)
    assert "steps" in refused("train", config(4), "-o", out, "--resume")
    malus("train", config(2), "-o", out, "--force")
    (out / "checkpoint.safetensors").write_bytes((out / "checkpoint.safetensors").read_bytes()[:-100])
    refused("train", config(2), "-o", out, "--resume")


@pytest.mark.parametrize("holed", ["clean.npy", "noisy.npy"])
def test_recorded_pairs_with_holes_are_named(refused, clean, tmp_path, holed):
    np.save(tmp_path / "noisy.npy", np.load(clean) / 5)
    frame = np.load(tmp_path / holed)
    frame[100, 90] = np.nan
    np.save(tmp_path / holed, frame)
    pair = {"name": "one", "short": "noisy.npy", "reference": "clean.npy", "ratio": 5, "gain_db": 12, "iso": None}
    (tmp_path / "pairs.json").write_text(json.dumps({"pairs": [pair]}))
    text = CONFIG.replace('scenes = ["scene"]', 'pairs = ["pairs.json"]').replace("= 64", "= 192").replace("jitter = 0.2", "")
    (tmp_path / "config.toml").write_text(text.format(steps=2, checkpoint_every=1))
    line = refused("train", tmp_path / "config.toml", "-o", tmp_path / "run")
    assert f"{holed}: 1 pixels are NaN" in line


def test_recorded_pairs_of_another_layout_are_refused(malus, refused, clean, tmp_path):
    malus("synthesize", clean, "-m", "imx250myr-simulated", "--gain", 12, "-o", tmp_path)
    pair = {"name": "one", "short": "clean_000.tif", "reference": "clean.npy", "ratio": 1, "gain_db": 12, "iso": None}
    (tmp_path / "pairs.json").write_text(json.dumps({"pairs": [pair]}))
    text = CONFIG.replace('scenes = ["scene"]', 'pairs = ["pairs.json"]').replace("= 64", "= 192").replace("jitter = 0.2", "")
    (tmp_path / "config.toml").write_text(text.format(steps=2, checkpoint_every=1))
    line = refused("train", tmp_path / "config.toml", "-o", tmp_path / "run")
    assert "clean_000.tif: has the layout polar-bayer-rggb, the noise model polar-mono" in line


def test_names_of_files_may_be_any_bytes(malus, config, tmp_path):
    with open(os.fsencode(tmp_path) + b"/caf\xe9.npy", "wb") as file:
        np.save(file, np.full((80, 96), 0.4, np.float32))
    text = CONFIG.replace('scenes = ["scene"]', 'pictures = ["caf*.npy"]')
    malus("train", config(2, 1, text), "-o", tmp_path / "run")
    malus("train", config(2, 1, text), "-o", tmp_path / "run", "--resume")


def test_pictures_may_be_jpeg(malus, config, tmp_path):
    rows, cols = np.mgrid[0:80, 0:96]
    Image.fromarray((120 + 60 * np.sin(rows / 9) * np.cos(cols / 7)).astype(np.uint8)).save(tmp_path / "photo.jpg")
    text = CONFIG.replace('scenes = ["scene"]', 'pictures = ["*.jpg"]')
    malus("train", config(2, 1, text), "-o", tmp_path / "run")


def test_a_folder_that_cannot_be_written_is_said_before_the_work(malus, refused, config, tmp_path):
    malus("train", config(2), "-o", tmp_path / "run")
    (tmp_path / "file").write_text("in the way")
    assert "file/run" in refused("train", config(2), "-o", tmp_path / "file" / "run")
    (tmp_path / "run" / "checkpoint.safetensors").unlink()
    (tmp_path / "run" / "checkpoint.safetensors").mkdir()
    assert "folder" in refused("train", config(2), "-o", tmp_path / "run", "--resume")
