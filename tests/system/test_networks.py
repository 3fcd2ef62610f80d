"""`malus denoise --method FILE.safetensors`, end to end, on weight files that the tests write themselves."""

import json
import os
import pathlib
import re
import shutil
import subprocess

import numpy as np
import pytest

from conftest import BUILD, PROGRAM, ROOT, needs_networks
from training_files import tensors
from weight_files import unet_package, unet_weights, write_safetensors

MODEL = ["--model", "imx250myr-simulated", "--gain", "12"]

pytestmark = [pytest.mark.slow, needs_networks]


@pytest.fixture
def noisy(malus, tmp_path):
    """A raw frame of an odd size that ends inside a cell, with the simulated camera's noise."""
    rows, cols = np.mgrid[0:201, 0:158]
    clean = (600 + 300 * np.sin(cols / 21) * np.cos(rows / 17)).astype(np.float32)
    np.save(tmp_path / "clean.npy", clean)
    malus("synthesize", tmp_path / "clean.npy", "--layout", "polar-bayer-rggb", *MODEL, "--format", "npy",
          "-o", tmp_path)
    return tmp_path / "clean_000.npy"


def denoised(malus, frame, folder, weights, *arguments, model=MODEL):
    result = malus("denoise", frame, "--method", weights, *model, "--black", "82", "--white", "4095", "--format", "npy",
                   "--json", "-o", folder, *arguments)
    return np.load(folder / f"{frame.stem}_denoised.npy"), result.json


def test_a_network_that_corrects_nothing_returns_the_frame(malus, noisy, tmp_path):
    weights = unet_package(tmp_path / "zero.safetensors")
    out, run = denoised(malus, noisy, tmp_path / "out", weights)
    raw = np.load(noisy).astype(float)
    model = malus("model", "show", "imx250myr-simulated", "--gain", "12", "--json").json
    bias = np.array(model["gains"][0]["mu"]["mean"]).reshape(4, 4)
    black = 82 + np.tile(bias, (51, 40))[:201, :158]
    kept = raw < 4095
    assert np.abs(out - (raw - black))[kept].max() < 1e-2
    assert run["network"]["architecture"] == "unet" and run["network"]["tiled_equals_whole"]
    record = json.loads((tmp_path / "out" / "clean_000_denoised.json").read_text())
    assert record["run"]["network"] == run["network"]


@pytest.mark.slow
@pytest.mark.parametrize("domain,noise,guide,camera", [("linear", "level", "none", MODEL), ("stabilised", "level", "bm3d", MODEL),
                                                       ("linear", "level", "none", ["--layout", "polar-bayer-bggr"])])
def test_tiles_equal_the_whole(malus, tmp_path, domain, noise, guide, camera):
    rng = np.random.default_rng(3)
    rows, cols = np.mgrid[0:2401, 0:2002]
    frame = 82 + rng.normal(500 + 200 * np.sin(cols / 90) * np.cos(rows / 70), 12)
    np.save(tmp_path / "frame.npy", frame.round().astype(np.uint16))
    weights = unet_package(tmp_path / "w.safetensors", scale=1.0, width=16, domain=domain, noise_input=noise, guide=guide)
    whole, one = denoised(malus, tmp_path / "frame.npy", tmp_path / "whole", weights, "--memory", "1000", model=camera)
    parts, many = denoised(malus, tmp_path / "frame.npy", tmp_path / "parts", weights, "--memory", "170", model=camera)
    assert one["tiles"] == 1 and many["tiles"] > 1
    assert np.abs(whole - parts).max() < 1e-4 * 4013


def test_another_bayer_order_is_the_same_sensor_from_another_pixel(malus, tmp_path):
    """As bright as that the amplification is 1 for both, and the first cell is the second: then all that is left is the order."""
    weights = unet_package(tmp_path / "w.safetensors", scale=1.0)
    rows, cols = np.mgrid[0:402, 0:360]
    rng = np.random.default_rng(8)
    frame = rng.normal(2200 + 500 * np.sin(cols / 21) * np.cos(rows / 17) + 20 * (rows % 4) + 90 * (cols % 4), 12).round()
    frame[0:4], frame[:, 0:4] = frame[4:8], frame[:, 4:8]
    np.save(tmp_path / "rggb.npy", frame.astype(np.uint16))
    whole, _ = denoised(malus, tmp_path / "rggb.npy", tmp_path / "out", weights, model=["--layout", "polar-bayer-rggb"])
    for order, row, col in (("grbg", 0, 2), ("gbrg", 2, 0), ("bggr", 2, 2)):
        np.save(tmp_path / f"{order}.npy", frame[row:, col:].astype(np.uint16))
        part, _ = denoised(malus, tmp_path / f"{order}.npy", tmp_path / "out", weights, model=["--layout", f"polar-bayer-{order}"])
        assert part.shape == whole[row:, col:].shape
        assert np.abs(part - whole[row:, col:]).max() < 0.05, order
        assert np.abs(part - (frame - 82)[row:, col:]).max() > 5  # the network does something


@pytest.mark.parametrize("layout,pixel", [("bayer", 1), ("polar-bayer", 2)])
def test_the_shipped_networks_are_as_good_in_every_order(malus, tmp_path, layout, pixel):
    """The same light, cut from another pixel on; 0.3 dB is what the noise estimated from another cut may change (0.27 here)."""
    rows, cols = np.mgrid[0:404, 0:404]
    clean = 400 + 250 * np.sin(cols / 21) * np.cos(rows / 17) + 100 * (np.hypot(rows - 200, cols - 200) % 90 > 45)
    noisy = np.random.default_rng(4).normal(clean, np.sqrt(25 + 0.5 * clean))
    psnr = {}
    for order, row, col in (("rggb", 0, 0), ("grbg", 0, pixel), ("gbrg", pixel, 0), ("bggr", pixel, pixel)):
        np.save(tmp_path / f"{order}.npy", (noisy[row:, col:] + 82).round().astype(np.uint16))
        out, _ = denoised(malus, tmp_path / f"{order}.npy", tmp_path / "out", ROOT / f"models/{layout}.safetensors",
                          model=["--layout", f"{layout}-{order}"])
        error = (out - clean[row:, col:])[8:-8, 8:-8]
        psnr[order] = -10 * np.log10(np.mean(error ** 2))
    assert max(psnr.values()) - min(psnr.values()) < 0.3, psnr
    assert psnr["bggr"] > -10 * np.log10(np.mean((noisy - clean) ** 2)) + 8


@pytest.mark.parametrize("network,layout,other", [("bayer", "mono", "polar-mono"), ("polar-bayer", "polar-mono", "mono")])
def test_the_shipped_networks_serve_sensors_without_colours(malus, refused, tmp_path, network, layout, other):
    """They see what the coloured ones see of grey light. Waves and discs: 0.2 dB at least over the classical result, 0.53 and 0.37 here."""
    rows, cols = np.mgrid[0:403, 0:401]
    clean = 60 + 30 * np.sin(cols / 21) * np.cos(rows / 17) + 40 * (np.hypot(rows - 200, cols - 200) % 30 > 15)
    noisy = np.random.default_rng(4).normal(clean, np.sqrt(9 + clean)) + 82
    np.save(tmp_path / "frame.npy", noisy.round().astype(np.uint16))
    weights, psnr = ROOT / f"models/{network}.safetensors", {}
    for method in (weights, "nl-ridge"):
        out, _ = denoised(malus, tmp_path / "frame.npy", tmp_path / pathlib.Path(method).name, method, model=["--layout", layout])
        psnr[method] = -10 * np.log10(np.mean((out - clean)[8:-8, 8:-8] ** 2))
    assert psnr[weights] > psnr["nl-ridge"] + 0.2, psnr
    line = refused("denoise", tmp_path / "frame.npy", "--method", weights, "--layout", other, "--black", 82, "--white", 4095, "-o", tmp_path / "none")
    assert f"has the layout {other}, the network {network}-rggb" in line
    assert not (tmp_path / "none").exists()


@pytest.mark.parametrize("guide", ["bm3d", "nl-ridge"])
def test_a_guided_network_without_correction_equals_the_classical_method(malus, noisy, tmp_path, guide):
    weights = unet_package(tmp_path / "zero.safetensors", domain="stabilised", noise_input="level", guide=guide,
                           guide_profile="normal", row_noise=True)
    out, _ = denoised(malus, noisy, tmp_path / "network", weights)
    classical, _ = denoised(malus, noisy, tmp_path / "classical", guide)
    assert np.abs(out - classical).max() < 0.05


def test_noise_that_was_cut_off_is_taken_back_for_networks_too(malus, tmp_path):
    """Black at 0: what a frame shows is max(0, light + noise). Where half of the noise is gone a network's correction is none."""
    rows, cols = np.mgrid[0:320, 0:320]
    light = cols * (12 / 319)
    frame = np.clip(np.round(np.random.default_rng(7).normal(light, 1.5)), 0, 4095).astype(np.uint16)
    np.save(tmp_path / "dark.npy", frame)
    guided = {"domain": "stabilised", "noise_input": "level", "guide": "nl-ridge", "guide_profile": "normal", "row_noise": True}

    def result(method):
        malus("denoise", tmp_path / "dark.npy", "--layout", "polar-bayer-rggb", "--black", 0, "--white", 4095, "--method", method,
              "--format", "npy", "--force", "-o", tmp_path / "out")
        return np.load(tmp_path / "out/dark_denoised.npy")

    classical = result("nl-ridge")
    assert abs(classical[:, :20].mean() - light[:, :20].mean()) < 0.3 < frame[:, :20].mean() - light[:, :20].mean()
    assert np.abs(result(unet_package(tmp_path / "zero.safetensors", **guided)) - classical).max() < 0.05
    wild = result(unet_package(tmp_path / "wild.safetensors", scale=1.0, **guided))
    assert np.mean(wild[:, :10] == classical[:, :10]) > 0.95  # up to 0.38 DN, a quarter of a deviation
    assert np.abs(wild - classical)[:, 100:].mean() > 0.02  # as far as the stated error lets it


def test_a_guided_network_is_held_to_its_guides_error_and_states_it(malus, noisy, tmp_path):
    def stated(weights):
        """The result, and what is stated of the squared error of S0 [DN^2]: planes R, G, B."""
        folder = tmp_path / "out"
        out, _ = denoised(malus, noisy, folder, weights, "--uncertainty", "--force")
        malus("stokes", folder / "clean_000_denoised.npy", "--variance", folder / "clean_000_variance.exr", "--layout",
              "polar-bayer-rggb", "--black", "0", "--white", "4013", "--format", "npy", "--no-pictures", "--force", "-o", folder)
        deviation = np.load(folder / "clean_000_denoised_s0_sd.npy")
        return out, (deviation if deviation.shape[0] == 3 else np.moveaxis(deviation, -1, 0)) ** 2

    guided = {"domain": "stabilised", "noise_input": "level", "guide": "nl-ridge", "guide_profile": "normal", "row_noise": True}
    classical, variance = stated("nl-ridge")
    _, same = stated(unet_package(tmp_path / "zero.safetensors", **guided))
    np.testing.assert_allclose(same, variance, rtol=1e-3)
    wild, the_same = stated(unet_package(tmp_path / "wild.safetensors", scale=1.0, **guided))
    np.testing.assert_allclose(the_same, variance, rtol=1e-3)
    # S0 is half the sum of four angles, whose errors share 0.35 of their variance, as those of both greens do (docs/uncertainty.md).
    red, green, blue = variance.mean(axis=(1, 2)) / (1 + 3 * 0.35)
    of_a_pixel = (red + 2 * green / ((1 + 0.35) / 2) + blue) / 4
    # A correction is at most 0.3 of that (correction_limit.h); this one would be hundreds of times as much.
    assert 0.25 < np.mean((wild - classical) ** 2) / of_a_pixel < 0.33


def test_the_shipped_network_runs_on_kernels(malus, noisy, tmp_path):
    """models/polar-bayer is 40 values wide, no whole number of vectors: its channels are filled up."""
    taken = [malus("denoise", noisy, *MODEL, "--black", "82", "--method", weights, "--precision", "bfloat16", "--json",
                   "-o", tmp_path / name).json["network"]["precision"]
             for name, weights in (("shipped", ROOT / "models/polar-bayer.safetensors"),
                                   ("unet", unet_package(tmp_path / "w.safetensors")))]
    assert taken[0] == taken[1]


def test_pixels_that_are_not_numbers_and_saturated_ones_come_back(malus, noisy, tmp_path):
    frame = np.load(noisy).astype(np.float32) - 82
    frame[10, 20], frame[50, 60], frame[100:104, 100:104] = np.nan, np.inf, 4013
    np.save(tmp_path / "odd.npy", frame)
    weights = unet_package(tmp_path / "w.safetensors", scale=1.0)
    malus("denoise", tmp_path / "odd.npy", "--method", weights, *MODEL, "--black", "0", "--white", "4013",
          "--format", "npy", "-o", tmp_path / "out")
    out = np.load(tmp_path / "out" / "odd_denoised.npy")
    assert np.isnan(out[10, 20]) and np.isinf(out[50, 60])
    odd = ~np.isfinite(out)
    assert odd.sum() == 2
    bias = np.array(malus("model", "show", "imx250myr-simulated", "--gain", "12", "--json").json["gains"][0]["mu"]["mean"])
    assert np.abs(out[100:104, 100:104] - 4013 + bias.reshape(4, 4)).max() < 1e-2


def test_many_frames_share_one_network_and_the_report_holds_them(malus, noisy, tmp_path):
    np.save(tmp_path / "second.npy", np.load(noisy)[:64, :64])
    weights = unet_package(tmp_path / "w.safetensors", scale=0.1)
    result = malus("denoise", noisy, tmp_path / "second.npy", "--method", weights, *MODEL, "--black", "82", "--white",
                   "4095", "--layout", "polar-bayer-rggb", "--planes", "--u16", "--report", tmp_path / "page.html",
                   "--json", "-o", tmp_path / "out")
    assert len(result.json["frames"]) == 2
    assert (tmp_path / "page.html").stat().st_size > 10000
    for stem in ("clean_000", "second"):
        for suffix in ("_denoised.tif", "_denoised_u16.tif", "_planes.exr", "_denoised.json"):
            assert (tmp_path / "out" / (stem + suffix)).exists()


def test_bfloat16_stays_near_float32(malus, noisy, tmp_path):
    weights = unet_package(tmp_path / "w.safetensors", scale=0.5)
    exact, _ = denoised(malus, noisy, tmp_path / "a", weights)
    rough, run = denoised(malus, noisy, tmp_path / "b", weights, "--precision", "bfloat16")
    if run["network"]["precision"] == "float32":
        pytest.skip("this processor is no faster with bfloat16, so the run stays float32")
    change = np.abs(exact - denoised(malus, noisy, tmp_path / "c", unet_package(tmp_path / "zero.safetensors"))[0])
    assert 0 < np.abs(rough - exact).max() < 0.05 * change.max()


def test_a_precision_that_is_not_taken_is_said(malus, noisy, tmp_path):
    weights = unet_package(tmp_path / "w.safetensors")
    for precision in ("float32", "bfloat16"):
        result = malus("denoise", noisy, *MODEL, "--black", "82", "--method", weights, "--precision", precision, "--json",
                       "-o", tmp_path / precision)
        taken = result.json["network"]["precision"]
        assert ("float32 is taken" in result.err) == (taken != precision)


def spoiled(tmp_path, change, **package):
    return unet_package(tmp_path / "bad.safetensors", change=change, **package)


def without(key):
    return lambda tensors, metadata: metadata.pop(key)


def with_nan(tensors, metadata):
    tensors["conv3_1.weight"][0, 0, 0, 0] = np.nan


def without_layer(tensors, metadata):
    del tensors["upv7.bias"]


def other_architecture(tensors, metadata):
    metadata["architecture"] = "unett"


def with_settings(**changed):
    """A digit too many must take neither time nor memory."""
    def change(tensors, metadata):
        metadata["settings"] = json.dumps({**json.loads(metadata["settings"]), **changed})

    return change


@pytest.mark.parametrize("change,word", [(without("architecture"), "architecture"), (without("malus_package"), "metadata"),
                                         (with_nan, "conv3_1.weight"), (without_layer, "upv7.bias"),
                                         (other_architecture, "unet"),
                                         (with_settings(levels=40), 'bad.safetensors: settings of unet: "levels"'),
                                         (with_settings(width=1e9), 'bad.safetensors: settings of unet: "width"'),
                                         (with_settings(levels=8), "bad.safetensors: holds"),
                                         (with_settings(width=4096), "bad.safetensors: holds")])
def test_weight_files_that_do_not_fit_are_refused(refused, noisy, tmp_path, change, word):
    line = refused("denoise", noisy, "--method", spoiled(tmp_path, change), *MODEL, "--black", "82", "--white", "4095",
                   "-o", tmp_path / "out")
    assert word in line
    assert not list(tmp_path.glob("out/*"))


def test_a_network_that_moves_means_is_named_as_a_cause(malus, noisy, tmp_path):
    weights = unet_package(tmp_path / "w.safetensors", scale=1.0)
    told = malus("denoise", noisy, "--method", weights, *MODEL, "--black", "82", "--white", "4095", "-o", tmp_path).err
    assert "moved the mean of channel" in told and f"{weights} does not suit the frame" in told and "--model" in told, told


def test_truncated_and_missing_weight_files_are_refused(refused, noisy, tmp_path):
    weights = unet_package(tmp_path / "w.safetensors")
    whole = weights.read_bytes()
    for size in (0, 5, 100, len(whole) - 3):
        weights.write_bytes(whole[:size])
        assert "w.safetensors" in refused("denoise", noisy, "--method", weights, *MODEL, "-o", tmp_path / "out")
    assert "none.safetensors" in refused("denoise", noisy, "--method", tmp_path / "none.safetensors", *MODEL,
                                         "-o", tmp_path / "out")


def test_weights_in_a_plain_safetensors_file_are_imported(malus, refused, tmp_path):
    written = unet_weights(16, 16, 4, 1.0)
    write_safetensors(tmp_path / "public.safetensors", written, {"format": "pt"})
    run = ["model", "import-weights", tmp_path / "public.safetensors", "--architecture", "unet", "-o", tmp_path / "w.safetensors"]
    assert malus(*run, "--settings", '{"width": 4}', "--json").json["parameters"] == sum(w.size for w in written.values())
    read, metadata = tensors(tmp_path / "w.safetensors")
    assert read.keys() == written.keys() and all(np.array_equal(read[name], written[name]) for name in written)
    assert json.loads(metadata["malus_package"])["settings"]["domain"] == "linear"
    assert "holds 122,268 values" in refused(*run, "--settings", '{"width": 8}', "--force")
    assert '"domain" is "linaer"; did you mean "linear"?' in refused(*run, "--package", '{"domain": "linaer"}', "--force")
    assert '"layuot" is not known; did you mean "layout"?' in refused(*run, "--package", '{"layuot": "mono"}', "--force")


def test_a_checkpoint_is_not_taken_for_weights(refused, noisy, tmp_path):
    write_safetensors(tmp_path / "checkpoint.safetensors", unet_weights(16, 16, 4), {"malus_checkpoint": "{}"})
    line = refused("denoise", noisy, "--method", tmp_path / "checkpoint.safetensors", *MODEL, "-o", tmp_path / "out")
    assert "is a checkpoint" in line and "weights.safetensors" in line


def test_another_layout_too_little_memory_and_what_networks_do_not_do(malus, refused, noisy, tmp_path):
    weights = unet_package(tmp_path / "w.safetensors")
    raw = ["--black", "82", "--white", "4095", "-o", tmp_path / "out"]
    np.save(tmp_path / "mono.npy", np.full((64, 64), 500, np.uint16))
    assert "layout" in refused("denoise", tmp_path / "mono.npy", "--layout", "polar-mono", "--method", weights, *raw)
    raw += ["--layout", "polar-bayer-rggb"]
    assert "corrects no classical result" in refused("denoise", noisy, "--method", weights, *MODEL, *raw, "--uncertainty")
    assert "--strength" in refused("denoise", noisy, "--method", weights, *MODEL, *raw, "--strength", "2")
    assert "--ratio: " in refused("denoise", noisy, "--method", weights, *MODEL, *raw, "--ratio", "10")
    assert "--profile" in refused("denoise", noisy, "--method", weights, *MODEL, *raw, "--profile", "fast")
    np.save(tmp_path / "large.npy", np.full((3000, 3000), 500, np.uint16))
    assert "MiB" in refused("denoise", tmp_path / "large.npy", "--method", weights, *MODEL, *raw, "--memory", "128")
    amplifying = unet_package(tmp_path / "r.safetensors", amplification="ratio")
    malus("denoise", noisy, "--method", amplifying, *MODEL, *raw, "--ratio", "10")


def test_a_program_without_the_module_says_so(noisy, tmp_path):
    program = tmp_path / "bin" / "malus"
    program.parent.mkdir()
    shutil.copy2(PROGRAM, program)
    done = subprocess.run([program, "denoise", noisy, "--method", "w.safetensors", "-o", tmp_path / "out"],
                          capture_output=True, text=True)
    assert done.returncode == 1
    assert done.stderr.strip() == "malus: networks: the program was built without them; install libtorch-dev and build again"


def test_the_program_itself_does_not_load_libtorch():
    libraries = subprocess.run(["ldd", PROGRAM], capture_output=True, text=True, check=True).stdout
    assert "torch" not in libraries


def test_a_slow_blas_is_told(malus, noisy, tmp_path):
    """Debian's reference BLAS in place of OpenBLAS: the same result, several times slower where layers are libtorch's."""
    folders = sorted(pathlib.Path("/usr/lib").glob("*/blas")) + sorted(pathlib.Path("/usr/lib").glob("*/lapack"))
    if len(folders) != 2:
        pytest.skip("no reference BLAS and LAPACK beside OpenBLAS")
    weights = unet_package(tmp_path / "w.safetensors")
    command = ("denoise", noisy, "--method", weights, *MODEL, "--force", "-o", tmp_path / "out")
    slow = dict(os.environ, MALUS_NETWORK_ENVIRONMENT="1", LD_LIBRARY_PATH=":".join(map(str, folders)))
    assert "reference BLAS" in malus(*command, env=slow).err
    assert "BLAS" not in malus(*command).err


def test_without_proc_one_line_is_said(noisy, tmp_path):
    """libtorch reads the processor's description there; newer ones may do without."""
    weights = unet_package(tmp_path / "zero.safetensors")
    done = subprocess.run(["unshare", "-m", "sh", "-c", 'umount -l /proc && exec "$@"', "sh", PROGRAM, "denoise", noisy, "--method",
                           weights, *MODEL, "-o", tmp_path / "out"], capture_output=True, text=True)
    if re.search("^(unshare|umount):", done.stderr, re.M):
        pytest.skip("needs the right to take /proc away")
    if done.returncode != 0:
        assert done.returncode == 1 and re.findall("^malus: .*", done.stderr, re.M)[0].count("; ") >= 1
        assert done.stderr.splitlines()[-1].startswith("malus: libtorch")


def test_a_module_of_other_headers_is_refused(tmp_path, malus):
    """Program and module share objects: one that was built before a header changed must not be called."""
    digest = re.search(r"0x([0-9a-f]{16});", (BUILD / "generated/malus_modules_interface.h").read_text()).group(1)
    module, stamp = (BUILD / "malus_networks.so").read_bytes(), bytes.fromhex(digest)[::-1]
    assert stamp in module
    (tmp_path / "malus_networks.so").write_bytes(module.replace(stamp, bytes(8)))
    shutil.copy2(PROGRAM, tmp_path / "malus")
    np.save(tmp_path / "x.npy", np.full((64, 64), 500, np.uint16))
    done = subprocess.run([tmp_path / "malus", "denoise", tmp_path / "x.npy", "--layout", "bayer-rggb", "--method", ROOT / "models/bayer.safetensors",
                           "--model", "sony-a7s2", "--iso", "1600", "-o", tmp_path / "out"], capture_output=True, text=True, timeout=600)
    assert done.returncode == 1 and "is of another version than the program; build both again" in done.stderr


def test_the_digest_follows_the_headers(tmp_path):
    for name in "ab":
        (tmp_path / f"{name}.h").write_text(f"struct {name} {{}};")

    def digest():
        subprocess.run(["cmake", f"-DHEADERS={tmp_path}/a.h;{tmp_path}/b.h", f"-DOUTPUT={tmp_path}/out.h", "-P", ROOT / "cmake/ModulesInterface.cmake"],
                       check=True, timeout=60)
        return (tmp_path / "out.h").read_text()

    first = digest()
    assert digest() == first
    (tmp_path / "b.h").write_text("struct b { int more; };")
    assert digest() != first
