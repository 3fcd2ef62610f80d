"""What cannot be said on standard error is lost: the work is done all the same, and the exit code is that of the work."""

import shlex
import subprocess

import numpy as np
import pytest
from conftest import PROGRAM

# Standard error on a full disk, alone and where nobody reads results; closed, alone and with standard input.
UNWRITABLE = ["2>/dev/full", ">/dev/null 2>/dev/full", "2>&-", "<&- >/dev/null 2>&-"]


def run(redirected, *arguments, before=""):
    line = f"{before} exec {shlex.join([PROGRAM, *map(str, arguments)])} {redirected}"
    return subprocess.run(["bash", "-c", line], capture_output=True, timeout=600).returncode


@pytest.fixture
def frame(tmp_path):
    path = tmp_path / "frame.npy"
    np.save(path, np.random.default_rng(1).normal(100, 5, (96, 96)).astype(np.float32))
    return path


@pytest.mark.parametrize("redirected", UNWRITABLE)
def test_the_work_is_done_and_its_exit_code_kept(frame, tmp_path, redirected):
    assert run(redirected, "info", tmp_path / "none.npy") == 1
    assert run(redirected, "info", "--no-such-flag") == 2
    assert run(redirected, "info", frame) == 0
    assert run(redirected, "denoise", frame, "-o", tmp_path / "out") == 0  # it warns of the layout, which nobody told
    assert np.load(tmp_path / "frame.npy").shape == (96, 96)
    assert {path.name for path in (tmp_path / "out").iterdir()} == {"frame_denoised.tif", "frame_denoised.json"}


def test_a_log_that_cannot_grow(tmp_path):
    assert run(f">/dev/null 2>{shlex.quote(str(tmp_path / 'log'))}", "info", tmp_path / "none.npy", before="ulimit -f 0;") == 1


@pytest.mark.parametrize("command", [["model", "show", "imx250myr-simulated"], ["model", "show", "imx250myr-simulated", "--json"], ["model", "list"]])
def test_a_result_that_is_cut_short_is_no_success(malus, tmp_path, command):
    """Of more than the buffer, too, whose first part was lost before the last was written."""
    assert run(">/dev/full", *command) == 1
    assert run("", *command) == 0
    if "--json" in command:
        return
    whole = len(malus(*command).out)
    assert run(f">{shlex.quote(str(tmp_path / 'short'))}", *command, before="ulimit -f 4; trap '' XFSZ;") == (whole > 4096)


def test_a_closed_stream_is_no_place_for_a_file(frame, tmp_path):
    """With both closed the first files that are opened would have their numbers, and get what is said."""
    assert run(">&- 2>&-", "denoise", frame, "-o", tmp_path / "closed") == 1  # the result cannot be printed
    assert run("", "denoise", frame, "-o", tmp_path / "open") == 0
    assert (tmp_path / "closed/frame_denoised.tif").read_bytes() == (tmp_path / "open/frame_denoised.tif").read_bytes()
