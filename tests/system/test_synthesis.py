"""Training material as a user makes it: renoise, pairs, simulate, dataset and every kind of noise model, checked with numpy."""

import io
import json
import os
import signal
import struct
import subprocess
import tarfile
import time

import numpy as np
import pytest
from PIL import Image

from conftest import PROGRAM

MODEL = "imx250myr-simulated"


def truth(malus, gain, model=MODEL):
    return malus("model", "show", model, "--gain", gain, "--json").json["gains"][0]


def smooth_scene(rows=96, cols=128, low=200, high=1500):
    y, x = np.mgrid[:rows, :cols]
    return (low + (high - low) * (0.5 + 0.25 * np.sin(x / 9) + 0.25 * np.cos(y / 7))).astype(np.float32)


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
    assert "one per frame" in refused(*arguments, "--from", 6, "--to", 18, "--guide", tmp_path / "a.npy", tmp_path / "b.npy")
    assert "outside the calibrated range" in refused(*arguments, "--from", 6, "--to", 90)


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
    malus("simulate", tmp_path / "picture.png", "-o", tmp_path / "out", "--layout", "bayer-rggb", "--format", "npy",
          "--full-scale", 2000, "--white-balance", 2, 1, 1.6)
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
    Image.fromarray(np.zeros((8, 8, 3), np.uint8)).save(tmp_path / "dark.png")
    assert "nine" in refused("simulate", tmp_path / "dark.png", "-o", tmp_path / "out", "--color-matrix", 1, 2, 3)


# dataset

def write_plan(folder, samples=40, shard_size=8, extra=""):
    np.save(folder / "a_clean.npy", smooth_scene(160, 192))
    np.save(folder / "b_clean.npy", smooth_scene(128, 128, 20, 300))
    plan = folder / "plan.toml"
    plan.write_text(f'model = "{MODEL}"\nclean = ["*_clean.npy"]\n[dataset]\nsamples = {samples}\nshard_size = {shard_size}\n'
                    f'patch = 64\nratios = [4, 20]\n{extra}')
    return plan


def shards(folder):
    return {path.name: path.read_bytes() for path in sorted(folder.glob("shard-*.tar"))}


def test_dataset_holds_pairs_that_numpy_reads(malus, tmp_path):
    plan = write_plan(tmp_path)
    result = malus("dataset", plan, "-o", tmp_path / "out", "--seed", 9, "--json").json
    assert result["shards"] == result["made"] == 5
    sources = {name: np.load(tmp_path / name) for name in ("a_clean.npy", "b_clean.npy")}
    seen, residual = 0, []
    for content in shards(tmp_path / "out").values():
        with tarfile.open(fileobj=io.BytesIO(content)) as tar:
            files = {member.name: tar.extractfile(member).read() for member in tar}
        for name in (n for n in files if n.endswith(".json")):
            facts = json.loads(files[name])
            clean, noisy = (np.load(io.BytesIO(files[name.replace("json", f"{what}.npy")])) for what in ("clean", "noisy"))
            assert clean.shape == noisy.shape == (16, 16, 16) and clean.dtype == np.float32
            assert facts["ratio"] in (4, 20) and 0 <= facts["gain_db"] <= 30
            source = sources[facts["source"]]
            assert source.min() - 1e-3 <= clean.min() and clean.max() <= source.max() + 1e-3
            if facts["symmetry"] == "identity":
                patch = source[facts["row"]:facts["row"] + 64, facts["col"]:facts["col"] + 64]
                packed = patch.reshape(16, 4, 16, 4).transpose(1, 3, 0, 2).reshape(16, 16, 16)
                assert np.array_equal(clean, packed)
            residual.append(((noisy - clean).mean(), (noisy - clean).std()))
            seen += 1
    assert seen == 40
    mean, spread = np.array(residual).T
    assert abs(mean.mean()) < 5 * spread.max() / np.sqrt(40) and (spread > 1).all()
    assert len({round(s, 3) for s in spread}) == 40  # every sample has noise of its own


def test_dataset_is_the_same_for_any_number_of_workers(malus, tmp_path):
    plan = write_plan(tmp_path)
    malus("dataset", plan, "-o", tmp_path / "one", "--threads", 1)
    for rank, names in ((0, ("RANK", "WORLD_SIZE")), (1, ("SLURM_PROCID", "SLURM_NTASKS"))):
        environment = {**os.environ, names[0]: str(rank), names[1]: "2"}
        malus("dataset", plan, "-o", tmp_path / "two", env=environment)
    for rank in range(3):
        malus("dataset", plan, "-o", tmp_path / "three", "--rank", rank, "--world", 3)
    assert shards(tmp_path / "one") == shards(tmp_path / "two") == shards(tmp_path / "three")


def test_killed_dataset_goes_on_to_the_same_bytes(malus, tmp_path):
    plan = write_plan(tmp_path, samples=800, shard_size=8)
    out = tmp_path / "killed"
    process = subprocess.Popen([PROGRAM, "dataset", str(plan), "-o", str(out), "--threads", "1", "-q"],
                               stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    deadline = time.monotonic() + 60
    while len(shards(out) if out.is_dir() else {}) < 3 and time.monotonic() < deadline:
        time.sleep(0.005)
    process.send_signal(signal.SIGKILL)
    process.wait()
    done = shards(out)
    assert 3 <= len(done) < 100
    for content in done.values():  # whatever has its name is whole
        assert len(tarfile.open(fileobj=io.BytesIO(content)).getmembers()) == 24
    result = malus("dataset", plan, "-o", out, "--json").json
    assert result["kept"] == len(done) and result["made"] == 100 - len(done)
    malus("dataset", plan, "-o", tmp_path / "whole")
    assert shards(out) == shards(tmp_path / "whole")


def test_dataset_refuses_bad_plans(malus, refused, tmp_path):
    plan = write_plan(tmp_path)
    malus("dataset", plan, "-o", tmp_path / "out")
    assert "other settings" in refused("dataset", plan, "-o", tmp_path / "out", "--seed", 1)
    assert "does not exist" in refused("dataset", plan, "-o", tmp_path / "new", "--rank", 2, "--world", 2)
    for name, value in (("RANK", "first"), ("WORLD_SIZE", "0"), ("WORLD_SIZE", "2x")):
        refused("dataset", plan, "-o", tmp_path / "new", env={**os.environ, name: value})
    text = plan.read_text()
    for old, new, words in (("patch = 64", "patch = 66", "whole cells"), ("patch = 64", "patch = 4000", "holds no patch"),
                            ("*_clean", "*_none", "matches no file"), ("ratios", "ratio", "ratios"),
                            (f'"{MODEL}"', '"nothing"', "nothing"), ("ratios = [4, 20]", "ratios = []", "empty")):
        plan.write_text(text.replace(old, new))
        assert words in refused("dataset", plan, "-o", tmp_path / "new")
    assert not (tmp_path / "new").exists() or not list((tmp_path / "new").glob("*.tar"))


# every kind of model: calibrated, shown, drawn

def write_mono_session(folder, gain=0.5, read=2.0):
    """Bias frames, flats and a burst of a camera with Gaussian read noise; black 100, 12 bit."""
    rng = np.random.default_rng(11)
    groups = []

    def save(kind, number, mean, seconds):
        frame = np.round(100 + gain * rng.poisson(mean / gain) + rng.normal(0, read, mean.shape))
        name = f"{kind}_{number:03}.png"
        Image.fromarray(np.clip(frame, 0, 4095).astype(np.uint16)).save(folder / name)
        groups.append((kind, seconds, name))

    for n in range(12):
        save("bias", n, np.zeros((128, 128)), 0)
    for n in range(16):
        save("flat", n, np.full((128, 128), 150.0 * (n // 2 + 1)), 0.001 * (n // 2 + 1))
    ramp = np.repeat(np.repeat(np.linspace(20, 2600, 64).reshape(8, 8), 16, 0), 16, 1)
    for n in range(20):
        save("burst", n, ramp, 0.004)

    def session(name, *kinds):
        text = '[sensor]\nlayout = "mono"\nblack = 100\nwhite = 4095\nrow_group = 1\n'
        for kind, seconds in sorted({(k, s) for k, s, _ in groups if k in kinds}):
            paths = ", ".join(f'"{p}"' for k, s, p in groups if (k, s) == (kind, seconds))
            text += f'[[frames]]\nkind = "{kind}"\nexposure_s = {seconds}\ngain_db = 0\npaths = [{paths}]\n'
        path = folder / name
        path.write_text(text)
        return path

    return session


DRAWN = {"physics": "physics", "poisson-gaussian": "physics", "gaussian": "gaussian", "nonparametric": "nonparametric",
         "dark-frames": "dark-frames"}


@pytest.mark.parametrize("kind", DRAWN)
def test_every_kind_is_calibrated_shown_and_drawn(malus, tmp_path, kind):
    session = write_mono_session(tmp_path)("s.toml", "bias", "flat", "burst")
    model = tmp_path / "model.h5"
    needed = [DRAWN[kind]] if kind != "dark-frames" else ["physics", "dark-frames"]
    malus("calibrate", session, "--kind", *needed, "--level-samples", 4000, "-o", model)
    assert set(needed) <= set(malus("model", "show", model, "--json").json["kinds"])
    assert DRAWN[kind] in malus("model", "show", model).out
    np.save(tmp_path / "flat.npy", np.full((256, 256), 600, np.float32))
    malus("synthesize", tmp_path / "flat.npy", "-m", model, "--kind", kind, "--gain", 0, "-o", tmp_path / "out")
    dn = np.array(Image.open(tmp_path / "out/flat_000.tif")).astype(float)
    assert dn.mean() == pytest.approx(700, abs=0.6)
    # K s + read² + rounding: 300 + 4 + 1/12; calibrated from 2 x 16384 pixels a level.
    assert dn.var() == pytest.approx(0.5 * 600 + 4 + 1 / 12, rel=0.05)


def test_gaussian_model_from_a_burst_alone(malus, refused, tmp_path):
    session = write_mono_session(tmp_path)
    model = tmp_path / "model.h5"
    malus("calibrate", session("burst.toml", "burst"), "--kind", "gaussian", "--level-samples", 4000, "-o", model)
    (gain,) = malus("model", "show", model, "--json").json["gaussian"]
    assert gain["slope"]["value"][0] == pytest.approx(0.5, rel=0.04)
    assert gain["offset"]["value"][0] == pytest.approx(4 + 1 / 12, abs=5 * gain["offset"]["stderr"][0] + 2)
    refused("calibrate", session("bias.toml", "bias"), "--kind", "gaussian", "-o", tmp_path / "none.h5")


# real frames

def row_spectrum(frames):
    """Power of the rows' temporal offsets in eight bands, low to high; offsets of white noise give equal numbers."""
    rows = frames.mean(axis=2)
    rows = rows - rows.mean(axis=1, keepdims=True)
    rows -= rows.mean(axis=0)
    power = (np.abs(np.fft.rfft(rows, axis=1)) ** 2).mean(axis=0) / rows.shape[1] * len(rows) / (len(rows) - 1)
    return np.array([band.mean() for band in np.array_split(power[1:], 8)])


@pytest.mark.slow
def test_synthesized_dark_frames_have_the_rows_of_real_ones(malus, shared, tmp_path):
    images = shared / "emva001/images"
    dark = sorted(images.glob("d_s_000_*.png"))
    flats = sorted(images.glob("b_[0-9]*.png"))
    text = '[sensor]\nlayout = "mono"\nblack = 0\nwhite = 4095\n'
    for kind, level, paths in [("bias", 0, dark[::2])] + [("flat", i + 1, flats[2 * i:2 * i + 2]) for i in range(len(flats) // 2)]:
        text += f'[[frames]]\nkind = "{kind}"\nlevel = {level}\nexposure_s = {level / 1000}\ngain_db = 0\npaths = ['
        text += ", ".join(f'"{path}"' for path in paths) + "]\n"
    (tmp_path / "s.toml").write_text(text)
    malus("calibrate", tmp_path / "s.toml", "--kind", "physics", "nonparametric", "--level-samples", 50000, "-o", tmp_path / "m.h5")
    real = np.stack([np.array(Image.open(path)).astype(float) for path in dark[1::2]])
    np.save(tmp_path / "dark.npy", np.zeros(real.shape[1:], np.float32))
    spectra = {}
    for name, flags in (("rows", []), ("none", ["--no-row"])):
        malus("synthesize", tmp_path / "dark.npy", "-m", tmp_path / "m.h5", "--kind", "nonparametric", "--gain", 0, "--frames", 25,
              "-o", tmp_path / name, *flags)
        drawn = np.stack([np.array(Image.open(path)).astype(float) for path in sorted((tmp_path / name).iterdir())])
        spectra[name] = row_spectrum(drawn)
    truth = row_spectrum(real)
    print("real", truth.round(3), "drawn", spectra["rows"].round(3), "without row noise", spectra["none"].round(3))
    # 25 frames of 30 frequencies a band: sampling error 3.7 % a band and set. The camera's own rows drift slowly (lowest band),
    # which independent draws do not.
    assert spectra["rows"].mean() == pytest.approx(truth.mean(), rel=0.08)
    assert (np.abs(np.log2(spectra["rows"] / truth)) < 1).all()
    assert spectra["none"].mean() < 0.1 * truth.mean()


# DNG

def write_dng(path, pairs):
    """A little-endian TIFF with nothing but a NoiseProfile."""
    numbers = [value for pair in pairs for value in pair]
    path.write_bytes(struct.pack("<2sHIHHHIII", b"II", 42, 8, 1, 51041, 12, len(numbers), 26, 0) +
                     struct.pack(f"<{len(numbers)}d", *numbers))
    return path


def test_noise_profile_of_a_dng_becomes_a_model(malus, refused, tmp_path):
    pairs = [(4e-4, 2e-6), (3e-4, 1e-6), (5e-4, 3e-6)]  # red, green, blue
    frame = write_dng(tmp_path / "frame.dng", pairs)
    facts = ["--layout", "bayer-grbg", "--black", 64, "--white", 1064, "--iso", 800]
    malus("model", "from-dng", frame, *facts, "-o", tmp_path / "m.h5")
    shown = malus("model", "show", tmp_path / "m.h5", "--json").json
    (gaussian,) = shown["gaussian"]
    assert gaussian["iso"] == 800 and "frame.dng" in shown["origin"]
    planes = [pairs[k] for k in (1, 0, 2, 1)]
    assert np.allclose(gaussian["slope"]["value"], [s * 1000 for s, _ in planes])
    assert np.allclose(gaussian["offset"]["value"], [o * 1e6 for _, o in planes])
    np.save(tmp_path / "flat.npy", np.full((400, 400), 500, np.float32))
    malus("synthesize", tmp_path / "flat.npy", "-m", tmp_path / "m.h5", "--kind", "gaussian", "--iso", 800, "--float",
          "--format", "npy", "-o", tmp_path / "out")
    noise = np.load(tmp_path / "out/flat_000.npy").astype(float) - 500
    for channel, (slope, offset) in enumerate(planes):
        variance = noise[channel // 2::2, channel % 2::2].var()
        assert variance == pytest.approx(slope * 1000 * 500 + offset * 1e6, rel=5 * np.sqrt(2 / 40000))
    assert "that is none" in refused("model", "from-dng", write_dng(tmp_path / "no.dng", []), *facts, "-o", tmp_path / "n.h5")
    refused("model", "from-dng", tmp_path / "flat.npy", *facts, "-o", tmp_path / "n.h5")
    refused("model", "from-dng", frame, *facts, "-o", tmp_path / "m.h5")


def test_noise_profile_of_a_real_phone(malus, shared, tmp_path):
    frame = shared / "bayer-raw/s25u_linear_jxl.dng"
    result = malus("model", "from-dng", frame, "--layout", "bayer-grbg", "--black", 0, "--white", 65535, "--iso", 50,
                   "-o", tmp_path / "m.h5", "--json").json
    content = frame.read_bytes()
    tag = content.index(struct.pack("<HH", 51041, 12))
    count, offset = struct.unpack_from("<II", content, tag + 4)
    numbers = struct.unpack_from(f"<{count}d", content, offset)
    green = numbers[2 if count == 6 else 0]
    assert result["slope_dn"][0] == pytest.approx(green * 65535)
