"""`pip install .` with the system's tools, without network, into an environment of its own."""

import os
import pathlib
import shutil
import subprocess
import sys
import zipfile

import pytest

ROOT = pathlib.Path(__file__).resolve().parents[2]
BUILD = pathlib.Path(os.environ.get("MALUS_BUILD", ROOT / "build/release"))
pytestmark = pytest.mark.slow

USE = f"""
import malus, numpy as np
assert malus.load_frame({str(ROOT / "examples/imx250mzr/fruits.png")!r}).dn.shape == (2048, 2448)
assert np.std(malus.Model("imx250myr-simulated").synthesize(np.zeros((8, 8), np.float32), gain=24)) > 1
print(malus.__file__)
"""


@pytest.fixture(scope="module")
def environment(tmp_path_factory):
    folder = tmp_path_factory.mktemp("pip") / "venv"
    done = subprocess.run([sys.executable, "-m", "venv", "--system-site-packages", folder], capture_output=True, text=True)
    if done.returncode:
        pytest.skip("needs python3-venv")
    return folder


def pip(environment, *arguments, build=str(BUILD)):
    # An index that does not answer: nothing may be downloaded.
    return subprocess.run([environment / "bin/pip", *arguments], capture_output=True, text=True, cwd=ROOT,
                          env={**os.environ, "PIP_INDEX_URL": "http://127.0.0.1:9/", "PIP_RETRIES": "0",
                               "PIP_DISABLE_PIP_VERSION_CHECK": "1", "PYTHONPATH": "", "MALUS_BUILD_DIR": build})


@pytest.mark.parametrize("build", [
    pytest.param(str(BUILD), id="of the build that is tested"),
    pytest.param("", id="from the sources", marks=pytest.mark.skipif(
        shutil.which("ccache") is None, reason="needs ccache: without it everything is compiled once more")),
])
def test_pip_install(environment, tmp_path, build):
    done = pip(environment, "install", ".", build=build)
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-3000:]
    used = subprocess.run([environment / "bin/python", "-c", USE], capture_output=True, text=True, cwd=tmp_path,
                          env={"PATH": os.environ["PATH"]})
    assert used.returncode == 0, used.stderr
    assert str(environment) in used.stdout
    shown = pip(environment, "show", "--files", "malus").stdout
    assert "Name: malus" in shown and "_malus.pyi" in shown
    assert pip(environment, "uninstall", "-y", "malus").returncode == 0
    assert not list(environment.glob("lib/python3*/site-packages/malus/*"))


def test_wheel_holds_what_its_record_says(environment, tmp_path):
    done = pip(environment, "wheel", "--no-deps", "--no-build-isolation", "-w", tmp_path, ".")
    assert done.returncode == 0, done.stderr[-3000:]
    with zipfile.ZipFile(next(tmp_path.glob("malus-*.whl"))) as wheel:
        record = next(name for name in wheel.namelist() if name.endswith("RECORD"))
        listed = {line.split(",")[0] for line in wheel.read(record).decode().splitlines()}
        assert listed == set(wheel.namelist())
        assert any(name.startswith("malus/_malus.") and name.endswith(".so") for name in listed)


@pytest.mark.skipif(shutil.which("git") is None or not (ROOT / ".git").exists(), reason="needs a git checkout")
def test_source_archive_holds_the_sources(tmp_path):
    done = subprocess.run([sys.executable, "-c", f"import build_backend; print(build_backend.build_sdist({str(tmp_path)!r}))"],
                          cwd=ROOT / "python", capture_output=True, text=True, check=True)
    listed = subprocess.run(["tar", "-tzf", tmp_path / done.stdout.strip()], capture_output=True, text=True, check=True).stdout
    assert "/CMakeLists.txt" in listed and "/PKG-INFO" in listed and "/python/build_backend.py" in listed
