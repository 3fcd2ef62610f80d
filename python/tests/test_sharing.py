"""Memory, threads, processes and numbers that two uses of the module might share."""

import os
import subprocess
import sys
import pathlib

import numpy as np
import pytest

malus = pytest.importorskip("malus", reason="the Python module is not built (pybind11 is missing)")


@pytest.fixture(scope="module")
def model():
    return malus.Model("imx250myr-simulated")


def test_out_may_be_clean_or_apart_from_it(model):
    whole = np.full((64, 64), 100, np.float32)
    expected = model.synthesize(whole[:32, :32], gain=12, seed=1)
    beside = np.full((32, 64), 100, np.float32)
    model.synthesize(beside[:, :32], gain=12, seed=1, out=beside[:, 32:])  # one block, no pixel in common
    assert np.array_equal(beside[:, 32:], expected) and (beside[:, :32] == 100).all()
    model.synthesize(beside[:, :32], gain=12, seed=1, out=beside[:, :32])
    assert np.array_equal(beside[:, :32], expected)
    packed = np.full((16, 8, 8), 100, np.float32)
    drawn = model.synthesize(packed, gain=12, seed=1)
    assert np.array_equal(model.synthesize(packed, gain=12, seed=1, out=packed), drawn)


@pytest.mark.parametrize("clean, out", [
    (np.s_[:32], np.s_[1:33]), (np.s_[1:33], np.s_[:32]), (np.s_[:32], np.s_[0:64:2])])
def test_out_that_overlaps_clean_is_refused(model, clean, out):
    rows = np.full((64, 64), 100, np.float32)
    with pytest.raises(malus.InputError, match="^out: overlaps clean in part; give clean itself, or an array that"):
        model.synthesize(rows[clean], gain=12, out=rows[out])
    assert (rows == 100).all()


def test_batches_that_overlap_are_refused(model):
    batch = np.full((3, 16, 8, 8), 100, np.float32)
    with pytest.raises(malus.InputError, match="overlaps"):
        model.synthesize(batch[:2], gain=12, out=batch[1:])


def test_frame_numbers_do_not_come_round(model):
    batch = np.zeros((3, 16, 4, 4), np.float32)
    last = 2**32 - 1
    model.synthesize(batch, gain=12, frame=last - 2)
    with pytest.raises(malus.InputError, match=f"frame {last - 1}: leaves no 3 numbers .* begin at {last - 2} or below"):
        model.synthesize(batch, gain=12, frame=last - 1)
    with pytest.raises(malus.InputError, match="repeats its noise"):
        model.at_gain(12).synthesize(batch, frame=last)


FORKS = """
import os, signal, sys, threading
import numpy as np
import malus

model = malus.Model("imx250myr-simulated")
clean = np.full((16, 16), 100, np.float32)
noise = model.at_gain(None, parameters="mean")
expected = model.synthesize(clean, gain=12, seed=1)
stop = threading.Event()

def draw(first):
    frame = first
    while not stop.is_set():
        noise.synthesize(clean, 1, frame)
        frame += 1

threads = [threading.Thread(target=draw, args=(i * 100000,)) for i in range(6)]
for thread in threads: thread.start()
bad = 0
for i in range(FORKS):
    child = os.fork()
    if child == 0:
        signal.alarm(20)
        noise.synthesize(clean, 1, i)
        os._exit(0 if np.array_equal(model.synthesize(clean, gain=12, seed=1), expected) else 1)
    bad += os.waitpid(child, 0)[1] != 0
    if bad: break
stop.set()
for thread in threads: thread.join()
sys.exit(bad)
"""


READERS = """
import os, signal, sys
import malus

frame = malus.load_frame(sys.argv[1])
child = os.fork()
if child == 0:
    signal.alarm(20)
    os._exit(0 if (malus.load_frame(sys.argv[1]).dn == frame.dn).all() else 1)
sys.exit(os.waitpid(child, 0)[1] != 0)
"""


def test_a_forked_worker_reads_an_exr_as_its_parent_did(tmp_path):
    """OpenEXR keeps threads, which a forked process has not."""
    program = pathlib.Path(os.environ.get("MALUS_PROGRAM", pathlib.Path(malus.__file__).parents[2] / "malus"))
    if not program.exists():
        pytest.skip("needs the program")
    np.save(tmp_path / "picture.npy", np.random.default_rng(1).uniform(0, 1, (64, 64)).astype(np.float32))
    subprocess.run([program, "simulate", tmp_path / "picture.npy", "--layout", "polar-mono", "--format", "exr", "-o", tmp_path], check=True)
    path = tmp_path / "picture_clean.exr"
    paths = {"PYTHONPATH": str(pathlib.Path(malus.__file__).parents[1])}
    done = subprocess.run([sys.executable, "-c", READERS, path], env=paths, timeout=300)
    assert done.returncode == 0


def test_a_fork_while_others_draw_does_not_hang():
    """Every child draws at the gains that six threads of its parent are drawing at."""
    paths = {"PYTHONPATH": str(pathlib.Path(malus.__file__).parents[1])}
    done = subprocess.run([sys.executable, "-c", FORKS.replace("FORKS", "150")], env=paths, timeout=300)
    assert done.returncode == 0
