"""What is stated of results and said of frames: saturation, bias, files mistaken for one another."""

import base64
import json
import re
import zlib

import numpy as np
import pytest
from PIL import Image

from test_levels import LAYOUT, mosaic

MODEL = ("--model", "imx250mzr-simulated")
GAIN_DB, SIDE, WHITE = 24, 128, 4095


@pytest.fixture
def camera(malus):
    """Black level, gain and bias of the model at GAIN_DB."""
    found = malus("model", "show", MODEL[1], "--gain", GAIN_DB, "--json").json
    gain = found["gains"][0]
    return {"black": np.mean(found["black"]["value"]), "bias": np.array(gain["mu"]["mean"]).reshape(2, 2),
            "gain": np.mean(gain["K"]["value"])}


def raw_frame(camera, path, s0_dn=400.0, saturated=False):
    """Even light with shot noise of the model's camera as the camera writes it."""
    light = mosaic(s0_dn, side=SIDE)
    random = np.random.default_rng(3)
    dn = camera["gain"] * random.poisson(light / camera["gain"]) + random.normal(0, 2, light.shape)
    dn += camera["black"] + np.tile(camera["bias"], (SIDE // 2, SIDE // 2))
    if saturated:
        dn[40:60, 40:50] = WHITE
    Image.fromarray(np.clip(np.round(dn), 0, WHITE).astype(np.uint16)).save(path)
    return path


def planes(folder, stem, *names):
    return [np.load(folder / f"{stem}_{name}.npy") for name in names]


def test_saturated_cells_are_counted_and_their_errors_unknown(malus, camera, tmp_path):
    raw = raw_frame(camera, tmp_path / "raw.png", saturated=True)
    cells = np.zeros((SIDE // 2, SIDE // 2), bool)
    cells[20:30, 20:25] = True
    model = (*MODEL, "--gain", GAIN_DB)
    common = ("--format", "npy", "--no-pictures", "--json", "-o", tmp_path)

    def check(found, stem):
        assert found.err.count("50 cells (1.2 %) with saturated pixels") == 1
        assert found.json["saturated_cells"] == 50 and found.json["undefined"] == 0
        dolp, *stated = planes(tmp_path, stem, "dolp", "s0_sd", "dolp_sd", "aolp_sd", "dolp_corrected")
        assert np.isfinite(dolp).all()  # marked, not taken away
        for plane in stated:
            assert (np.isnan(plane) == cells).all()

    check(malus("stokes", raw, *model, *common), "raw")
    malus("denoise", raw, *model, "--uncertainty", "-o", tmp_path)
    denoised = tmp_path / "raw_denoised.tif"
    check(malus("stokes", denoised, "--variance", tmp_path / "raw_variance.exr", *common), "raw_denoised")
    for command in ("stokes", "normals"):
        plain = malus(command, denoised, "-o", tmp_path / "plain", "--json")
        assert "50 cells" in plain.err and plain.json["saturated_cells"] == 50


def test_saturation_of_denoised_frames_is_that_of_the_raw_ones(malus, tmp_path):
    """Light just below white, and black levels that differ by more than that: filtered pixels of one channel lie above what saturated ones of
    another are left with, which is the white that the file tells."""
    dn = np.clip(np.round(np.random.default_rng(8).normal(WHITE - 4, 1.5, (SIDE, SIDE))), 0, WHITE).astype(np.uint16)
    dn[40:50, 40:50] = WHITE
    Image.fromarray(dn).save(tmp_path / "raw.png")
    cells = (dn == WHITE).reshape(SIDE // 2, 2, SIDE // 2, 2).any((1, 3))
    assert cells.mean() < 0.1
    levels = ("--black", "60,90,60,60", "--white", WHITE)
    malus("denoise", tmp_path / "raw.png", *MODEL, "--gain", GAIN_DB, *levels, "--uncertainty", "-o", tmp_path)
    for told in ((), levels):
        found = malus("stokes", tmp_path / "raw_denoised.tif", *told, "--variance", tmp_path / "raw_variance.exr", "--format", "npy",
                      "--no-pictures", "--json", "--force", "-o", tmp_path)
        assert found.json["saturated_cells"] == cells.sum() and f"{cells.sum()} cells" in found.err
        assert (np.isnan(planes(tmp_path, "raw_denoised", "dolp_sd")[0]) == cells).all()


def color_frame(path, aolp_deg):
    """Even light of which red, green and blue are polarized at these angles, as `imx250myr-simulated` might write it."""
    r, c = np.mgrid[:SIDE, :SIDE]
    angle, color = np.array([[90, 45], [135, 0]])[r % 2, c % 2], (r // 2 % 2) + (c // 2 % 2)
    light = 400 * (1 + 0.8 * np.cos(2 * np.deg2rad(angle - np.array(aolp_deg)[color])))
    np.save(path, np.round(light + np.random.default_rng(7).normal(82, 15, light.shape)).clip(0, WHITE).astype(np.uint16))
    return path


def first_value(html, layer):
    """The first pixel of a layer of a report's picture, within half a step: nothing foretells it, and its dither is half a step."""
    text = html.read_text(encoding="utf-8")
    sections = json.loads(re.search(r'id="malus-report">(.*?)</script>', text, re.S).group(1))["sections"]
    layers = [found for section in sections for block in section["blocks"] for found in block.get("layers", []) if found["name"] == layer]
    raster = next(found for found in layers[0]["rasters"] if found)
    code = shift = 0
    for byte in zlib.decompress(base64.b64decode(re.search(rf'id="{raster["blob"]}"[^>]*>(.*?)</script>', text, re.S).group(1))):
        code |= (byte & 127) << shift
        shift += 7
        if byte < 128:
            return ((code >> 1 ^ -(code & 1)) + 0.5) * raster["scales"][0]["step"]


def test_confidence_is_shown_of_what_is_shown(malus, tmp_path):
    """DoLP and AoLP are shown of the mean of the colours. Where these are turned against one another, each is sure of its angle and their mean is not."""
    model, shown = ("--model", "imx250myr-simulated", "--gain", 12, "--black", 82, "--white", WHITE), {}
    for name, angles in (("alike", (30, 30, 30)), ("turned", (30, 90, 150))):
        raw = color_frame(tmp_path / f"{name}.npy", angles)
        malus("stokes", raw, *model, "--format", "npy", "--no-legend", "-o", tmp_path)
        assert planes(tmp_path, name, "aolp_sd")[0].max() < 5
        assert planes(tmp_path, name, "dolp_corrected")[0].min() > 0.5
        for product in ("aolp_sd", "dolp_corrected", "dolp"):
            shown[name, product] = np.asarray(Image.open(tmp_path / f"{name}_{product}.png").convert("L")).mean()
        malus("denoise", raw, *model, "--uncertainty", "--report", tmp_path / f"{name}.html", "-o", tmp_path)
        shown[name, "report"] = first_value(tmp_path / f"{name}.html", "confidence: standard deviation of AoLP")
    assert shown["turned", "aolp_sd"] > 50 and shown["alike", "aolp_sd"] < 10
    assert shown["turned", "dolp_corrected"] == pytest.approx(shown["turned", "dolp"], abs=10)
    assert shown["alike", "dolp_corrected"] > 3 * shown["turned", "dolp_corrected"]
    assert shown["turned", "report"] > 10 and shown["alike", "report"] < 1


def test_dolp_of_noise_alone_does_not_run_away(malus, tmp_path):
    """Independent Gaussians around 0: DoLP is above 1 with probability 1/2 sqrt(2/3), S0 below 0 with 1/2. 65536 cells: 4 standard errors."""
    random = np.random.default_rng(6)
    dn = random.normal(0, 5, (512, 512)).astype(np.float32)
    np.save(tmp_path / "dark.npy", dn)
    frame = ("stokes", tmp_path / "dark.npy", "--layout", "polar-mono", "--black", 0, "--white", WHITE, "--force", "--format", "npy", "--no-pictures")
    found = malus(*frame, "-o", tmp_path, "--json").json
    i90, i45, i135, i0 = dn[::2, ::2], dn[::2, 1::2], dn[1::2, ::2], dn[1::2, 1::2]
    s0 = (i0 + i45 + i90 + i135) / 2
    truth = np.minimum(np.hypot(i0 - i90, i45 - i135)[s0 > 0] / s0[s0 > 0], 1).mean()
    assert found["mean_dolp"] == pytest.approx(truth, abs=1e-4) and found["mean_dolp"] < 1
    assert found["dolp_above_one"] == pytest.approx(np.sqrt(2 / 3) / 2, abs=4 * 0.5 / 256)
    assert found["undefined"] == pytest.approx(0.5, abs=4 * 0.5 / 256)
    assert "above 1 (noise) 41 %" in malus(*frame, "-o", tmp_path).out
    malus(*frame, *MODEL, "--gain", GAIN_DB, "-o", tmp_path)
    dolp, sd = planes(tmp_path, "dark", "dolp", "dolp_sd")
    assert np.nanmax(dolp) > 100  # as the formula gives it
    assert np.nanmax(sd / np.maximum(dolp, 1)) < 1 + 1e-5  # an unpolarized truth lies no further


def test_cells_without_an_angle_are_counted(malus, tmp_path):
    """Few codes often leave S1 = S2 = 0: DoLP is 0 there, AoLP undefined, though undefined was said to be nothing."""
    dn = np.random.default_rng(8).poisson(20, (128, 128)).astype(np.uint8)
    Image.fromarray(dn).save(tmp_path / "few.png")
    frame = ("stokes", tmp_path / "few.png", "--layout", "polar-mono", "--black", 0, "--white", 255, "--force", "--format", "npy", "--no-pictures")
    found = malus(*frame, "-o", tmp_path, "--json").json
    lost = np.isnan(planes(tmp_path, "few", "aolp")[0]).mean()
    assert lost > 0.002 and found["aolp_undefined"] == pytest.approx(lost, abs=1e-9) and found["undefined"] == 0
    assert f"undefined 0.00 %, AoLP undefined {100 * lost:.2f} %" in malus(*frame, "-o", tmp_path).out


def test_a_frame_of_nothing_but_saturated_cells_is_a_hundred_percent(malus, tmp_path):
    Image.fromarray(np.full((64, 64), WHITE, np.uint16)).save(tmp_path / "white.png")
    said = malus("stokes", tmp_path / "white.png", "--layout", "polar-mono", "--black", 0, "--white", WHITE, "-o", tmp_path).err
    assert "1024 cells (100 %) with saturated pixels" in said


@pytest.mark.parametrize("bias_dn", [6.0, -6.0])
def test_saturation_is_told_in_results_whatever_the_bias(malus, camera, tmp_path, bias_dn):
    """Bias and flats of a camera whose dark level lies off the nominal black."""
    random = np.random.default_rng(4)
    session = '[sensor]\nlayout="polar-mono"\nblack=100\nwhite=4095\nrow_group=1\n'
    for light in (0, 400, 900, 1500):
        kind = f'kind="flat"\nlevel={light}' if light else 'kind="bias"'
        session += f'[[frames]]\n{kind}\ngain_db=0\nexposure_s=0.01\npaths=["{light}_*.png"]\n'
        for i in range(8):
            dn = 0.5 * random.poisson(2 * light, (64, 64)) + random.normal(100 + bias_dn, 2, (64, 64))
            Image.fromarray(np.round(dn).astype(np.uint16)).save(tmp_path / f"{light}_{i}.png")
    (tmp_path / "session.toml").write_text(session)
    malus("calibrate", tmp_path / "session.toml", "-o", tmp_path / "model.h5")
    raw = raw_frame(camera, tmp_path / "raw.png", saturated=True)
    malus("denoise", raw, "--model", tmp_path / "model.h5", "--black", 100, "--u16", "-o", tmp_path)
    for name in ("raw_denoised.tif", "raw_denoised_u16.tif"):
        assert malus("stokes", tmp_path / name, "-o", tmp_path / "out", "--force", "--json").json["saturated_cells"] == 50


def test_the_models_bias_is_taken_out(malus, camera, tmp_path):
    assert np.abs(camera["bias"]).min() > 2  # 2 % of the light and more
    raw = raw_frame(camera, tmp_path / "raw.png", s0_dn=100)
    malus("stokes", raw, *MODEL, "--gain", GAIN_DB, "--format", "npy", "--no-pictures", "-o", tmp_path)
    s0, s1, s2 = (plane.mean() for plane in planes(tmp_path, "raw", "s0", "s1", "s2"))
    assert s0 == pytest.approx(100, abs=0.8)
    assert np.hypot(s1, s2) / s0 == pytest.approx(0.5, abs=0.01)


def test_deviations_of_stokes_parameters_are_those_of_their_intensities(malus, tmp_path):
    """Raw frames: the noise of the four angles is independent but for their row's offset, its variance the model's line at each pixel."""
    dn = np.random.default_rng(2).uniform(50, 900, (64, 64)).astype(np.float32)
    np.save(tmp_path / "raw.npy", dn)
    malus("stokes", tmp_path / "raw.npy", "--model", "imx250mzr-simulated", "--gain", 12, "--format", "npy", "-o", tmp_path)
    s0, s1, s2, dolp, s0_sd, s1_sd, s2_sd, dolp_sd = planes(tmp_path, "raw", "s0", "s1", "s2", "dolp", "s0_sd", "s1_sd", "s2_sd", "dolp_sd")
    # S0 = (I0 + I45 + I90 + I135) / 2, S1 = I0 - I90, S2 = I45 - I135.
    gain = malus("model", "show", "imx250mzr-simulated", "--gain", 12, "--json").json["gains"][0]
    slope = np.mean(gain["K"]["value"])
    # The model's rows are read two by two: a cell's four pixels have one offset, which S0 has twice and S1, S2 have not.
    row_dn = np.mean(gain["sigma_row"]["mean"])
    assert row_dn > 0.2 and np.allclose(4 * s0_sd ** 2, s1_sd ** 2 + s2_sd ** 2 + 16 * row_dn ** 2, rtol=1e-3)
    # Where I0 + I90 is larger by one DN, the variance of S1 is larger by K.
    i0_and_i90 = np.squeeze(dn[0::2, 0::2] + dn[1::2, 1::2])
    fit = np.polyfit(i0_and_i90.ravel(), np.squeeze(s1_sd).ravel() ** 2, 1)
    assert fit[0] == pytest.approx(slope, rel=0.05)
    for name in ("s0_sd", "s1_sd", "s2_sd"):
        assert (tmp_path / f"raw_{name}.png").stat().st_size > 100


def test_products_of_an_earlier_run_do_not_lie_beside_a_new_one(malus, camera, tmp_path):
    """Deviations without their result, or pictures of another one, would be taken for the new result's."""
    raw, out = raw_frame(camera, tmp_path / "raw.png"), tmp_path / "out"
    job = ("stokes", raw, *LAYOUT, "--black", 80, "--format", "npy", "-o", out)
    malus(*job, *MODEL, "--gain", GAIN_DB)
    names = ("s0", "s1", "s2", "dolp", "aolp")
    confidence = ("s0_sd", "s1_sd", "s2_sd", "dolp_sd", "aolp_sd", "dolp_corrected")
    def files(products, *endings):
        return {f"raw_{name}.{ending}" for name in products for ending in endings}
    def found():
        return {path.name for path in out.iterdir()}
    assert found() == files(names + confidence, "npy", "png")
    (out / "raw_denoised.tif").touch()  # nothing that stokes writes
    malus(*job, "--force", *MODEL, "--gain", GAIN_DB, "--no-pictures")
    assert found() == files(names + confidence, "npy") | {"raw_denoised.tif"}
    malus(*job, "--force")
    assert found() == files(names, "npy", "png") | {"raw_denoised.tif"}


def test_every_site_has_its_own_variance_where_names_repeat(malus, tmp_path):
    """A cell of four blocks with the polarizers in one order: whichever of its four sites "0" is noisy, the same is
    stated of their mean."""
    session, stated = tmp_path / "session.toml", []
    rows = 2 * [["0", "45", "0", "45"], ["135", "90", "135", "90"]]
    session.write_text(f"[sensor]\nblack = 0\nwhite = 4095\n[sensor.cell]\nrows = {rows}\n".replace("'", '"'))
    for site in (0, 2):
        random = np.random.default_rng(6)
        dn = random.normal(500, 4, (288, 256))
        dn[site::4, site::4] += random.normal(0, 40, (72, 64))
        np.save(tmp_path / "f.npy", dn.astype(np.float32))
        common = ("--session", session, "--force", "-o", tmp_path)
        malus("denoise", tmp_path / "f.npy", *common, "--uncertainty")
        malus("stokes", tmp_path / "f_denoised.tif", "--variance", tmp_path / "f_variance.exr", *common, "--no-pictures",
              "--format", "npy")
        stated.append(planes(tmp_path, "f_denoised", "dolp_sd")[0].mean())
    assert stated[1] == pytest.approx(stated[0], rel=0.2)  # two draws of even light: 11 %


def test_errors_of_raw_and_denoised_frames_are_not_mixed_up(malus, refused, camera, tmp_path):
    raw = raw_frame(camera, tmp_path / "raw.png")
    malus("denoise", raw, *MODEL, "--gain", GAIN_DB, "--uncertainty", "--u16", "-o", tmp_path)
    out, variance = ("-o", tmp_path / "out", "--no-pictures", "--force"), ("--variance", tmp_path / "raw_variance.exr")
    for name in ("raw_denoised.tif", "raw_denoised_u16.tif"):
        assert "is denoised" in refused("stokes", tmp_path / name, *MODEL, "--gain", GAIN_DB, *out)
        assert "not marked" not in malus("stokes", tmp_path / name, *variance, *out).err
        # Nor is the model's bias taken off a second time.
        assert "is denoised" in refused("denoise", tmp_path / name, *MODEL, "--gain", GAIN_DB, "-o", tmp_path / "out")
        assert "is denoised" in refused("renoise", tmp_path / name, *MODEL, "--from", GAIN_DB, "--to", 30, "-o", tmp_path / "out")
    mixed = malus("stokes", raw, *LAYOUT, "--black", 80, *variance, *out)
    assert mixed.err.count("not marked as denoised") == 1


def test_negative_variances_are_refused(malus, refused, camera, tmp_path):
    raw = raw_frame(camera, tmp_path / "raw.png")
    malus("denoise", raw, *MODEL, "--gain", GAIN_DB, "--uncertainty", "-o", tmp_path)
    written = (tmp_path / "raw_variance.exr").read_bytes()  # not compressed: the last value is that of the last pixel of 90 degrees
    (tmp_path / "v.exr").write_bytes(written[:-4] + np.float32(-4).tobytes())
    line = refused("stokes", tmp_path / "raw_denoised.tif", "--variance", tmp_path / "v.exr", "-o", tmp_path / "out")
    assert f"v.exr: a variance is negative: -4 DN² in row {SIDE - 2}, column {SIDE - 2}" in line
    assert not list((tmp_path / "out").glob("*"))


def test_normals_say_what_they_guess(malus, camera, tmp_path):
    raw = raw_frame(camera, tmp_path / "raw.png")
    assert "black level not known" in malus("normals", raw, *LAYOUT, "-o", tmp_path).err
    assert "black level not known" not in malus("normals", raw, *LAYOUT, "--black", 80, "-o", tmp_path, "--force").err


def test_a_reference_has_the_black_that_is_given(malus, camera, tmp_path):
    raw, clean = raw_frame(camera, tmp_path / "raw.png"), raw_frame(camera, tmp_path / "clean.png")
    given = (*MODEL, "--gain", GAIN_DB, "--reference", clean, "-o", tmp_path, "--force")
    assert "black level not known" in malus("denoise", raw, *given).err
    assert "black level not known" not in malus("denoise", raw, *given, "--black", 82).err


def test_inputs_are_looked_for_before_any_work(malus, refused, camera, tmp_path):
    raw, later = raw_frame(camera, tmp_path / "raw.png"), tmp_path / "later.png"
    job = ("denoise", raw, later, *MODEL, "--gain", GAIN_DB, "-o", tmp_path / "out")
    assert "later.png" in refused(*job)
    assert not list((tmp_path / "out").glob("*"))
    raw_frame(camera, later)
    malus(*job)


def test_a_layout_taken_from_the_model_is_said(malus, camera, tmp_path):
    raw = raw_frame(camera, tmp_path / "raw.png")
    job = ("denoise", raw, *MODEL, "--gain", GAIN_DB, "-o", tmp_path, "--force")
    assert "layout not told, taken as the model's, polar-mono" in malus(*job).err
    assert "layout not told" not in malus(*job, *LAYOUT).err
    assert malus(*job, "-q").err == ""


def test_demosaicking_is_for_full_resolution(malus, camera, tmp_path):
    raw = raw_frame(camera, tmp_path / "raw.png")
    job = ("stokes", raw, *LAYOUT, "--black", 80, "--demosaick", "bilinear", "--no-pictures", "-o", tmp_path)
    assert "--full" in malus(*job, code=2).err
    malus(*job, "--full")


@pytest.mark.parametrize("largest, white", [(200, 255), (1759, 4095), (5000, 16383), (20000, None)])
def test_info_names_white_levels_that_sensors_have(malus, tmp_path, largest, white):
    ramp = np.linspace(0, largest, 64 * 64).reshape(64, 64)
    Image.fromarray(np.round(ramp).astype(np.uint16)).save(tmp_path / "ramp.png")
    warnings = [w for w in malus("info", tmp_path / "ramp.png", "--json").json["warnings"] if "--white" in w]
    assert [w.split()[-1] for w in warnings] == ([str(white)] if white else [])
