"""The stubs say what the module does: by mypy's stubtest, by the docstrings, and for a strict user."""

import ast
import importlib.util
import os
import pathlib
import re
import subprocess
import sys

import pytest

malus = pytest.importorskip("malus", reason="the Python module is not built (pybind11 is missing)")

STUBS = ast.parse((pathlib.Path(malus.__file__).parent / "_malus.pyi").read_text())
needs_mypy = pytest.mark.skipif(importlib.util.find_spec("mypy") is None, reason="needs mypy")

USE = """
import malus
import numpy as np

model = malus.Model("imx250myr-simulated")
clean = np.zeros((16, 8, 8), np.float32)
noisy = model.synthesize(clean, gain=24, seed=1, ratio=10)
again = model.at_gain(24, read=False).synthesize(clean, out=noisy)
gain: float = model.random_gain(0, 1)
frame = malus.load_frame("x.png", layout="mono")
level: float = frame.black_dn[0] + again.mean()
of_array = malus.Frame(np.zeros((8, 8), np.uint16), "polar-mono", black=np.array([82.0, 82, 83, 82]), white=np.float32(4095))
again_of_array = malus.Frame(of_array.dn, "polar-mono", black=of_array.black_dn, white=4095)
kinds: list[str] = [group.kind for group in malus.Session("session.toml").groups]
"""


def run_mypy(tmp_path, *arguments):
    package = pathlib.Path(malus.__file__).parent
    return subprocess.run([sys.executable, "-m", *arguments], cwd=tmp_path, capture_output=True, text=True,
                          env={**os.environ, "MYPYPATH": str(package.parent), "PYTHONPATH": str(package.parent)})


# Types that only the stubs need; pybind11's metaclass, and its constructor that refuses.
ALLOWED = r"""
malus\._malus\.(DLPack|Arrays|Floats|Frames|Levels|Out)
malus(\._malus)?\.(Frame|FrameGroup|FrameSet|Model|Noise|Session)
malus(\._malus)?\.(FrameGroup|Noise)\.__init__
"""


@needs_mypy
def test_stubtest_finds_no_difference(tmp_path):
    (tmp_path / "allowed").write_text(ALLOWED)
    done = run_mypy(tmp_path, "mypy.stubtest", "malus", "--allowlist", "allowed", "--ignore-unused-allowlist")
    assert done.returncode == 0, done.stdout + done.stderr


@needs_mypy
def test_a_strict_user_is_content(tmp_path):
    (tmp_path / "use.py").write_text(USE)
    done = run_mypy(tmp_path, "mypy", "--strict", "--cache-dir", str(tmp_path / "cache"), "use.py")
    assert done.returncode == 0, done.stdout + done.stderr


@needs_mypy
def test_a_strict_user_hears_of_mistakes(tmp_path):
    (tmp_path / "use.py").write_text(USE + 'model.synthesize(clean, gian=24)\nmodel.synthesize(clean, gain="24")\n')
    done = run_mypy(tmp_path, "mypy", "--strict", "--cache-dir", str(tmp_path / "cache"), "use.py")
    assert done.returncode == 1 and "use.py:15:" in done.stdout and "Found 2 errors" in done.stdout


def functions():
    for node in STUBS.body:
        if isinstance(node, ast.FunctionDef):
            yield node, getattr(malus, node.name)
        elif isinstance(node, ast.ClassDef) and node.name in malus.__all__:
            for child in node.body:
                if isinstance(child, ast.FunctionDef) and (not child.decorator_list or is_overload(child)):
                    yield child, getattr(getattr(malus, node.name), child.name)


def is_overload(node):
    return any(getattr(decorator, "id", "") == "overload" for decorator in node.decorator_list)


@pytest.mark.parametrize("stub, real", functions(), ids=lambda item: getattr(item, "name", ""))
def test_arguments_of_stub_and_docstring_are_the_same(stub, real):
    arguments = stub.args
    names = [a.arg for a in arguments.args + arguments.kwonlyargs]
    first, _, rest = real.__doc__.partition("\n")
    documented = re.findall(r"[(,] ?(\w+)(?=:)", re.sub(r"\[[^\]]*\]", "", first))
    settings = re.findall(r"^    (\w+) = ", rest, re.MULTILINE)
    assert sorted(names) == sorted(documented + settings)


def test_stubs_name_everything_that_the_module_has():
    named = {node.name for node in STUBS.body if isinstance(node, (ast.FunctionDef, ast.ClassDef))}
    assert named - {"DLPack", "Frames"} == set(malus.__all__)
    assert set(malus.__all__) == {name for name in vars(malus._malus) if not name.startswith("_")}
    for node in STUBS.body:
        if isinstance(node, ast.ClassDef) and node.name in malus.__all__:
            members = {child.name for child in node.body if isinstance(child, ast.FunctionDef) and not child.name.startswith("__")}
            assert members == {name for name in vars(getattr(malus, node.name)) if not name.startswith("_")}


def test_everything_is_documented():
    for name in malus.__all__:
        thing = getattr(malus, name)
        assert thing.__doc__ and len(thing.__doc__) > 20, name
        for member, value in vars(thing).items() if isinstance(thing, type) else ():
            assert member.startswith("_") or value.__doc__, f"{name}.{member}"
