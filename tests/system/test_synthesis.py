"""Training material as a user makes it: renoise, pairs, simulate, checked with numpy."""

import json
import os
import pathlib
import re
import shutil

import h5py
import numpy as np
import pytest
from PIL import Image

pytestmark = pytest.mark.slow

MODEL = "imx250myr-simulated"
SEEDS = pathlib.Path(__file__).resolve().parents[2] / "fuzz/corpus/model"


def truth(malus, gain, model=MODEL):
    return malus("model", "show", model, "--gain", gain, "--json").json["gains"][0]


def smooth_scene(rows=96, cols=128, low=200, high=1500):
    y, x = np.mgrid[:rows, :cols]
    return (low + (high - low) * (0.5 + 0.25 * np.sin(x / 9) + 0.25 * np.cos(y / 7))).astype(np.float32)


def test_float_frames_are_above_black_whatever_black_says(malus, tmp_path):
    np.save(tmp_path / "flat.npy", np.full((32, 32), 300, np.float32))
    for name, black in (("plain", []), ("said", ["--black", 82])):
        done = malus("synthesize", tmp_path / "flat.npy", "-m", MODEL, "--gain", 6, *black, "-o", tmp_path / name, "--format", "npy")
        assert ("--black is not subtracted" in done.err) == bool(black)
    assert np.array_equal(np.load(tmp_path / "plain/flat_000.npy"), np.load(tmp_path / "said/flat_000.npy"))


def test_amplified_integers_keep_the_noise_below_black(malus, tmp_path):
    np.save(tmp_path / "dim.npy", np.full((256, 256), 20, np.float32))
    run = malus("synthesize", tmp_path / "dim.npy", "-m", MODEL, "--gain", 24, "--ratio", 10, "--amplify", "--debias", "--parameters", "mean",
                "-o", tmp_path / "out", "--json").json["frames"][0]
    black = run["black_dn"][0]  # ten times the sensor's 82 and a bias
    assert run["black_dn"] == [black] * 16 and run["white_dn"] == 40950
    info = malus("info", tmp_path / "out/dim_000.tif", "--json").json
    assert info["black"] == run["black_dn"] and info["white"] == 40950
    dn = np.array(Image.open(tmp_path / "out/dim_000.tif")).astype(float)
    # 65,536 pixels of about 220 DN: five standard errors are 4.3 DN; 128 row groups add theirs.
    assert (dn == 0).mean() < 1e-4 and abs(dn.mean() - black - 20) < 15


def unit_scale_model(malus, folder):
    """Of float frames from 0 to 1, 10,000 electrons wide."""
    rng, sections = np.random.default_rng(5), ['[sensor]\nlayout = "mono"\nblack = 0.02\nwhite = 1\n']
    for k, electrons in enumerate([0, *np.linspace(500, 6500, 6)]):
        for n in range(3):
            frame = (rng.poisson(electrons, (64, 64)) + rng.normal(0, 3, (64, 64))) / 10000 + 0.02
            np.save(folder / f"f{k}_{n}.npy", frame.astype(np.float32))
        kind = "flat" if k else "bias"
        sections.append(f'[[frames]]\nkind = "{kind}"\ngain_db = 6\nexposure_s = {0.01 * k + 0.001}\npaths = ["f{k}_*.npy"]\n')
    (folder / "s.toml").write_text("\n".join(sections))
    malus("calibrate", folder / "s.toml", "-o", folder / "unit.h5")


def test_integers_that_cannot_hold_a_cameras_frames_are_refused(malus, refused, tmp_path):
    unit_scale_model(malus, tmp_path)
    for name, facts in (("wide", {"white_dn": 1e6}), ("below", {"black_dn": [-500, -500]})):
        shutil.copy(SEEDS / "good_full.h5", tmp_path / f"{name}.h5")
        with h5py.File(tmp_path / f"{name}.h5", "a") as file:
            for key, value in facts.items():
                file[f"sensor/{key}"][...] = value
    np.save(tmp_path / "flat.npy", np.full((32, 32), 0.4, np.float32))
    for name, said in (("wide", "white 1e+06 DN is above 65535"), ("below", "black -500 DN is below 0"), ("unit", "rounding")):
        model, gains = tmp_path / f"{name}.h5", {"synthesize": ["--gain", 6], "renoise": ["--from", 0, "--to", 6]}
        if name == "unit":
            gains = {"synthesize": ["--gain", "random"]}
        for command, flags in gains.items():
            base = [command, tmp_path / "flat.npy", "-m", model, *flags, "-o", tmp_path / name]
            line = refused(*base)
            assert f"{name}.h5: " in line and said in line and line.endswith("; give --float") and not (tmp_path / name).exists()
        malus("synthesize", tmp_path / "flat.npy", "-m", model, "--gain", 6, "--float", "-o", tmp_path / name)


# renoise

def test_renoised_flats_have_the_noise_of_the_target_gain(malus, tmp_path):
    level = 400.0
    np.save(tmp_path / "flat.npy", np.full((512, 512), level, np.float32))
    malus("synthesize", tmp_path / "flat.npy", "-m", MODEL, "--gain", 6, "--parameters", "mean", "-o", tmp_path / "source",
          "--format", "npy", "--float")
    malus("renoise", tmp_path / "source/flat_000.npy", "-m", MODEL, "--from", 6, "--to", 18, "--float", "--black", "0",
          "--guide", tmp_path / "flat.npy", "--format", "npy", "-o", tmp_path / "out")
    noisy = np.load(tmp_path / "out/flat_000_renoised.npy").astype(float)
    target = truth(malus, 18)
    for channel in (0, 7, 15):
        plane = noisy[channel // 4::4, channel % 4::4]
        rows = plane.mean(axis=1)
        inside = plane - rows[:, None]
        electron = target["K"]["value"][channel]
        variance = electron * level + (target["read_noise"]["value"][channel] * electron) ** 2 + 1 / 12
        # 16000 pixels of 128 rows: sampling error 1.1 %, bins of the deconvolution 1 %.
        assert inside.var() * 128 / 127 == pytest.approx(variance, rel=0.06)
        error = np.sqrt(variance / plane.size + target["sigma_row"]["mean"][channel] ** 2 / 128)
        assert plane.mean() - level == pytest.approx(target["mu"]["mean"][channel], abs=5 * error + 0.01 * np.sqrt(variance))


def test_renoise_keeps_detail_that_the_naive_method_loses(malus, tmp_path):
    blocks = np.indices((256, 256)).sum(axis=0) // 4 % 2  # one packed pixel each
    np.save(tmp_path / "scene.npy", (500 + 40.0 * (2 * blocks - 1)).astype(np.float32))
    np.save(tmp_path / "guide.npy", np.full((256, 256), 500, np.float32))
    malus("synthesize", tmp_path / "scene.npy", "-m", MODEL, "--gain", 6, "-o", tmp_path / "source")
    contrast = {}
    for method in ("noise-on-noise", "naive"):
        malus("renoise", tmp_path / "source/scene_000.tif", "-m", MODEL, "--from", 6, "--to", 12, "--method", method,
              "--guide", tmp_path / "guide.npy", "-o", tmp_path / method)
        dn = np.array(Image.open(tmp_path / method / "scene_000_renoised.tif")).astype(float)
        contrast[method] = (dn[blocks == 1].mean() - dn[blocks == 0].mean()) / 80
    assert contrast["noise-on-noise"] == pytest.approx(1, abs=0.05)
    assert contrast["naive"] == pytest.approx(0, abs=0.05)


def test_renoise_refuses_quieter_targets_and_missing_guides(malus, refused, tmp_path):
    np.save(tmp_path / "flat.npy", np.full((16, 16), 400, np.float32))
    arguments = ["renoise", tmp_path / "flat.npy", "-m", MODEL, "--black", "0", "-o", tmp_path / "out"]
    assert "more noise" in refused(*arguments, "--from", 18, "--to", 6)
    usage = malus(*arguments, "--from", 6, "--to", 18, "--guide", tmp_path / "a.npy", tmp_path / "b.npy", code=2)
    assert "one per frame" in usage.err
    assert "outside the calibrated range" in refused(*arguments, "--from", 6, "--to", 90)
    # By either method the noise is of the kind that is asked for, which this model does not hold.
    for method in ("noise-on-noise", "naive"):
        assert "holds no nonparametric model" in refused(*arguments, "--from", 6, "--to", 18, "--method", method, "--kind", "nonparametric")


def test_the_renoise_experiment_takes_its_clean_frame_as_synthesize_does(malus, refused, tmp_path):
    clean = np.full((32, 32), 400, np.float32)
    np.save(tmp_path / "codes.npy", clean.astype(np.uint16))
    run = ["experiment", "renoise", "--frames", 2, "--weak-guide", "vst-bm3d", "--json"]
    assert "codes.npy: holds integers, but its black level is not known; give --black" in refused(*run, tmp_path / "codes.npy")
    clean[3, 5] = np.nan
    np.save(tmp_path / "hole.npy", clean)
    done = malus(*run, tmp_path / "hole.npy")
    assert "hole.npy: 1 pixel is NaN or infinite; taken as dark" in done.err
    assert all(np.isfinite(row["detail_psnr_db"]) for row in done.json["variants"])
    np.save(tmp_path / "none.npy", np.full((32, 32), np.nan, np.float32))
    assert "none.npy" in refused(*run, tmp_path / "none.npy")


def test_the_renoise_experiment_believes_a_stated_layout(refused, tmp_path):
    np.save(tmp_path / "clean.npy", np.full((32, 32), 400, np.float32))
    line = refused("experiment", "renoise", tmp_path / "clean.npy", "--layout", "mono", "--frames", 2)
    assert "clean.npy" in line and "layout" in line


def test_noise_on_noise_beats_the_naive_method_in_noise_and_in_detail(malus, tmp_path):
    y, x = np.mgrid[:128, :160]
    fine = np.repeat(np.repeat(np.random.default_rng(6).uniform(-25, 25, (32, 40)), 4, 0), 4, 1)
    np.save(tmp_path / "clean.npy", (150 + 100 * np.sin(x / 25) * np.cos(y / 19) + fine).clip(5).astype(np.float32))
    result = malus("experiment", "renoise", tmp_path / "clean.npy", "--from", 12, "--to", 18, "--frames", 6, "--json").json
    by_name = {row["name"]: row for row in result["variants"]}
    ours, naive = by_name["noise on noise, bm3d"], by_name["naive: bm3d + new noise"]
    best = by_name["frames of the target gain"]
    assert ours["sqrt_jsd"] < 0.85 * naive["sqrt_jsd"] and ours["sqrt_jsd"] < 1.25 * best["sqrt_jsd_floor"]
    assert ours["detail_psnr_db"] > naive["detail_psnr_db"] + 0.2
    assert ours["detail_psnr_db"] == pytest.approx(best["detail_psnr_db"], abs=0.3)


# pairs

def write_pairs_session(folder, light, exposure=0.001):
    """A reference stack and short frames whose lamp flickers by `light`."""
    rng = np.random.default_rng(5)
    scene = smooth_scene()
    sections = []
    for kind, factors, seconds in (("reference", [1.0] * 8, 0.01), ("short", light, exposure)):
        names = []
        for number, factor in enumerate(factors):
            mean = scene * factor * seconds / 0.01
            frame = np.clip(np.round(64 + rng.poisson(mean)), 0, 4095).astype(np.uint16)
            names.append(f"{kind}_{number}.png")
            Image.fromarray(frame).save(folder / names[-1])
        paths = ", ".join(f'"{name}"' for name in names)
        sections.append(f'[[frames]]\nkind = "{kind}"\nexposure_s = {seconds}\ngain_db = 0\nlevel = 3\npaths = [{paths}]\n')
    session = folder / "session.toml"
    session.write_text('[sensor]\nlayout = "polar-mono"\nblack = 64\nwhite = 4095\n' + "\n".join(sections))
    return session, scene


def test_pairs_take_the_frame_nearest_in_light(malus, tmp_path):
    light = [0.90, 1.08, 0.99, 1.05]
    session, scene = write_pairs_session(tmp_path, light)
    result = malus("pairs", session, "-o", tmp_path / "out", "--json").json
    (pair,) = result["pairs"]
    assert pair["ratio"] == pytest.approx(10) and pair["reference_frames"] == 8
    assert pair["source"].endswith("short_2.png")
    assert np.allclose(np.array(pair["candidates"]) * 10, light, rtol=0.01)
    assert pair["flicker"] == pytest.approx(0.18 / np.mean(light), rel=0.1)
    stack = np.mean([np.array(Image.open(tmp_path / f"reference_{n}.png")).astype(float) for n in range(8)], axis=0)
    reference = np.array(Image.open(tmp_path / "out" / pair["reference"]))
    assert np.allclose(reference, stack - 64, atol=1e-3)
    short = np.array(Image.open(tmp_path / "out" / pair["short"]))
    assert np.array_equal(short, np.array(Image.open(tmp_path / "short_2.png")))
    assert json.loads((tmp_path / "out/pairs.json").read_text()) == result
    assert pair["bias_removed"] is False and pair["reference_gain"] == {"gain_db": 0, "iso": None}
    model = ["--model", "imx250mzr-simulated"]
    assert malus("pairs", session, "-o", tmp_path / "unbiased", *model, "--json").json["pairs"][0]["bias_removed"] is True


def test_flicker_of_pairs_that_is_no_more_than_noise_is_not_told(malus, tmp_path):
    """A hundredth of an electron a pixel: two frames of the same lamp differ by per cent."""
    session, _ = write_pairs_session(tmp_path, [1e-4, 1e-4], exposure=0.001)
    run = malus("pairs", session, "-o", tmp_path / "out", "--ratio", 1e5, "--json")
    (pair,) = run.json["pairs"]
    first, second = pair["candidates"]
    assert pair["flicker"] is None and 2 * abs(first - second) / (first + second) < pair["flicker_of_noise"] > 0.01
    told = malus("pairs", session, "-o", tmp_path / "out", "--ratio", 1e5, "--force").out
    assert re.search(r"2 candidates, .*flicker not seen above the noise \(\d+\.\d\d %\)", told)


def test_pairs_of_files_with_any_name(malus, tmp_path):
    session, _ = write_pairs_session(tmp_path, [1.0])
    os.rename(tmp_path / "short_0.png", os.fsencode(tmp_path) + b"/short_\xe9.png")
    session.write_text(session.read_text().replace("short_0.png", "short_*.png"))
    result = malus("pairs", session, "-o", tmp_path / "out", "--json").json
    assert "\N{REPLACEMENT CHARACTER}" in result["pairs"][0]["source"]
    assert json.loads((tmp_path / "out/pairs.json").read_text()) == result


def test_pairs_whose_light_does_not_fit_the_ratio_are_said(malus, tmp_path):
    session, _ = write_pairs_session(tmp_path, [1.05, 1.0])
    assert "off the reference" not in malus("pairs", session, "-o", tmp_path / "fits").err
    assert "off the reference over 30" in malus("pairs", session, "-o", tmp_path / "not", "--ratio", 30).err


def test_pairs_name_references_that_white_cuts_off_and_shorts_that_are_longer(malus, refused, tmp_path):
    session, scene = write_pairs_session(tmp_path, [1.0, 1.0])
    text = session.read_text()
    assert "at white" not in malus("pairs", session, "-o", tmp_path / "whole").err
    white = 64 + float(np.quantile(scene, 0.75))
    session.write_text(text.replace("white = 4095", f"white = {white}"))
    clipped = malus("pairs", session, "-o", tmp_path / "clipped", "--json")
    assert "of the reference's pixels are at white" in clipped.err
    assert clipped.json["pairs"][0]["reference_clipped_share"] == pytest.approx(0.25, abs=0.06)
    # A model's bias is taken off, and white with it.
    camera = f'[sensor]\nlayout = "polar-mono"\nblack = 0\nwhite = {white}\n'
    for level, light in enumerate((0, 100, 200, 400)):
        for i in range(2):
            random = np.random.default_rng((level, i))
            frame = random.normal(64, 2, (64, 64)) + random.poisson(light, (64, 64))
            np.save(tmp_path / f"{level}_{i}.npy", frame.round().astype(np.uint16))
        camera += (f'[[frames]]\nkind = "{"flat" if level else "bias"}"\ngain_db = 0\nlevel = {level}\n'
                   f'exposure_s = {0.001 * light or 1e-6}\npaths = ["{level}_*.npy"]\n')
    (tmp_path / "camera.toml").write_text(camera)
    malus("calibrate", tmp_path / "camera.toml", "-o", tmp_path / "m.h5")
    session.write_text(text.replace("white = 4095", f"white = {white}").replace("black = 64", "black = 0"))
    of_model = malus("pairs", session, "-o", tmp_path / "of_model", "--model", tmp_path / "m.h5", "--ratio", 10, "--json")
    (pair,) = of_model.json["pairs"]
    assert pair["reference_clipped_share"] == pytest.approx(0.25, abs=0.06)
    told = malus("info", tmp_path / "of_model" / pair["reference"], "--json").json
    assert told["white"] == pytest.approx(white - 64, abs=1)
    session.write_text(text.replace("exposure_s = 0.001", "exposure_s = 0.02"))
    assert "short frames of 0.02 s, longer than their reference of 0.01 s" in refused("pairs", session, "-o", tmp_path / "swapped")


def test_a_frame_is_not_its_own_reference(refused, tmp_path):
    """Its noise would be in both, and a network would learn to keep it."""
    np.save(tmp_path / "a.npy", np.full((8, 8), 900, np.uint16))
    (tmp_path / "b.npy").symlink_to("a.npy")
    session = tmp_path / "s.toml"
    session.write_text('[sensor]\nlayout = "mono"\nblack = 0\nwhite = 4095\n[[frames]]\nkind = "reference"\npaths = ["a.npy"]\n'
                       '[[frames]]\nkind = "short"\npaths = ["b.npy"]\n')
    line = refused("pairs", session, "-o", tmp_path / "out", "--ratio", 10)
    assert "s.toml: scene: " in line and "b.npy is named as reference and as short frame" in line
    assert not (tmp_path / "out").exists()


def test_pairs_name_what_is_missing(malus, refused, tmp_path):
    session, _ = write_pairs_session(tmp_path, [1.0, 1.0])
    text = session.read_text()
    session.write_text(text.replace('kind = "short"', 'kind = "burst"'))
    assert "has no short frames" in refused("pairs", session, "-o", tmp_path / "out")
    session.write_text(text.replace("exposure_s = 0.001\n", ""))
    assert "--ratio" in refused("pairs", session, "-o", tmp_path / "out")
    assert malus("pairs", session, "-o", tmp_path / "out", "--ratio", 10, "--json").json["pairs"]
    Image.fromarray(np.zeros((40, 40), np.uint16)).save(tmp_path / "short_1.png")
    session.write_text(text)
    assert "another size" in refused("pairs", session, "-o", tmp_path / "out", "--force")


# simulate

def test_simulate_undoes_the_tone_curve_and_the_white_balance(malus, tmp_path):
    rng = np.random.default_rng(2)
    srgb = rng.integers(0, 256, (64, 64, 3), dtype=np.uint8)
    Image.fromarray(srgb).save(tmp_path / "picture.png")
    malus("simulate", "--white-balance", 2, 1, 1.6, tmp_path / "picture.png", "-o", tmp_path / "out", "--layout", "bayer-rggb",
          "--format", "npy", "--full-scale", 2000)
    mosaic = np.load(tmp_path / "out/picture_clean.npy")
    value = srgb / 255.0
    linear = np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4) * 2000 / np.array([2, 1, 1.6])
    # Each site sees its own colour of the full-resolution picture; an unpolarized layout sees S0.
    for r, c, k in ((0, 0, 0), (0, 1, 1), (1, 0, 1), (1, 1, 2)):
        assert np.allclose(mosaic[r::2, c::2], linear[r::2, c::2, k], rtol=2e-4, atol=1e-2)


def test_simulated_polarization_is_physical_and_the_mosaic_shows_it(malus, tmp_path):
    rng = np.random.default_rng(3)
    Image.fromarray(rng.integers(40, 220, (64, 64), dtype=np.uint8)).resize((128, 128)).convert("RGB").save(tmp_path / "p.png")
    arguments = ["--polarized", "--layout", "polar-mono", "--format", "npy", "--seed", 4]
    malus("simulate", tmp_path / "p.png", "-o", tmp_path / "one", "--truth", *arguments)
    malus("simulate", tmp_path / "p.png", "-o", tmp_path / "two", *arguments, "--threads", 1)
    mosaic = np.load(tmp_path / "one/p_clean.npy")
    assert np.array_equal(mosaic, np.load(tmp_path / "two/p_clean.npy"))
    files = sorted(path.name for path in (tmp_path / "one").iterdir())
    assert files == ["p_aolp.exr", "p_clean.npy", "p_dolp.exr", "p_normals.exr", "p_s0.exr", "p_s1.exr", "p_s2.exr"]
    # Opposite polarizers pass the same total on smooth light, and no polarizer passes more than all of it.
    i90, i45, i135, i0 = mosaic[::2, ::2], mosaic[::2, 1::2], mosaic[1::2, ::2], mosaic[1::2, 1::2]
    s0 = (i0 + i45 + i90 + i135) / 2
    dolp = np.hypot(i0 - i90, i45 - i135) / np.maximum(s0, 1)
    assert (mosaic >= 0).all() and 0.01 < np.median(dolp) < 0.6
    malus("simulate", tmp_path / "p.png", "-o", tmp_path / "other", *arguments[:-1], 5)
    assert not np.array_equal(mosaic, np.load(tmp_path / "other/p_clean.npy"))


def test_simulate_refuses_what_it_cannot_use(refused, tmp_path):
    (tmp_path / "broken.png").write_bytes(b"no picture")
    refused("simulate", tmp_path / "broken.png", "-o", tmp_path / "out")
    Image.fromarray(np.zeros((2, 2, 3), np.uint8)).save(tmp_path / "tiny.png")
    assert "larger picture" in refused("simulate", tmp_path / "tiny.png", "-o", tmp_path / "out")


def test_jpeg_is_clean_material_and_no_measurement(malus, refused, tmp_path):
    rows, cols = np.mgrid[0:48, 0:64]
    colors = np.stack([60 + 3 * rows, 200 - 2 * cols, 90 + rows], 2).astype(np.uint8)
    picture = tmp_path / "a.jpg"
    Image.fromarray(colors).save(picture, quality=95)
    Image.fromarray(np.asarray(Image.open(picture))).save(tmp_path / "b.png")  # as decoded
    malus("simulate", picture, tmp_path / "b.png", "-o", tmp_path, "--format", "npy", "--layout", "bayer-rggb")
    jpeg, png = np.load(tmp_path / "a_clean.npy"), np.load(tmp_path / "b_clean.npy")
    assert np.allclose(jpeg, png, rtol=0.05) and jpeg.std() > 0.1 * jpeg.mean()
    facts = ["--layout", "polar-mono", "--black", 0, "--white", 255]
    for command in (["info"], ["stokes", *facts, "-o", tmp_path / "out"],
                    ["denoise", *facts, "--model", "imx250mzr-simulated", "--gain", 12, "-o", tmp_path / "out"],
                    ["synthesize", "--model", "imx250mzr-simulated", "--gain", 12, "-o", tmp_path / "out"],
                    ["evaluate", "--reference", tmp_path / "b.png", "--test"]):
        assert "a.jpg: is a JPEG picture, which holds no raw values" in refused(*command, picture)
    cut = tmp_path / "cut.jpg"
    whole = picture.read_bytes()
    cut.write_bytes(whole[:(whole.index(b"\xff\xda") + len(whole)) // 2])  # among the coded pixels
    assert "cut.jpg: the JPEG file ends before its end marker" in refused("simulate", cut, "-o", tmp_path / "out")
    cut.write_bytes(cut.read_bytes() + b"\xff\xd9")
    assert "cut.jpg: cannot be decoded" in refused("simulate", cut, "-o", tmp_path / "out")


# numbers of frames and scenes

def test_frame_numbers_do_not_come_round(malus, misused, tmp_path):
    np.save(tmp_path / "flat.npy", np.full((16, 16), 300, np.float32))
    common = [tmp_path / "flat.npy", "-m", MODEL, "--gain", 6, "-o", tmp_path / "out"]
    assert "--first-frame 4294967295" in misused("synthesize", *common, "--first-frame", 2**32 - 1, "--frames", 2)
    assert not (tmp_path / "out").exists()
    malus("synthesize", *common, "--first-frame", 2**32 - 2, "--frames", 2)
    Image.fromarray(np.zeros((8, 8, 3), np.uint8)).save(tmp_path / "a.png")
    Image.fromarray(np.zeros((8, 8, 3), np.uint8)).save(tmp_path / "b.png")
    pictures = [tmp_path / "a.png", tmp_path / "b.png", "-o", tmp_path / "clean"]
    assert "--first-scene 4294967295" in misused("simulate", *pictures, "--first-scene", 2**32 - 1)
    malus("simulate", *pictures, "--first-scene", 2**32 - 2)


# results that would replace what is read

def test_truth_and_pairs_replace_no_input(malus, refused, tmp_path):
    Image.fromarray(np.full((8, 8, 3), 90, np.uint8)).save(tmp_path / "a.png")
    malus("simulate", tmp_path / "a.png", "-o", tmp_path, "--truth")
    kept = (tmp_path / "a_s0.exr").read_bytes()
    assert "is an input" in refused("simulate", tmp_path / "a_s0.exr", tmp_path / "a.png", "-o", tmp_path, "--truth", "--force")
    assert (tmp_path / "a_s0.exr").read_bytes() == kept
    Image.fromarray(np.full((16, 16), 900, np.uint16)).save(tmp_path / "scene_00_short.tif")
    Image.fromarray(np.full((16, 16), 9000, np.uint16)).save(tmp_path / "long.tif")
    session = tmp_path / "session.toml"
    session.write_text('[sensor]\nlayout = "mono"\nblack = 0\nwhite = 65535\n[[frames]]\nkind = "reference"\npaths = ["long.tif"]\n'
                       '[[frames]]\nkind = "short"\npaths = ["scene_00_short.tif"]\n')
    kept = (tmp_path / "scene_00_short.tif").read_bytes()
    assert "is an input" in refused("pairs", session, "-o", tmp_path, "--ratio", 10, "--force")
    assert (tmp_path / "scene_00_short.tif").read_bytes() == kept
    malus("pairs", session, "-o", tmp_path / "out", "--ratio", 10)


@pytest.mark.parametrize("kind, black, offset", [(np.uint32, 0, 90000), (np.int16, -40, 0)])
def test_pairs_keep_pixels_that_16_bits_cannot_hold(malus, tmp_path, kind, black, offset):
    """Wide integers and those below 0 are written as floats, above black."""
    rng, scene = np.random.default_rng(8), smooth_scene(32, 48, 5, 60) + offset
    frames = {name: np.round(black + scene * light + rng.normal(0, 15, scene.shape)).astype(kind) for name, light in (("r", 4), ("s", 1))}
    sections = [f'[sensor]\nlayout = "mono"\nblack = {black}\nwhite = {30000 if kind == np.int16 else 1000000}\n']
    for name, frame_kind, exposure in (("r", "reference", 0.04), ("s", "short", 0.01)):
        np.save(tmp_path / f"{name}.npy", frames[name])
        sections.append(f'[[frames]]\nkind = "{frame_kind}"\nexposure_s = {exposure}\ngain_db = 0\npaths = ["{name}.npy"]\n')
    (tmp_path / "s.toml").write_text("\n".join(sections))
    (pair,) = malus("pairs", tmp_path / "s.toml", "-o", tmp_path / "out", "--json").json["pairs"]
    short = np.array(Image.open(tmp_path / "out" / pair["short"]))
    assert short.dtype == np.float32 and np.array_equal(short, frames["s"].astype(float) - black)
    info = malus("info", tmp_path / "out" / pair["short"], "--json").json
    assert set(info["black"]) == {0} and info["white"] == (30040 if kind == np.int16 else 1000000)
