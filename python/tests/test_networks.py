"""Networks in malus.denoise: what the program gives, bit for bit; processes that cannot have them are told so."""

import os
import pathlib
import shutil
import subprocess
import sys
import threading
import time

import numpy as np
import pytest

malus = pytest.importorskip("malus", reason="the Python module is not built (pybind11 is missing)")

ROOT = pathlib.Path(__file__).resolve().parents[2]
PACKAGE = pathlib.Path(malus.__file__).parent
PROGRAM = pathlib.Path(os.environ.get("MALUS_PROGRAM", PACKAGE.parents[1] / "malus"))
BUILT = any((folder / "malus_networks.so").exists() for folder in (PACKAGE, PACKAGE.parents[1])) or bool(
    list(PACKAGE.parents[2].glob("**/malus/malus_networks.so")))
needs_networks = pytest.mark.skipif(not BUILT, reason="the networks are not built (libtorch is missing)")
WEIGHTS = ROOT / "models/polar-bayer.safetensors"
LAYOUT = "polar-bayer-rggb"
GIVEN = dict(black=82, white=4095, gain=12)


@pytest.fixture(scope="module")
def model():
    return malus.Model("imx250myr-simulated")


@pytest.fixture(scope="module")
def raw(model):
    light = np.tile(np.linspace(5, 900, 160, dtype=np.float32), (128, 1))
    return np.rint(model.synthesize(light, gain=12, seed=1) + 82).clip(0, 4095).astype(np.uint16)


def run_python(code, *arguments, environment=None):
    return subprocess.run([sys.executable, "-c", code, *map(str, arguments)], capture_output=True, text=True, timeout=300, cwd=ROOT,
                          env={**os.environ, "PYTHONPATH": str(PACKAGE.parent), **(environment or {})})


@needs_networks
@pytest.mark.parametrize("name, layout, sensor", [("polar-bayer", LAYOUT, "imx250myr-simulated"), ("bayer", "bayer-rggb", "sony-a7s2")])
def test_result_is_the_programs(raw, tmp_path, name, layout, sensor):
    if not PROGRAM.exists():
        pytest.skip("needs the program")
    weights, gain = ROOT / f"models/{name}.safetensors", 12 if name == "polar-bayer" else 1600
    np.save(tmp_path / "raw.npy", raw)
    subprocess.run([PROGRAM, "denoise", tmp_path / "raw.npy", "--layout", layout, "--black", "82", "--white", "4095", "--model", sensor,
                    "--gain" if gain == 12 else "--iso", str(gain), "--method", weights, "--uncertainty", "--format", "npy", "-o", tmp_path], check=True)
    # Another number of threads, and a path in place of text.
    malus.set_threads(1)
    result = malus.denoise(raw, layout=layout, black=82, white=4095, model=sensor, gain=gain, method=weights, variance=True)
    malus.set_threads(0)
    assert result["target"] == "mosaic" and result["picture"] is None
    assert np.array_equal(result["dn"], np.load(tmp_path / "raw_denoised.npy"))
    classical = malus.denoise(raw, layout=layout, black=82, white=4095, model=sensor, gain=gain)["dn"]
    assert 0 < np.abs(result["dn"] - classical).mean() < 20
    assert np.isfinite(result["variance"]).mean() > 0.9


@needs_networks
@pytest.mark.parametrize("target", ["rgb", "srgb"])
def test_a_picture_is_the_programs(tmp_path, target):
    """Of a network that denoises and demosaicks, or is the whole ISP: trained for two steps, none ships."""
    if not PROGRAM.exists():
        pytest.skip("needs the program")
    config = (ROOT / "experiments/denoise-demosaic/physics.toml").read_text()
    for old, new in (("../pictures/*", str(ROOT / "examples/still_life/*.exr")), ('target = "rgb"', f'target = "{target}"'),
                     ("steps = 1200", "steps = 2"), ("warm_up = 20", "warm_up = 1")):
        assert old in config
        config = config.replace(old, new)
    (tmp_path / "train.toml").write_text(config)
    subprocess.run([PROGRAM, "train", tmp_path / "train.toml", "-o", tmp_path / "run", "-q"], check=True)
    weights = tmp_path / "run/weights.safetensors"
    camera = malus.Model("nikon-d850")
    raw = camera.synthesize(np.tile(np.linspace(500, 9000, 96, dtype=np.float32), (64, 1)), gain=1600, seed=1)
    np.save(tmp_path / "raw.npy", raw)
    subprocess.run([PROGRAM, "denoise", tmp_path / "raw.npy", "--layout", "bayer-rggb", "--black", "0", "--model", "nikon-d850", "--iso", "1600",
                    "--method", weights, "--format", "npy", "-o", tmp_path], check=True)
    given = dict(model=camera, gain=1600, black=0, method=weights)
    result = malus.denoise(raw, **given)
    assert result["target"] == target and result["dn"] is None and result["scale_dn"] > 0
    assert result["picture"].shape == (3, 64, 96) and result["picture"].std() > 0
    assert np.array_equal(result["picture"], np.load(tmp_path / f"raw_{target}.npy"))
    with pytest.raises(malus.InputError, match="^variance: the network gives pictures"):
        malus.denoise(raw, **given, variance=True)


@needs_networks
def test_a_network_is_kept_until_its_file_changes(model, raw, tmp_path):
    weights = shutil.copy2(WEIGHTS, tmp_path / "w.safetensors")
    denoise = lambda **more: malus.denoise(raw, model=model, method=weights, **GIVEN, **more)["dn"]
    expected = denoise()
    times = os.stat(weights)
    content = bytearray(weights.read_bytes())
    content[-40000:] = bytes(40000)  # another network, and at first nothing says so
    weights.write_bytes(content)
    os.utime(weights, ns=(times.st_atime_ns, times.st_mtime_ns))
    assert np.array_equal(denoise(), expected)
    os.utime(weights, ns=(times.st_atime_ns, times.st_mtime_ns + 1))
    assert not np.array_equal(denoise(), expected)
    weights.unlink()
    with pytest.raises(malus.InputError, match="w.safetensors"):
        denoise()


@needs_networks
def test_threads_share_a_network(model, raw):
    expected = malus.denoise(raw, model=model, method=WEIGHTS, **GIVEN)["dn"]
    results, ticks = [], []
    work = lambda: results.append(malus.denoise(raw, model=model, method=WEIGHTS, **GIVEN)["dn"])
    threads = [threading.Thread(target=work) for _ in range(4)]
    for thread in threads:
        thread.start()
    while any(thread.is_alive() for thread in threads):
        time.sleep(0.001)
        ticks.append(1)
    assert len(results) == 4 and all(np.array_equal(result, expected) for result in results)
    assert len(ticks) > 5  # the interpreter went on meanwhile


FORK = """
import os, signal, sys, threading
import numpy as np
import malus

raw = np.load(sys.argv[1])
denoise = lambda: malus.denoise(raw, model="imx250myr-simulated", method=sys.argv[2], black=82, white=4095, gain=12)["dn"]
malus.set_threads(2)
expected = denoise()
other = threading.Thread(target=lambda: [denoise() for _ in range(3)])
other.start()
child = os.fork()
if child == 0:
    signal.alarm(60)
    os._exit(0 if np.array_equal(denoise(), expected) else 1)
status = os.waitpid(child, 0)[1]
other.join()
sys.exit(status != 0)
"""


@needs_networks
def test_a_forked_process_denoises_too(raw, tmp_path):
    """Though another thread of its parent was at work with the same network, and libtorch's threads are not there."""
    np.save(tmp_path / "raw.npy", raw[:64, :64])
    done = run_python(FORK, tmp_path / "raw.npy", WEIGHTS)
    assert done.returncode == 0, done.stderr


TORCH = """
import sys
import numpy as np
import torch
import malus

torch.set_num_threads(3)
raw = np.load(sys.argv[1])
malus.set_threads(2)
malus.denoise(raw, model="imx250myr-simulated", method=sys.argv[2], black=82, white=4095, gain=12)
assert torch.get_num_threads() == 3
print(torch.ones(2, 2).matmul(torch.ones(2, 2)).sum().item())
"""


@needs_networks
def test_the_same_libtorch_may_be_loaded_already(raw, tmp_path):
    """Debian's python3-torch has the file that the networks link; its number of threads stays the user's."""
    np.save(tmp_path / "raw.npy", raw)
    done = run_python(TORCH, tmp_path / "raw.npy", WEIGHTS)
    if "No module named 'torch'" in done.stderr:
        pytest.skip("needs PyTorch")
    if "InputError: networks: this process has loaded" in done.stderr:
        pytest.skip("this interpreter has another PyTorch")
    assert done.returncode == 0 and done.stdout.endswith("8.0\n"), done.stderr


@needs_networks
def test_another_libtorch_is_refused(tmp_path):
    compiler = shutil.which("cc") or shutil.which("gcc")
    if not compiler:
        pytest.skip("needs a C compiler")
    other = tmp_path / "libtorch_cpu.so"
    subprocess.run([compiler, "-shared", "-o", other, "-Wl,-soname,libtorch_cpu.so", "-x", "c", "/dev/null"], check=True)
    done = run_python("import ctypes, sys, malus, numpy; ctypes.CDLL(sys.argv[1]);"
                      "malus.denoise(numpy.zeros((64, 64), 'u2'), model='imx250myr-simulated', gain=12, white=4095, black=0, method=sys.argv[2])",
                      other, WEIGHTS)
    assert done.returncode == 1
    last = done.stderr.splitlines()[-1]
    assert f"InputError: networks: this process has loaded {other}, and malus's networks need /" in last
    assert last.endswith("denoise in a process that imports no other torch, or by `malus denoise`")


def test_a_package_without_networks_says_so(tmp_path):
    package = tmp_path / "a/b/malus"
    shutil.copytree(PACKAGE, package, ignore=shutil.ignore_patterns("malus_networks.so", "__pycache__"))
    done = run_python("import malus, numpy; malus.denoise(numpy.zeros((64, 64), 'u2'), model='imx250myr-simulated', gain=12, method='w.safetensors')",
                      environment={"PYTHONPATH": str(package.parent)})
    assert done.stderr.splitlines()[-1].endswith("InputError: networks: the Python module was built without them; install libtorch-dev and build again")


@needs_networks
@pytest.mark.parametrize("given, words", [
    (dict(method="no.safetensors"), r"^no\.safetensors: .*; "),
    (dict(method=WEIGHTS, strength=2.0), r"^strength: a network takes out what it was trained to; leave it out, or use method="),
    (dict(method=WEIGHTS, ratio=10.0), r"^ratio: .*polar-bayer.safetensors does not amplify by it"),
    (dict(method=WEIGHTS, layout="bayer-rggb"), r"bayer-rggb"),
    (dict(method="bm3d", device="cpu"), r"^device: bm3d is no network and does not look at it; leave it out, or name .* with method=$"),
    (dict(method=WEIGHTS, device="gpu"), r'^device: gpu is not known; did you mean "cpu"\? known: cpu, cuda$'),
    (dict(method=WEIGHTS, tile_batch=0), r"^tile_batch: 0 is outside its range; give 1 to 64$"),
    (dict(method=WEIGHTS, ratio=-1.0), r"^ratio: -1 is outside its range"),
    (dict(method=ROOT / "models"), r'^method=".*models": is a folder; '),
])
def test_errors_name_keywords(model, raw, given, words):
    """Those of the networks' module too, which words its messages by functions of its own."""
    with pytest.raises(malus.InputError, match=words) as raised:
        malus.denoise(raw, model=model, **{**GIVEN, **given})
    assert " --" not in str(raised.value)


@needs_networks
def test_warnings_of_a_network_are_given(model, raw):
    with pytest.warns(UserWarning, match="brighter against their noise than what the network was trained with"):
        malus.denoise(np.full((64, 64), 4000, np.uint16), model=model, black=82, white=4095, gain=0, method=WEIGHTS)
