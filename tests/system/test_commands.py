"""The commands on shipped frames, read back by other people's software."""

import subprocess

import h5py
import numpy as np
import pytest
from PIL import Image

from conftest import PROGRAM, ROOT, needs_networks

COMMANDS = ["info", "calibrate", "model", "synthesize", "denoise", "stokes", "evaluate", "bench"]
MONO = ["--layout", "polar-mono", "--black", "0", "--white", "4080"]


def crop(examples, tmp_path, size=256):
    path = tmp_path / "scene.png"
    pixels = np.array(Image.open(examples / "imx250mzr/carps_12bit.png"))
    Image.fromarray(pixels[400:400 + size, 400:400 + size].astype(np.uint16)).save(path)
    return path


@pytest.mark.parametrize("command", ["", *COMMANDS])
def test_help(malus, command):
    assert "Usage" in malus(*command.split(), "--help").out


def test_help_is_a_word_as_well(malus):
    assert malus("help").out == malus("--help").out
    assert malus("help", "model", "show").out == malus("model", "show", "--help").out


def test_json_is_alone_on_stdout(malus, examples):
    shown = malus("info", examples / "imx250mzr/carps.png", "--layout", "polar-mono", "--json").json
    assert shown


def test_shipped_camera_is_measured(malus, examples, tmp_path):
    model = tmp_path / "emva.h5"
    malus("calibrate", examples / "emva/session.toml", "-o", model)
    shown = malus("model", "show", model, "--json").json
    assert {"sensor", "layout", "channels", "row_group", "kinds", "gains", "joint"} <= set(shown)
    gain = shown["gains"][0]
    for key, unit in {"K": "DN/e-", "mu": "DN", "sigma_row": "DN", "sigma_tl": "DN", "lambda": "1", "read_noise": "e-",
                      "temporal_sd_dark": "DN"}.items():
        assert gain[key]["unit"] == unit
    # A script of its own measured the whole set: K 0.2775 to 0.283, dark sd 3.08 DN, row noise 0.504 DN.
    assert gain["K"]["value"][0] == pytest.approx(0.2804, rel=0.03)
    assert gain["temporal_sd_dark"]["value"][0] == pytest.approx(3.08, rel=0.01)
    assert gain["sigma_row"]["mean"][0] == pytest.approx(0.504, rel=0.05)
    with h5py.File(model) as file:
        untold = []
        file.visititems(lambda name, item: untold.append(name) if isinstance(item, h5py.Dataset) and not (
            "unit" in item.attrs and "description" in item.attrs) else None)
        assert not untold


def test_a_camera_of_one_unnamed_gain_needs_none(malus, examples, tmp_path):
    """A model of one gain means that gain, whether the session named it or not."""
    model, frames = tmp_path / "emva.h5", sorted((examples / "emva/images").glob("d_s_000_*.png"))[:4]
    malus("calibrate", examples / "emva/session.toml", "-o", model, "-q")
    malus("denoise", examples / "emva/images/b_004_snap_001.png", "--layout", "mono", "--model", model, "-o", tmp_path / "out")
    compared = malus("evaluate", "--noise", "--reference", *frames, "--model", model, "--json").json
    assert compared["pooled"]["sqrt_jsd"] < 0.1  # other frames of other noise: 1


def test_noise_is_not_compared_with_itself(malus, tmp_path):
    """What synthesize drew, and what is drawn to compare it with, are two samples of one law."""
    np.save(tmp_path / "clean.npy", np.full((64, 64), 500, np.float32))
    camera = ["--model", "imx250mzr-simulated", "--gain", "12"]
    malus("synthesize", tmp_path / "clean.npy", *camera, "--frames", "4", "--float", "--format", "npy", "-o", tmp_path / "drawn")
    compared = malus("evaluate", "--noise", "--reference", *sorted((tmp_path / "drawn").glob("*.npy")), *camera, "--layout", "polar-mono",
                     "--clean", tmp_path / "clean.npy", "--black", "0", "--white", "4095", "--json").json
    assert 0.3 < compared["pooled"]["sqrt_jsd"] / compared["pooled"]["sqrt_jsd_floor"] < 3


def test_the_gain_is_asked_for_where_there_are_several(malus, examples, tmp_path):
    said = malus("denoise", crop(examples, tmp_path), *MONO, "--model", "imx250mzr-simulated", "-o", tmp_path, code=1).err
    assert "--gain" in said and "24 dB" in said and "scene.png" in said


def test_synthesize_is_the_same_for_any_number_of_threads(malus, examples, tmp_path):
    scene = crop(examples, tmp_path)
    drawn = []
    for threads in (1, 2, 7):
        out = tmp_path / f"t{threads}"
        malus("synthesize", scene, *MONO, "--model", "imx250mzr-simulated", "--gain", "24", "--ratio", "10", "--seed", "0",
              "--threads", threads, "-o", out)
        drawn.append(np.array(Image.open(out / "scene_000.tif")))
    assert np.array_equal(drawn[0], drawn[1]) and np.array_equal(drawn[0], drawn[2])
    assert drawn[0].dtype == np.uint16


def test_dark_scene_comes_back(malus, examples, tmp_path):
    """Synthesize, denoise, evaluate: the numbers of the quickstart in small."""
    scene = crop(examples, tmp_path)
    common = ["--model", "imx250mzr-simulated", "--gain", "24"]
    malus("synthesize", scene, *MONO, *common, "--ratio", "10", "--seed", "1", "-o", tmp_path / "raw")
    malus("synthesize", scene, *MONO, *common, "--ratio", "10", "--seed", "1", "--float", "-o", tmp_path / "float")
    malus("denoise", tmp_path / "raw/scene_000.tif", *common, "-o", tmp_path / "out", "--planes", "--u16", "--uncertainty")
    results = malus("evaluate", "--reference", scene, *MONO, "--ratio", "10", "--test", tmp_path / "float/scene_000.tif",
                    tmp_path / "out/scene_000_denoised.tif", "--json").json["results"]
    noisy, denoised = results
    assert denoised["image"]["psnr"] > noisy["image"]["psnr"] + 6
    assert denoised["dolp"]["psnr"] > noisy["dolp"]["psnr"] + 4
    assert denoised["aolp"]["circular_deg"] < noisy["aolp"]["circular_deg"]


def test_stokes_pictures_agree_with_numpy(malus, tmp_path):
    rng = np.random.default_rng(5)
    mosaic = rng.uniform(50, 200, (32, 48)).astype(np.float32)
    np.save(tmp_path / "m.npy", mosaic)
    malus("stokes", tmp_path / "m.npy", "--layout", "polar-mono", "--white", "255", "-o", tmp_path, "--format", "npy")
    i90, i45, i135, i0 = mosaic[::2, ::2], mosaic[::2, 1::2], mosaic[1::2, ::2], mosaic[1::2, 1::2]
    s0, s1, s2 = (i0 + i45 + i90 + i135) / 2, i0 - i90, i45 - i135
    read = {name: np.load(tmp_path / f"m_{name}.npy").squeeze() for name in ("s0", "s1", "s2", "dolp", "aolp")}
    assert np.allclose(read["s0"], s0, rtol=1e-5) and np.allclose(read["s1"], s1, atol=1e-3)
    assert np.allclose(read["s2"], s2, atol=1e-3)
    assert np.allclose(read["dolp"], np.hypot(s1, s2) / s0, rtol=1e-4)
    assert np.allclose(read["aolp"], np.degrees(np.arctan2(s2, s1)) / 2 % 180, atol=0.01)


def test_command_reference_is_current():
    """docs/commands.md is the program's own --help."""
    before = (ROOT / "docs/commands.md").read_text()
    try:
        subprocess.run([ROOT / "scripts/make_command_docs.sh", PROGRAM], check=True, capture_output=True)
        assert (ROOT / "docs/commands.md").read_text() == before
    finally:
        (ROOT / "docs/commands.md").write_text(before)


@pytest.mark.slow
def test_main_job_of_quickstart(tmp_path):
    done = subprocess.run([ROOT / "examples/main_job.sh", PROGRAM, tmp_path / "results"], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    for name in ("emva.h5", "calibration.html", "denoised.html", "denoised/fruits_denoised.tif", "stokes/fruits_denoised_aolp.png"):
        assert (tmp_path / "results" / name).stat().st_size > 1000


@pytest.mark.slow
@needs_networks
def test_networks_job_of_quickstart(tmp_path):
    """The networks are better than the default, by a PSNR of our own, which is what the quickstart shows them for."""
    done = subprocess.run([ROOT / "examples/networks_job.sh", PROGRAM, tmp_path], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    for layout, least in (("polar-bayer-rggb", 0.3), ("bayer-rggb", 0.2)):
        folder = tmp_path / "networks" / layout
        clean = np.array(Image.open(folder / "still_life_clean.tif"), np.float64) / 10
        noisy = np.array(Image.open(folder / "noisy/still_life_clean_000.tif"), np.float64)
        psnr = {"noisy": -10 * np.log10(np.mean((noisy - clean) ** 2))}
        for method in ("default", "network"):
            result = np.array(Image.open(folder / method / "still_life_clean_000_denoised.tif"), np.float64)
            psnr[method] = -10 * np.log10(np.mean((result - clean) ** 2))
        assert psnr["default"] > psnr["noisy"] + 3
        assert psnr["network"] > psnr["default"] + least
        assert (folder / "network.html").stat().st_size > 1000
