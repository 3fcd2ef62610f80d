"""Runs the program as a user would. MALUS_PROGRAM names it; ./test sets it."""

import json
import os
import pathlib
import subprocess

import pytest

ROOT = pathlib.Path(__file__).resolve().parents[2]
PROGRAM = os.environ.get("MALUS_PROGRAM", str(ROOT / "build/release/malus"))
BUILD = pathlib.Path(os.environ.get("MALUS_BUILD", str(pathlib.Path(PROGRAM).parent)))
needs_networks = pytest.mark.skipif(not (BUILD / "malus_networks.so").exists(), reason="built without networks (libtorch is missing)")


def pytest_configure(config):
    config.addinivalue_line("markers", "slow: left out by ./test QUICK")
    config.addinivalue_line("markers", "alone: races with a running program or with time; ./test runs nothing beside it")


class Result:
    def __init__(self, done):
        self.code, self.out, self.err = done.returncode, done.stdout, done.stderr

    @property
    def json(self):
        return json.loads(self.out)


@pytest.fixture(scope="session")
def malus():
    """malus(*arguments, code=0) runs the program, checks the exit code and returns Result."""

    def run(*arguments, code=0, **options):
        options.setdefault("timeout", 600)
        done = subprocess.run([PROGRAM, *map(str, arguments)], capture_output=True, text=True, **options)
        assert done.returncode == code, f"malus {' '.join(map(str, arguments))}\nexit {done.returncode}\n{done.stderr}"
        return Result(done)

    return run


@pytest.fixture
def refused(malus):
    """refused(*arguments): exit code 1 and exactly one line on stderr, which is returned."""

    def run(*arguments, **options):
        result = malus(*arguments, code=1, **options)
        lines = [line for line in result.err.splitlines() if not line.startswith("warning:")]
        assert len(lines) == 1, result.err
        assert lines[0].startswith("malus: ") and lines[0].count("; ") >= 1, lines[0]
        assert result.out == ""
        return lines[0]

    return run


@pytest.fixture
def misused(malus):
    """misused(*arguments): exit code 2, of what no file could make right; the line on stderr, which --help follows, is returned."""

    def run(*arguments, **options):
        result = malus(*arguments, code=2, **options)
        line, helped = result.err.splitlines()
        assert line.startswith("malus: ") and helped == "Run with --help for usage."
        assert result.out == ""
        return line

    return run


@pytest.fixture
def shared():
    """The reference data; tests skip where it is absent."""
    folder = pathlib.Path(os.environ.get("MALUS_SHARED_DATA", ROOT.parent / "shared" / "data"))
    if not folder.is_dir():
        pytest.skip("needs ../shared/data")
    return folder


@pytest.fixture
def examples():
    return ROOT / "examples"


@pytest.fixture
def small_disk(tmp_path):
    """A folder with room for 128 KiB."""
    folder = tmp_path / "small"
    folder.mkdir()
    if subprocess.run(["mount", "-t", "tmpfs", "-o", "size=128k", "none", folder], capture_output=True).returncode != 0:
        pytest.skip("needs the right to mount a small file system")
    yield folder
    subprocess.run(["umount", folder], check=False)
