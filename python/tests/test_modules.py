"""What the Python module is linked to, and what it opens on first need: the networks, found beside it."""

import pathlib
import re
import shutil
import subprocess
import sys

import pytest

malus = pytest.importorskip("malus", reason="the Python module is not built (pybind11 is missing)")

ROOT = pathlib.Path(__file__).resolve().parents[2]
PACKAGE = pathlib.Path(malus.__file__).parent
MODULE = next(PACKAGE.glob("_malus*.so"))
PICTURE = ROOT / "examples/imx250mzr/fruits.png"


def beside(name):
    """In the package itself, or in the build folder that it lies in."""
    return next((folder / name for folder in (PACKAGE, PACKAGE.parents[1]) if (folder / name).exists()), None)


def python(code, folder=PACKAGE.parent, **options):
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=300,
                          env={"PYTHONPATH": str(folder), "PATH": "/usr/bin:/bin"}, **options)


@pytest.fixture
def lone_package(tmp_path):
    """The package without the module that it opens."""
    shutil.copytree(PACKAGE, tmp_path / "a/b/malus", ignore=shutil.ignore_patterns("malus_*.so", "__pycache__"))
    return tmp_path / "a/b/malus"


def denoise_by_network(folder):
    code = f"""
import malus, numpy as np
malus.denoise(np.full((64, 64), 500, np.uint16), layout="bayer-rggb", black=100, white=4095,
              method={str(ROOT / "models/bayer.safetensors")!r})"""
    return python(code, folder)


def test_the_module_starts_without_heavy_libraries():
    """Each command and each import waits for what is linked: a codec that brings two hundred libraries takes a second."""
    needed = subprocess.run(["ldd", MODULE], capture_output=True, text=True, check=True).stdout
    assert "libtbb" in needed and "torch" not in needed
    assert needed.count("=>") < 60


def test_pictures_are_found_from_any_folder(lone_package, tmp_path):
    """Also where the package was found by a relative path, and the process went elsewhere before the first picture."""
    done = python(f"import malus, os; os.chdir('/'); print(malus.load_frame({str(PICTURE)!r}).dn.shape)", "a/b", cwd=tmp_path)
    assert done.stdout == "(2048, 2448)\n", done.stderr


def test_a_package_alone_says_what_a_network_needs(lone_package):
    done = denoise_by_network(lone_package.parent)
    assert "the Python module was built without them; install libtorch-dev and build again" in done.stderr.splitlines()[-1]


def test_a_module_of_other_headers_is_refused(lone_package):
    """Both share objects: one that was built before a header changed must not be called."""
    header = PACKAGE.parents[1] / "generated/malus_modules_interface.h"
    if not header.exists() or not beside("malus_networks.so"):
        pytest.skip("needs the build folder, and networks in it")
    stamp = bytes.fromhex(re.search(r"0x([0-9a-f]{16});", header.read_text()).group(1))[::-1]
    module = beside("malus_networks.so").read_bytes()
    assert stamp in module
    (lone_package / "malus_networks.so").write_bytes(module.replace(stamp, bytes(8)))
    done = denoise_by_network(lone_package.parent)
    assert done.stderr.splitlines()[-1].endswith("is of another version than the Python module; build both again")
