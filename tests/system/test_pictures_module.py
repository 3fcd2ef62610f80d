"""OpenImageIO and LibRaw lie in a module that the program opens with the first picture: what touches none must not wait for
them, and what does must say what is missing."""

import re
import shutil
import subprocess

import numpy as np
import pytest

from conftest import BUILD, PROGRAM, ROOT

PICTURE = ROOT / "examples/imx250mzr/fruits.png"


@pytest.fixture
def lone_program(tmp_path):
    shutil.copy2(PROGRAM, tmp_path / "malus")
    return tmp_path / "malus"


def run(program, *arguments):
    return subprocess.run([program, *map(str, arguments)], capture_output=True, text=True, timeout=60)


def test_the_program_does_not_link_the_codecs():
    needed = subprocess.run(["ldd", PROGRAM], capture_output=True, text=True, check=True).stdout
    assert "libtbb" in needed and "OpenImageIO" not in needed and "libraw" not in needed


def test_a_program_alone_does_without_pictures(lone_program, tmp_path):
    np.save(tmp_path / "x.npy", np.full((64, 64), 500, np.uint16))
    done = run(lone_program, "denoise", tmp_path / "x.npy", "--layout", "bayer-rggb", "--model", "sony-a7s2", "--iso", 1600,
               "--format", "npy", "-o", tmp_path / "out")
    assert done.returncode == 0 and (tmp_path / "out/x_denoised.npy").exists()


def test_a_program_alone_says_what_a_picture_needs(lone_program):
    done = run(lone_program, "info", PICTURE)
    assert done.returncode == 1
    assert done.stderr.count("\n") == 1 and "malus_pictures.so" in done.stderr and "install" in done.stderr


def test_a_module_of_other_headers_is_refused(lone_program, tmp_path):
    digest = re.search(r"0x([0-9a-f]{16});", (BUILD / "generated/malus_modules_interface.h").read_text()).group(1)
    module, stamp = (BUILD / "malus_pictures.so").read_bytes(), bytes.fromhex(digest)[::-1]
    assert stamp in module
    (tmp_path / "malus_pictures.so").write_bytes(module.replace(stamp, bytes(8)))
    done = run(lone_program, "info", PICTURE)
    assert done.returncode == 1 and "is of another version than the program; build both again" in done.stderr
