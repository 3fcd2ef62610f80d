"""`cmake --install` gives a program that runs and a library that a project of its own can use."""

import subprocess

import pytest

from conftest import BUILD, ROOT


@pytest.fixture(scope="module")
def prefix(tmp_path_factory):
    folder = tmp_path_factory.mktemp("prefix")
    subprocess.run(["cmake", "--install", BUILD, "--prefix", folder], check=True, capture_output=True)
    return folder


@pytest.mark.slow
def test_installed_program_runs(prefix):
    done = subprocess.run([prefix / "bin/malus", "model", "list"], capture_output=True, text=True)
    assert done.returncode == 0 and "imx250myr-simulated" in done.stdout


@pytest.mark.slow
def test_a_project_of_its_own_builds_and_runs(prefix, tmp_path):
    source = ROOT / "examples/cpp"
    lines = [line for line in (source / "noisy_frame.cpp").read_text().splitlines() if line.strip()]
    assert len(lines) < 30
    subprocess.run(["cmake", "-S", source, "-B", tmp_path, "-G", "Ninja", "-DCMAKE_BUILD_TYPE=Release",
                    f"-DCMAKE_PREFIX_PATH={prefix}"], check=True, capture_output=True)
    subprocess.run(["cmake", "--build", tmp_path], check=True, capture_output=True)
    done = subprocess.run([tmp_path / "noisy_frame"], capture_output=True, text=True, check=True)
    denoised = float(done.stdout.split("denoised")[1].split()[0])
    # The simulated sensor's bias is taken away again; what is left of the noise is small.
    assert abs(denoised - 200) < 15
