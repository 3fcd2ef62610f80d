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

from conftest import PROGRAM, needs_networks
from training_files import CONFIG, config  # noqa: F401 (a fixture)

pytestmark = [pytest.mark.slow, pytest.mark.alone, needs_networks]


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


def start(*arguments, quiet=True, **environment):
    return subprocess.Popen(
        [PROGRAM, "train", *map(str, arguments), *(["-q"] if quiet else []), "--threads", "1"],
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
    process = start(path, "-o", out, quiet=False)
    wait_for_step(process, out, 2)
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=60)
    assert process.returncode == -signal.SIGINT
    reached = step_of(out)
    assert f"run: a checkpoint of step {reached} of 100000; --resume goes on from it" in err
    assert [json.loads(line)["step"] for line in (out / "log.jsonl").read_text().splitlines()][-1] == reached


def test_two_trainings_do_not_share_a_folder(malus, config, tmp_path):
    path, out = config(100000, 2), tmp_path / "run"
    process = start(path, "-o", out)
    wait_for_step(process, out, 2)
    for how in ("--force", "--resume"):
        second = start(path, "-o", out, how)
        assert "run: another training is writing into this folder; wait for its end" in second.communicate(timeout=60)[1]
        assert second.returncode == 1
    assert process.poll() is None
    # What a killed run leaves holds nobody up.
    process.send_signal(signal.SIGKILL)
    process.communicate()
    reached = step_of(out)
    process = start(path, "-o", out, "--resume")
    wait_for_step(process, out, reached + 2)
    process.send_signal(signal.SIGINT)
    process.communicate(timeout=60)
    assert process.returncode == -signal.SIGINT
    assert not (out / ".lock").exists()


def free_port():
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        return s.getsockname()[1]


def start_two(path, out, rank="RANK", size="WORLD_SIZE", resume=False, second=()):
    """second: what worker 1 alone is told besides."""
    port = str(free_port())
    return [  # only worker 0 needs the folder
        start(path, "-o", out if i == 0 else out / "elsewhere", *(["--resume"] if resume else []), *(second if i else ()),
              **{rank: str(i), size: "2", "MASTER_ADDR": "127.0.0.1", "MASTER_PORT": port, "GLOO_SOCKET_IFNAME": "lo",
                 # On one GPU: NCCL takes two workers there only for those of two hosts.
                 "NCCL_HOSTID": f"host{i}", "NCCL_SOCKET_IFNAME": "lo"})
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
def test_two_workers_have_the_gradients_of_one_with_the_whole_batch(malus, config, tmp_path, monkeypatch, rank, size):
    monkeypatch.setenv("NVIDIA_TF32_OVERRIDE", "0")  # on a GPU: ten bits would not show the seventh digit
    path = config(1)
    malus("train", path, "-o", tmp_path / "one", "--threads", "1")
    for process in start_two(path, tmp_path / "two", rank, size):
        out, err = process.communicate(timeout=120)
        assert process.returncode == 0, err
    for process in start_two(path, tmp_path / "two", rank, size, resume=True):  # at its end already
        out, err = process.communicate(timeout=120)
        assert process.returncode == 0, err
    one, two = (tensors(tmp_path / name / "checkpoint.safetensors")[0] for name in ("one", "two"))
    gradients = [name for name in one if name.startswith("first_moment/")]
    assert gradients
    for name in gradients:  # after one step the first moment is 0.1 of the gradient
        assert np.abs(10 * one[name] - 10 * two[name]).max() < 1e-6, name
    assert max(np.abs(one[name]).max() for name in gradients) > 1e-4


@pytest.mark.parametrize("second,setting", [(("--set", "train.learning_rate=0.1"), "train.learning_rate"),
                                            (("--set", "network.width=8"), "network.width"), (("--seed", "7"), "seed")])
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
    assert [process.wait(60) for process in again] == [-signal.SIGINT] * 2
    assert not (out / "elsewhere").exists()


@pytest.mark.parametrize("rank,sent,code", [("0", signal.SIGINT, -signal.SIGINT), ("1", signal.SIGTERM, 130)])
def test_a_worker_that_waits_for_the_others_can_be_stopped(config, tmp_path, rank, sent, code):
    out, port = tmp_path / "run", str(free_port())
    arguments = [PROGRAM, "train", config(3), "-o", out, "--set", "train.timeout=60", "--threads", "1"]
    process = subprocess.Popen(list(map(str, arguments)), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
                               env={**os.environ, "RANK": rank, "WORLD_SIZE": "3", "MASTER_PORT": port})
    awaited = "2 workers" if rank == "0" else "worker 0"
    assert process.stderr.readline().strip() == f"waiting for {awaited} at 127.0.0.1:{port}"
    process.send_signal(sent)
    try:
        _, err = process.communicate(timeout=10)
    finally:
        process.kill()
    assert process.returncode == code and err.count("\n") == 1, err
    assert not out.exists()


def test_a_worker_that_finds_nobody_says_so_in_time(config, tmp_path):
    begun = time.time()
    process = start(config(3), "-o", tmp_path / "run", "--set", "train.timeout=2",
                    RANK="0", WORLD_SIZE="2", MASTER_PORT=str(free_port()))
    _, err = process.communicate(timeout=30)
    assert process.returncode == 1 and "worker 0 of 2: does not meet the others" in err and err.count("\n") == 1, err
    assert time.time() - begun < 12


def test_a_worker_whose_step_cannot_end_leaves_with_a_checkpoint(malus, config, tmp_path):
    out = tmp_path / "run"
    path = config(100000, 100000, CONFIG.replace("timeout = 20", "timeout = 300"))
    workers = start_two(path, out)
    while not (out / "log.jsonl").exists() or len((out / "log.jsonl").read_text().splitlines()) < 5:
        assert [worker.poll() for worker in workers] == [None, None]
        time.sleep(0.01)
    workers[1].send_signal(signal.SIGSTOP)
    try:
        workers[0].send_signal(signal.SIGINT)
        _, err = workers[0].communicate(timeout=30)
    finally:
        workers[1].send_signal(signal.SIGKILL)
        workers[1].communicate()
    assert workers[0].returncode == -signal.SIGINT, err
    # The checkpoint is that of the last step that was ended.
    reached = step_of(out)
    assert reached == len((out / "log.jsonl").read_text().splitlines()) >= 5
    assert not (out / "weights.safetensors").exists()


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
        ("gains = [6, 12]", "gains = [6, 90]", "config.toml: 90 dB: outside the calibrated range"),
        ("levels = 2", "levels = 40", 'config.toml:3: architecture in [network]: settings of unet: "levels"'),
        ("batch = 4", 'device = "cuda"\nprecision = "half"', "precision"),
        ("[train]", "[train", "config.toml"),
        ("batch = 4", "batch = 1.5", "config.toml:23: batch in [train] is not a whole number in plain digits; give 1 to 65536"),
        ('["scene"]', "[]", "config.toml:10: scenes in [data] is an empty list"),
        ('scenes = ["scene"]', 'scenes = ["scene"]\ntone = "srbg"', 'did you mean "srgb"? known: auto, srgb, linear'),
        ("[train]", '[validation]\nscenes = ["scene"]\ncases = ["90:10"]\n[train]', "config.toml: 90 dB: outside the calibrated range"),
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
