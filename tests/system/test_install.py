"""`cmake --install` gives a program that runs, a library that a project of its own can use, a Python module, man pages and
completion; cpack makes Debian packages of them."""

import shutil
import subprocess

import pytest

from conftest import BUILD, ROOT

pytestmark = pytest.mark.slow
PICTURE = ROOT / "examples/imx250mzr/fruits.png"


@pytest.fixture(scope="module")
def prefix(tmp_path_factory):
    folder = tmp_path_factory.mktemp("prefix")
    subprocess.run(["cmake", "--install", BUILD, "--prefix", folder], check=True, capture_output=True)
    return folder


def test_installed_program_runs(prefix):
    done = subprocess.run([prefix / "bin/malus", "model", "list"], capture_output=True, text=True)
    assert done.returncode == 0 and "imx250myr-simulated" in done.stdout
    done = subprocess.run([prefix / "bin/malus", "info", PICTURE], capture_output=True, text=True)
    assert done.returncode == 0 and "2448 x 2048" in done.stdout


@pytest.mark.parametrize("file", ["share/man/man1/malus.1", "share/man/man1/malus-denoise.1",
                                  "share/bash-completion/completions/malus", "share/zsh/vendor-completions/_malus",
                                  "share/fish/vendor_completions.d/malus.fish", "include/malus/malus.h"])
def test_installed_files_lie_where_they_are_looked_for(prefix, file):
    assert (prefix / file).stat().st_size > 100


def test_installed_python_module_works(prefix):
    found = list(prefix.glob("lib/python3*/*-packages/malus/_malus*.so"))
    if not found:
        pytest.skip("the Python module is not built (pybind11 is missing)")
    folder = found[0].parents[1]
    use = f"import malus; print(malus.__file__, malus.load_frame({str(PICTURE)!r}))"
    done = subprocess.run(["/usr/bin/python3", "-c", use], text=True, capture_output=True, env={"PYTHONPATH": str(folder)}, check=True)
    assert str(folder) in done.stdout and "2448x2048" in done.stdout


def test_installed_python_module_finds_the_networks(prefix):
    package, networks = list(prefix.glob("lib/python3*/*-packages/malus/_malus*.so")), list(prefix.glob("lib/**/malus_networks.so"))
    if not package or not networks:
        pytest.skip("the Python module or the networks are not built")
    use = ("import malus, numpy as np; print(malus.denoise(np.full((64, 64), 300, np.uint16), model='imx250myr-simulated', black=82, white=4095,"
           f" gain=12, method={str(ROOT / 'models/polar-bayer.safetensors')!r})['dn'].mean())")
    done = subprocess.run(["/usr/bin/python3", "-c", use], text=True, capture_output=True, env={"PYTHONPATH": str(package[0].parents[1])})
    assert done.returncode == 0 and 200 < float(done.stdout) < 230, done.stderr


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


def test_every_installed_header_can_be_included(prefix, tmp_path):
    """But those of the optional modules, which ask for libraries of their own, and pieces that other files are made of."""
    include = prefix / "include"
    headers = [path.relative_to(include) for path in sorted(include.rglob("*.h"))
               if path.relative_to(include).parts[1] not in ("capture", "neural", "cuda")
               and not path.name.endswith(("-inl.h", "vector_targets.h"))]
    assert len(headers) > 100
    (tmp_path / "all.cpp").write_text("".join(f"#include <{header}>\n" for header in headers))
    (tmp_path / "CMakeLists.txt").write_text("""cmake_minimum_required(VERSION 3.25)
project(headers LANGUAGES C CXX)
find_package(malus REQUIRED)
add_library(headers OBJECT all.cpp)
target_link_libraries(headers PRIVATE malus::malus)
""")
    subprocess.run(["cmake", "-S", tmp_path, "-B", tmp_path / "build", "-G", "Ninja", f"-DCMAKE_PREFIX_PATH={prefix}"],
                   check=True, capture_output=True)
    built = subprocess.run(["cmake", "--build", tmp_path / "build"], capture_output=True, text=True)
    assert built.returncode == 0, built.stdout


def test_another_project_may_include_the_source_tree(tmp_path):
    """And is left as it was: its build type, its install rules, its build folder."""
    (tmp_path / "user.cpp").write_text("#include <malus/image/raw_frame.h>\n"
                                       "int main() { return malus::Image(2, 2, 1.0f)(1, 1) == 1.0f ? 0 : 1; }\n")
    (tmp_path / "CMakeLists.txt").write_text(f"""cmake_minimum_required(VERSION 3.25)
project(user LANGUAGES CXX)
set(MALUS_NEURAL OFF CACHE BOOL "")
set(MALUS_CAPTURE OFF CACHE BOOL "")
set(MALUS_CUDA OFF CACHE BOOL "")
add_subdirectory({ROOT} malus)
add_executable(user user.cpp)
target_link_libraries(user PRIVATE malus::image)
add_executable(user_of_all EXCLUDE_FROM_ALL user.cpp)
target_link_libraries(user_of_all PRIVATE malus::malus)
""")
    build = tmp_path / "build"
    configured = subprocess.run(["cmake", "-S", tmp_path, "-B", build, "-G", "Ninja", "-DCMAKE_UNITY_BUILD=ON"], capture_output=True, text=True)
    assert configured.returncode == 0, configured.stderr
    assert "CMAKE_BUILD_TYPE:STRING=\n" in (build / "CMakeCache.txt").read_text()
    ours = {"CMakeCache.txt", "CMakeFiles", "build.ninja", "cmake_install.cmake", "malus"}
    assert {path.name for path in build.iterdir()} - {".cmake"} == ours
    built = subprocess.run(["cmake", "--build", build, "--target", "user"], capture_output=True, text=True)
    assert built.returncode == 0, built.stdout
    subprocess.run([build / "user"], check=True)
    subprocess.run(["cmake", "--install", build, "--prefix", tmp_path / "prefix"], check=True, capture_output=True)
    assert not (tmp_path / "prefix").exists()


@pytest.fixture(scope="module")
def packages(tmp_path_factory):
    if not shutil.which("dpkg-shlibdeps"):
        pytest.skip("needs dpkg-dev")
    folder = tmp_path_factory.mktemp("packages")
    subprocess.run(["cpack", "-G", "DEB", "-B", folder], cwd=BUILD, check=True, capture_output=True)
    return {path.name.split("_")[0]: path for path in folder.glob("*.deb")}


def field(package, name):
    return subprocess.run(["dpkg-deb", "-f", package, name], capture_output=True, text=True, check=True).stdout


def test_debian_package_of_the_program_runs_from_where_it_is_unpacked(packages, tmp_path):
    subprocess.run(["dpkg-deb", "-x", packages["malus"], tmp_path], check=True)
    done = subprocess.run([tmp_path / "usr/bin/malus", "model", "list"], capture_output=True, text=True)
    assert done.returncode == 0 and "imx250myr-simulated" in done.stdout
    done = subprocess.run([tmp_path / "usr/bin/malus", "info", PICTURE], capture_output=True, text=True)
    assert done.returncode == 0 and "2448 x 2048" in done.stdout
    assert (tmp_path / "usr/share/man/man1/malus.1").exists()


def test_debian_packages_name_what_they_need(packages):
    assert {"malus", "libmalus-dev"} <= set(packages)
    assert "libtiff6" in field(packages["malus"], "Depends")
    assert "torch" not in field(packages["malus"], "Depends")
    assert "libtbb-dev" in field(packages["libmalus-dev"], "Depends")
    if "python3-malus" in packages:
        assert "python3-numpy" in field(packages["python3-malus"], "Depends")
        assert "libtiff6" in field(packages["python3-malus"], "Depends")
