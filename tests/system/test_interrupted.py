"""Wherever a run is stopped, what is left is whole and belongs together; what would stop it late is refused early."""

import json
import os
import pathlib
import resource
import signal
import subprocess
import time

import numpy as np
import pytest
from PIL import Image

from conftest import PROGRAM

SENSOR = '[sensor]\nlayout = "polar-mono"\nblack = 64\nwhite = 4095\n'


def frames(folder, kind, scene, level, light):
    np.save(folder / f"{kind}_{level}.npy", (64 + light).astype(np.uint16))
    return f'[[frames]]\nkind = "{kind}"\ngain_db = 0\nlevel = {level}\nexposure_s = {scene[kind]}\npaths = ["{kind}_{level}.npy"]\n'


def write_session(folder, ratio, second_rows=64):
    """Two scenes; the short frame of the second may have another size."""
    light = np.random.default_rng(1).uniform(200, 3000, (64, 64))
    seconds = {"reference": 0.1, "short": 0.1 / ratio}
    sections = [frames(folder, "reference", seconds, level, light) for level in (0, 1)]
    sections += [frames(folder, "short", seconds, 0, light / ratio), frames(folder, "short", seconds, 1, light[:second_rows] / ratio)]
    (folder / "session.toml").write_text(SENSOR + "".join(sections))
    return folder / "session.toml"


@pytest.mark.alone
def test_an_interrupted_run_leaves_whole_files_only(tmp_path):
    for i in range(40):
        Image.fromarray(np.random.default_rng(1).integers(20, 200, (64, 64), dtype=np.uint8)).save(tmp_path / f"f{i}.png")
    out = tmp_path / "out"
    given = ["--layout", "polar-mono", "--black", "0", "--white", "255", "--model", "imx250mzr-simulated", "--gain", "12"]  # frames this small do not tell their noise
    results = lambda: [path for path in out.glob("*_denoised.tif") if path.name[0] != "."]  # a file being written is hidden
    process = subprocess.Popen([PROGRAM, "denoise", *map(str, sorted(tmp_path.glob("f*.png"))), *given, "-o", str(out)],
                               stderr=subprocess.DEVNULL, stdout=subprocess.DEVNULL)
    while process.poll() is None and len(results()) < 2:
        pass
    process.kill()
    process.wait()
    written = results()
    assert len(written) >= 2
    for path in written:
        assert np.array(Image.open(path)).shape == (64, 64)


@pytest.fixture
def long_run(tmp_path):
    """Arguments of a run that writes into tmp_path / out for seconds; `started` waits for its second file."""
    for i in range(200):
        Image.fromarray(np.random.default_rng(1).integers(20, 200, (64, 64), dtype=np.uint8)).save(tmp_path / f"f{i:03}.png")
    run = [PROGRAM, "denoise", *sorted(tmp_path.glob("f*.png")), "--layout", "polar-mono", "--black", "0", "--white", "255",
           "--model", "imx250mzr-simulated", "--gain", "12", "-q", "-o"]

    def started(out, process):
        while len(list(out.glob("f*_denoised.tif"))) < 2:
            assert process.poll() is None
            time.sleep(0.001)

    return list(map(str, run)), started


def check_stopped(out, err):
    """Whole files alone, and one line."""
    assert err == "malus: stopped on request; finished outputs are whole, none is half-written\n"
    assert 2 <= len(list(out.glob("f*_denoised.tif"))) < 200
    assert not list(out.glob(".*"))
    for path in out.glob("f*_denoised.tif"):
        assert np.array(Image.open(path)).shape == (64, 64)


@pytest.mark.alone
def test_ctrl_c_ends_a_shells_loop(long_run, tmp_path):
    run, started = long_run
    loop = 'for i in 0 1 2; do "$@" "out$i"; done; echo went on'
    # Tests that run in the background of a script have inherited that Ctrl-C is ignored, which no shell can undo.
    shell = subprocess.Popen(["bash", "-c", loop, "bash", *run], cwd=tmp_path, start_new_session=True, stdout=subprocess.PIPE,
                             stderr=subprocess.PIPE, text=True, preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL))
    started(tmp_path / "out0", shell)
    os.killpg(shell.pid, signal.SIGINT)
    out, err = shell.communicate(timeout=60)
    assert shell.returncode == -signal.SIGINT and "went on" not in out
    check_stopped(tmp_path / "out0", err)
    assert not (tmp_path / "out1").exists()


@pytest.mark.alone
@pytest.mark.parametrize("sent,code", [(signal.SIGINT, -signal.SIGINT), (signal.SIGTERM, 130)])
def test_stopped_by_a_signal(long_run, tmp_path, sent, code):
    run, started = long_run
    process = subprocess.Popen([*run, tmp_path / "out"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    started(tmp_path / "out", process)
    process.send_signal(sent)
    out, err = process.communicate(timeout=60)
    assert process.returncode == code
    assert out.count("\n") == len(list((tmp_path / "out").glob("f*_denoised.tif")))
    check_stopped(tmp_path / "out", err)


@pytest.mark.alone
@pytest.mark.parametrize("sent", ["INT", "TERM"])
def test_a_shell_calls_it_130(long_run, tmp_path, sent):
    run, started = long_run
    shell = subprocess.Popen(["bash", "-c", 'bash -c "echo \\$\\$; exec \\"\\$@\\"" bash "$@"; echo $?', "bash", *run, tmp_path / "out"],
                             stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    program = int(shell.stdout.readline())
    started(tmp_path / "out", shell)
    os.kill(program, getattr(signal, f"SIG{sent}"))
    out, err = shell.communicate(timeout=60)
    assert out.splitlines()[-1] == "130"
    check_stopped(tmp_path / "out", err)


def test_a_list_of_pairs_speaks_for_no_frames_of_another_run(malus, refused, tmp_path):
    out = tmp_path / "out"
    malus("pairs", write_session(tmp_path, ratio=10), "-o", out)
    assert [pair["ratio"] for pair in json.loads((out / "pairs.json").read_text())["pairs"]] == [pytest.approx(10)] * 2
    before = (out / "scene000_00_short.tif").read_bytes()
    session = write_session(tmp_path, ratio=40, second_rows=32)
    assert "another size than its reference" in refused("pairs", session, "-o", out, "--force")
    short = out / "scene000_00_short.tif"
    assert not short.exists() or short.read_bytes() != before
    assert not (out / "pairs.json").exists()


def test_a_session_that_is_refused_at_once_leaves_the_list(malus, refused, tmp_path):
    out = tmp_path / "out"
    session = write_session(tmp_path, ratio=10)
    malus("pairs", session, "-o", out)
    before = (out / "pairs.json").read_bytes()
    session.write_text(session.read_text().replace("exposure_s = 0.01", "exposure_s = 0.5"))
    assert "longer than their reference" in refused("pairs", session, "-o", out, "--force")
    assert (out / "pairs.json").read_bytes() == before


@pytest.mark.alone
def test_a_killed_replacement_leaves_no_parts_of_the_run_before(malus, tmp_path):
    np.save(tmp_path / "raw.npy", np.random.default_rng(2).normal(300, 20, (768, 768)).clip(0).astype(np.uint16))
    run = ["denoise", "raw.npy", "--layout", "polar-bayer-rggb", "--model", "imx250myr-simulated", "--profile", "fast", "-o", "out"]
    old = json.loads(malus(*run, "--uncertainty", "--planes", "--u16", "--gain", 12, "--json", cwd=tmp_path).out)
    parts = [tmp_path / name for name in old["files"][1:]] + [tmp_path / "out/raw_denoised.json"]
    assert len(parts) == 4 and all(part.exists() for part in parts)
    mosaic = tmp_path / "out/raw_denoised.tif"
    before, contents = mosaic.stat().st_ino, [part.read_bytes() for part in parts]
    process = subprocess.Popen([PROGRAM, *run, "--uncertainty", "--planes", "--u16", "--gain", "24", "--force", "-q"], cwd=tmp_path)
    deadline = time.monotonic() + 60
    while mosaic.stat().st_ino == before and process.poll() is None and time.monotonic() < deadline:
        time.sleep(0.0005)
    process.kill()
    process.wait()
    assert mosaic.stat().st_ino != before
    for part, content in zip(parts, contents):
        assert not part.exists() or part.read_bytes() != content


def test_a_stream_is_named_as_what_cannot_be_read(tmp_path):
    np.save(tmp_path / "raw.npy", np.zeros((64, 64), np.uint16))
    for command in ("denoise", "stokes", "synthesize"):
        with subprocess.Popen(["cat", tmp_path / "raw.npy"], stdout=subprocess.PIPE) as source:
            done = subprocess.run([PROGRAM, command, "/dev/stdin", "-o", tmp_path / "out", *(["--model", "sony-a7s2"] * (command == "synthesize"))],
                                  stdin=source.stdout, capture_output=True, text=True)
        assert done.returncode == 1 and "not a regular file; copy it to a file first" in done.stderr


def test_names_that_leave_no_room_are_refused_before_the_work(refused, tmp_path):
    np.save(tmp_path / f"{'n' * 235}.npy", np.full((64, 64), 100, np.uint16))
    line = refused("denoise", tmp_path / f"{'n' * 235}.npy", "--layout", "polar-mono", "-o", tmp_path / "out")
    assert "its name is too long" in line and "choose a shorter one" in line


def test_little_address_space_is_enough_for_pictures(tmp_path):
    """Nothing that decodes them asks for threads or memory of its own."""
    Image.fromarray(np.zeros((8, 8), np.uint8)).save(tmp_path / "x.png")
    done = subprocess.run([PROGRAM, "info", tmp_path / "x.png"], capture_output=True, text=True, timeout=60,
                          preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_AS, (500_000_000, 500_000_000)), env={**os.environ, "LC_ALL": "C"})
    assert done.returncode == 0 and done.stderr == ""


@pytest.mark.parametrize("command", ["info", "stokes", "normals", "synthesize", "renoise", "simulate"])
def test_what_was_done_before_an_error_is_said(malus, tmp_path, command):
    """The results of the frames before it are on the disk, and a program that reads --json has to learn of them."""
    rng, folder = np.random.default_rng(2), tmp_path / "out"
    np.save(tmp_path / "good.npy", rng.uniform(300, 900, (64, 64)).astype(np.float32))
    np.save(tmp_path / "bad.npy", np.full((64, 64), np.nan, np.float32))  # its header is that of a frame
    if command == "info":  # which describes any pixels
        (tmp_path / "bad.npy").write_bytes(b"")
    model = ["--model", "imx250mzr-simulated"]
    flags = {"info": [], "synthesize": [*model, "--gain", 12, "--float"], "renoise": [*model, "--from", 6, "--to", 12, "--float"]}
    flags = flags.get(command, ["--layout", "polar-mono"]) + ([] if command == "info" else ["-o", folder])
    stopped = malus(command, *flags, "--json", tmp_path / "good.npy", tmp_path / "bad.npy", code=1)
    assert "bad.npy" in stopped.err.splitlines()[-1]
    (done,) = stopped.json["frames"]
    assert pathlib.Path(done["file" if command == "info" else "input"]) == tmp_path / "good.npy"
    for path in done.get("files", [done["output"]] if "output" in done else []):
        assert pathlib.Path(path).exists()


@pytest.mark.parametrize("command", ["stokes", "normals", "synthesize", "renoise"])
def test_frames_are_looked_for_before_any_work(refused, tmp_path, command):
    np.save(tmp_path / "mosaic.npy", np.full((64, 64), 500, np.float32))
    model = ["--model", "imx250mzr-simulated"]
    flags = {"synthesize": [*model, "--gain", 12], "renoise": [*model, "--from", 6, "--to", 12]}.get(command, ["--layout", "polar-mono"])
    assert "missing.npy: does not exist" in refused(command, *flags, tmp_path / "mosaic.npy", tmp_path / "missing.npy", "-o", tmp_path / "out")
    assert not list(tmp_path.glob("out/*"))
