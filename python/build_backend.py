"""PEP 517: `pip install .` builds the module with the system's CMake and compiler, from the standard library alone.

Build files stay in build/pip-*, so that a second install compiles what changed. CMAKE_ARGS adds options for CMake;
MALUS_BUILD_DIR names a build folder that is configured already, whose module is brought up to date and taken.
"""

import base64
import hashlib
import os
import pathlib
import re
import shlex
import subprocess
import sys
import sysconfig
import tarfile
import zipfile

ROOT = pathlib.Path(__file__).resolve().parents[1]
VERSION = re.search(r"project\(malus VERSION ([\d.]+)", (ROOT / "CMakeLists.txt").read_text())[1]
METADATA = f"""Metadata-Version: 2.1
Name: malus
Version: {VERSION}
Summary: Measure a camera's noise, imitate it and remove it
License: Apache-2.0
Requires-Python: >=3.11
Requires-Dist: numpy
Description-Content-Type: text/markdown

{(ROOT / "README.md").read_text()}"""


def tag():
    interpreter = f"cp{sys.version_info.major}{sys.version_info.minor}"
    return f"{interpreter}-{interpreter}-" + re.sub(r"[^\w]", "_", sysconfig.get_platform())


def build_module():
    """Returns the folder of the built package."""
    if given := os.environ.get("MALUS_BUILD_DIR"):
        subprocess.run(["cmake", "--build", given, "--target", "malus_python"], check=True)
        return pathlib.Path(given) / "python" / "malus"
    build = ROOT / "build" / f"pip-{sys.implementation.cache_tag}"
    generator = ["-G", "Ninja"] if subprocess.run(["ninja", "--version"], capture_output=True).returncode == 0 else []
    subprocess.run(["cmake", "-S", ROOT, "-B", build, *generator, "-DCMAKE_BUILD_TYPE=Release", "-DMALUS_PYTHON=ON",
                    "-DMALUS_BUILD_TESTS=OFF", "-DMALUS_NEURAL=OFF", "-DMALUS_CAPTURE=OFF", "-DMALUS_CUDA=OFF",
                    "-DCMAKE_UNITY_BUILD=ON", "-DCMAKE_DISABLE_PRECOMPILE_HEADERS=ON", f"-DPYTHON_EXECUTABLE={sys.executable}",
                    *shlex.split(os.environ.get("CMAKE_ARGS", ""))], check=True)
    subprocess.run(["cmake", "--build", build, "--target", "malus_python", "--parallel", str(os.cpu_count())], check=True)
    return build / "python" / "malus"


def digest(content):
    return base64.urlsafe_b64encode(hashlib.sha256(content).digest()).rstrip(b"=").decode()


def metadata_files():
    return {"METADATA": METADATA, "WHEEL": f"Wheel-Version: 1.0\nGenerator: malus\nRoot-Is-Purelib: false\nTag: {tag()}\n"}


def prepare_metadata_for_build_wheel(metadata_directory, config_settings=None):
    folder = pathlib.Path(metadata_directory) / f"malus-{VERSION}.dist-info"
    folder.mkdir()
    for name, text in metadata_files().items():
        (folder / name).write_text(text)
    return folder.name


def build_wheel(wheel_directory, config_settings=None, metadata_directory=None):
    package = build_module()
    suffix = sysconfig.get_config_var("EXT_SUFFIX")
    files = {f"malus/{name}": (package / name).read_bytes()
             for name in ("__init__.py", "_arguments.py", "_malus.pyi", "py.typed", f"_malus{suffix}")}
    # What the module opens on first need; the networks where they were built.
    files |= {f"malus/{path.name}": path.read_bytes()
              for path in (package.parents[1] / "malus_networks.so",) if path.exists()}
    info = f"malus-{VERSION}.dist-info"
    files |= {f"{info}/{name}": text.encode() for name, text in metadata_files().items()}
    files[f"{info}/LICENSE"] = (ROOT / "LICENSE").read_bytes()
    record = "".join(f"{name},sha256={digest(content)},{len(content)}\n" for name, content in files.items())
    files[f"{info}/RECORD"] = (record + f"{info}/RECORD,,\n").encode()
    wheel = pathlib.Path(wheel_directory) / f"malus-{VERSION}-{tag()}.whl"
    with zipfile.ZipFile(wheel, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in files.items():
            entry = zipfile.ZipInfo(name)  # a fixed date: the same bytes from the same build
            entry.external_attr = (0o755 if name.endswith(".so") else 0o644) << 16
            entry.compress_type = zipfile.ZIP_DEFLATED
            archive.writestr(entry, content)
    return wheel.name


def build_sdist(sdist_directory, config_settings=None):
    listed = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=True).stdout.split("\n")
    name = f"malus-{VERSION}"
    with tarfile.open(pathlib.Path(sdist_directory) / f"{name}.tar.gz", "w:gz") as archive:
        for path in (name for name in listed if (ROOT / name).is_file()):
            archive.add(ROOT / path, f"{name}/{path}")
        (pathlib.Path(sdist_directory) / "PKG-INFO").write_text(METADATA)
        archive.add(pathlib.Path(sdist_directory) / "PKG-INFO", f"{name}/PKG-INFO")
        (pathlib.Path(sdist_directory) / "PKG-INFO").unlink()
    return f"{name}.tar.gz"
