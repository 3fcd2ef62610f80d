"""Training material as a user makes it: renoise, pairs, simulate, dataset, checked with numpy."""

import io
import json
import os
import signal
import subprocess
import tarfile
import time

import numpy as np
import pytest
from PIL import Image

from conftest import PROGRAM

pytestmark = pytest.mark.slow

MODEL = "imx250myr-simulated"


def truth(malus, gain, model=MODEL):
    return malus("model", "show", model, "--gain", gain, "--json").json["gains"][0]


def smooth_scene(rows=96, cols=128, low=200, high=1500):
    y, x = np.mgrid[:rows, :cols]
    return (low + (high - low) * (0.5 + 0.25 * np.sin(x / 9) + 0.25 * np.cos(y / 7))).astype(np.float32)


def test_float_frames_are_above_black_whatever_black_says(malus, tmp_path):
    np.save(tmp_path / "flat.npy", np.full((32, 32), 300, np.float32))
    for name, black in (("plain", []), ("said", ["--black", 82])):
        malus("synthesize", tmp_path / "flat.npy", "-m", MODEL, "--gain", 6, *black, "-o", tmp_path / name, "--format", "npy")
    assert np.array_equal(np.load(tmp_path / "plain/flat_000.npy"), np.load(tmp_path / "said/flat_000.npy"))


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


def test_pairs_whose_light_does_not_fit_the_ratio_are_said(malus, tmp_path):
    session, _ = write_pairs_session(tmp_path, [1.05, 1.0])
    assert "off the reference" not in malus("pairs", session, "-o", tmp_path / "fits").err
    assert "off the reference over 30" in malus("pairs", session, "-o", tmp_path / "not", "--ratio", 30).err


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
    assert not list(out.glob(".*"))  # what the killed run had begun is gone


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
    np.save(tmp_path / "integers.npy", np.full((128, 128), 500, np.uint16))
    plan.write_text(text.replace("*_clean", "integers"))
    assert "black level is not known" in refused("dataset", plan, "-o", tmp_path / "new")
    assert not (tmp_path / "new").exists() or not list((tmp_path / "new").glob("*.tar"))
