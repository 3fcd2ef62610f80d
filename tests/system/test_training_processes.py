"""`malus train` as processes that are killed, interrupted, or several: every test races with a running program."""

import json
import os
import pathlib
import signal
import socket
import subprocess
import time

import numpy as np
import pytest

from conftest import PROGRAM, needs_networks
from training_files import CONFIG, SMALL_NETWORK, config, same, tensors  # noqa: F401 (a fixture)

pytestmark = [pytest.mark.slow, pytest.mark.alone, needs_networks]


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


def same_gradients(*folders):
    one, two = (tensors(folder / "checkpoint.safetensors")[0] for folder in folders)
    gradients = [name for name in one if name.startswith("first_moment/")]
    assert gradients
    for name in gradients:  # after one step the first moment is 0.1 of the gradient
        assert np.abs(10 * one[name] - 10 * two[name]).max() < 1e-6, name
    assert max(np.abs(one[name]).max() for name in gradients) > 1e-4


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
    same_gradients(tmp_path / "one", tmp_path / "two")


PAIRS = SMALL_NETWORK + """[data]
pairs = ["pairs.json"]
example = 64
patch = 64
pool = 3
[noise]
models = ["imx250mzr-simulated"]
[train]
steps = {steps}
checkpoint_every = {checkpoint_every}
batch = 4
warm_up = 0
loss = "{{loss}}"
timeout = 20
"""


@pytest.mark.parametrize("loss", ["l1", "stokes"])
def test_two_workers_share_a_batch_whose_patches_are_not_known_alike(malus, config, tmp_path, monkeypatch, loss):
    monkeypatch.setenv("NVIDIA_TF32_OVERRIDE", "0")
    random = np.random.default_rng(5)
    pairs = []
    for white_columns in (0, 20, 56):
        reference = random.uniform(300, 500, (64, 64)).astype(np.float32)
        np.save(tmp_path / f"short{white_columns}.npy", reference + random.normal(0, 20, (64, 64)).astype(np.float32))
        reference[:, :white_columns] = 5000
        np.save(tmp_path / f"reference{white_columns}.npy", reference)
        pairs.append({"short": f"short{white_columns}.npy", "reference": f"reference{white_columns}.npy", "ratio": 1, "gain_db": 12, "iso": None})
    (tmp_path / "pairs.json").write_text(json.dumps({"pairs": pairs}))
    path = config(1, text=PAIRS.replace("{{loss}}", loss))
    malus("train", path, "-o", tmp_path / "one", "--threads", "1")
    for process in start_two(path, tmp_path / "two"):
        out, err = process.communicate(timeout=120)
        assert process.returncode == 0, err
    same_gradients(tmp_path / "one", tmp_path / "two")


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
    process = start(config(3), "-o", tmp_path / "run", "--set", "train.timeout=2",
                    RANK="0", WORLD_SIZE="2", MASTER_PORT=str(free_port()))
    _, err = process.communicate(timeout=30)
    assert process.returncode == 1 and "worker 0 of 2: does not meet the others" in err and err.count("\n") == 1, err


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
