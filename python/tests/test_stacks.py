"""Frames of stacks: named as in the program, by load_frame, info and sessions."""

import pathlib

import numpy as np
import pytest

malus = pytest.importorskip("malus", reason="the Python module is not built (pybind11 is missing)")


@pytest.fixture
def stack(tmp_path):
    frames = np.random.default_rng(5).integers(60, 4000, (5, 16, 24)).astype(np.uint16)
    np.save(tmp_path / "s.npy", frames)
    return tmp_path / "s.npy", frames


def test_a_frame_is_loaded_by_its_name(stack):
    path, frames = stack
    names = malus.frames(path)
    assert names == [pathlib.Path(f"{path}[{k}]") for k in range(5)]
    assert malus.frames(names[2]) == [names[2]] and malus.frames(str(path)) == names
    for name, frame in zip(names, frames):
        loaded = malus.load_frame(name, "mono", 60)
        assert np.array_equal(loaded.dn, frame) and loaded.source == str(name)
    with pytest.raises(malus.InputError, match=r"s\.npy: it holds 5 frames; name one of them, from s\.npy\[0\] to s\.npy\[4\]"):
        malus.load_frame(path)
    with pytest.raises(malus.InputError, match=r"s\.npy\[5\]: the file holds 5 frames; frames are counted from \[0\] to \[4\]"):
        malus.load_frame(f"{path}[5]")
    with pytest.raises(malus.InputError, match="does not exist"):
        malus.frames("none.npy")


def test_info_describes_the_first_frame_and_counts_them(stack):
    path, frames = stack
    told = malus.info(path)
    assert told["frames_in_file"] == 5 and told["file"] == f"{path}[0]" and told["mean"]["value"] == [pytest.approx(frames[0].mean())]
    assert malus.info(f"{path}[4]")["mean"]["value"] == [pytest.approx(frames[4].mean())]
    assert malus.info(frames[0])["frames_in_file"] == 1


def test_sessions_list_the_frames_of_stacks(stack, tmp_path):
    path, frames = stack
    (tmp_path / "s.toml").write_text('[sensor]\nlayout = "mono"\nblack = 60\n[[frames]]\nkind = "bias"\npaths = ["s.npy[4]", "s.npy[0]"]\n'
                                     '[[frames]]\nkind = "short"\nexposure_s = 0.1\npaths = "s.npy"\n')
    session = malus.Session(tmp_path / "s.toml")
    assert session.groups[0].paths == [pathlib.Path(f"{path}[4]"), pathlib.Path(f"{path}[0]")]
    assert session.groups[1].paths == malus.frames(path)
    assert np.array_equal(session.load(0, 0).dn, frames[4]) and np.array_equal(session.load(1, 3).dn, frames[3])
    assert "7 frames in 2 groups" in repr(session)
