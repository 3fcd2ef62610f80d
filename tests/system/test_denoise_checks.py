"""What denoise says of frames that do not fit their model, and what it leaves beside its results."""

import json
import re
import resource

import h5py
import numpy as np
import pytest
from PIL import Image

MODEL, LAYOUT, BLACK, WHITE = "imx250myr-simulated", "polar-bayer-rggb", 82, 4095


@pytest.fixture(scope="module")
def frames(tmp_path_factory, malus):
    """Noisy frames of a scene with soft and sharp detail, drawn at 0, 12 and 24 dB."""
    folder = tmp_path_factory.mktemp("frames")
    r, c = np.mgrid[:256, :256]
    scene = 200 + 120 * np.sin(0.05 * r) * np.cos(0.07 * c) + 60 * ((r // 40 + c // 48) % 2)
    np.save(folder / "scene.npy", scene.astype(np.float32))
    for gain in (0, 12, 24):
        malus("synthesize", folder / "scene.npy", "--model", MODEL, "--layout", LAYOUT, "--gain", gain, "-o", folder / f"{gain}")
    return folder


def frame(frames, gain):
    return next((frames / f"{gain}").glob("*.tif"))


def denoise(malus, path, folder, *flags, model=MODEL):
    return malus("denoise", path, "--model", model, "-o", folder, "--profile", "fast", "--json", "--force", *flags)


@pytest.mark.parametrize("true", (0, 12, 24))
@pytest.mark.parametrize("told", (0, 12, 24))
def test_the_noise_of_another_gain_is_told(malus, frames, tmp_path, true, told):
    done = denoise(malus, frame(frames, true), tmp_path, "--gain", told)
    noise = json.loads(next(tmp_path.glob("*_denoised.json")).read_text())["run"]["frame_noise"]
    ratio = noise["frame_sd_dn"] / noise["model_sd_dn"]
    if true == told:
        assert "warning" not in done.err and noise["complaint"] == "" and 0.85 < ratio < 1.3
    else:
        assert done.err.count("its noise is") == 1 and "--gain" in done.err and noise["complaint"] in done.err
    assert (ratio < 0.7) == (true < told) and (ratio > 1.5) == (true > told)


def test_a_black_level_of_another_camera_is_told(malus, frames, tmp_path):
    codes = np.array(Image.open(frame(frames, 12)))
    Image.fromarray(np.maximum(codes.astype(int) - 300, 0).astype(np.uint16)).save(tmp_path / "dark.tif")
    done = denoise(malus, tmp_path / "dark.tif", tmp_path / "out", "--gain", 12, "--black", 82, "--white", WHITE)
    assert "below the model's dark level" in done.err


def test_a_frame_of_zeros_lies_below_the_dark_level(malus, tmp_path):
    """It shows no noise that could be compared with the model's, and 100 DN are 40 of its deviations."""
    np.save(tmp_path / "zeros.npy", np.zeros((256, 256), np.uint16))
    np.save(tmp_path / "black.npy", np.full((256, 256), 100, np.uint16))
    for name in ("zeros", "black"):
        done = denoise(malus, tmp_path / f"{name}.npy", tmp_path, "--gain", 12, "--layout", LAYOUT, "--black", 100, "--white", WHITE)
        told = "zeros.npy: 100 % of its pixels lie below the model's dark level by more than 6 deviations"
        assert (told in done.err) == (name == "zeros"), done.err
    noise = json.loads((tmp_path / "zeros_denoised.json").read_text())["run"]["frame_noise"]
    assert noise["below_dark_share"] == 1 and noise["frame_sd_dn"] is None and "dark level" in noise["complaint"]


def test_largely_saturated_frames_are_told(malus, tmp_path):
    """A hundredth of the frame and more: lamps and their reflections are no news."""
    rng = np.random.default_rng(2)
    for name, rows, told in (("lamp", 2, None), ("window", 16, "4096 pixels, 6.2 % of the frame, are saturated"),
                             ("all", 256, "65536 pixels, 100 % of the frame, are saturated")):
        pixels = np.rint(rng.normal(300, 5, (256, 256))).astype(np.uint16)
        pixels[:rows] = WHITE
        np.save(tmp_path / f"{name}.npy", pixels)
        done = denoise(malus, tmp_path / f"{name}.npy", tmp_path, "--gain", 12, "--layout", LAYOUT, "--black", BLACK, "--white", WHITE)
        assert (told in done.err) if told else ("saturated" not in done.err), done.err


def test_frames_that_were_finished_before_an_error_are_said(malus, frames, tmp_path):
    """As is their JSON, in the form of several frames; nothing is where none was."""
    good = [tmp_path / "a.tif", tmp_path / "b.tif"]
    for path in good:
        path.write_bytes(frame(frames, 12).read_bytes())
    bad = tmp_path / "bad.npy"
    np.save(bad, np.zeros((64, 64), np.uint16))
    bad.write_bytes(bad.read_bytes()[:-10])  # its header is whole
    command = ["--model", MODEL, "--layout", LAYOUT, "--gain", 12, "--black", BLACK, "--white", WHITE, "--profile", "fast"]
    text = malus("denoise", *good, bad, *command, "-o", tmp_path / "text", code=1)
    assert [line.split(":")[0] for line in text.out.splitlines()] == [str(path) for path in good] and "bad.npy" in text.err
    told = malus("denoise", *good, bad, *command, "-o", tmp_path / "json", "--json", code=1)
    assert [run["input"] for run in told.json["frames"]] == [str(path) for path in good] and "bad.npy" in told.err
    one = malus("denoise", good[0], bad, *command, "-o", tmp_path / "one", "--json", code=1)
    assert [run["input"] for run in one.json["frames"]] == [str(good[0])]
    assert malus("denoise", bad, good[0], *command, "-o", tmp_path / "none", "--json", code=1).out == ""


@pytest.mark.parametrize("method", ("nl-ridge", "bm3d"))
def test_a_ratio_that_nothing_would_look_at_is_refused(misused, frames, tmp_path, method):
    line = misused("denoise", frame(frames, 12), "--model", MODEL, "--gain", 12, "--method", method, "--ratio", 10, "-o", tmp_path / "out")
    assert f"--ratio: {method} does not amplify by it; leave it out" in line
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("method", ("nl-ridge", "bm3d", "vst-bm3d"))
@pytest.mark.parametrize("flag,value", (("--device", "cuda"), ("--device", "cpu"), ("--precision", "float32"), ("--tile-batch", 4)))
def test_settings_of_networks_are_refused_by_other_methods(misused, frames, tmp_path, method, flag, value):
    line = misused("denoise", frame(frames, 12), "--model", MODEL, "--gain", 12, "--method", method, flag, value, "-o", tmp_path / "out")
    assert f"{flag}: {method} is no network and does not look at it; leave it out" in line
    assert not (tmp_path / "out").exists()


def test_a_bias_of_clipped_dark_frames_is_told(malus, tmp_path):
    rng = np.random.default_rng(5)
    text = '[sensor]\nlayout = "polar-mono"\nblack = 0\nwhite = 4095\nrow_group = 1\n'
    for level in range(7):
        for n in range(4 if level else 20):
            dn = rng.poisson(400.0 * level, (64, 64)) + rng.normal(-3, 3, (64, 64))
            Image.fromarray(np.clip(np.round(dn), 0, 4095).astype(np.uint16)).save(tmp_path / f"{level}_{n}.png")
        kind = "flat" if level else "bias"
        text += f'[[frames]]\nkind = "{kind}"\nexposure_s = {level / 100 + 1e-4}\ngain_db = 0\npaths = ["{level}_*.png"]\n'
    (tmp_path / "s.toml").write_text(text)
    malus("calibrate", tmp_path / "s.toml", "-o", tmp_path / "m.h5")
    with h5py.File(tmp_path / "m.h5") as model:
        assert model["physics/000/dark_zero_share"][0] == pytest.approx(0.878, abs=0.02)  # more than a law tells
    done = denoise(malus, tmp_path / "3_0.png", tmp_path / "out", "--gain", 0, model=tmp_path / "m.h5")
    told = r"8[78] % of the dark pixels it was calibrated from were 0: its bias, 0\.2"
    assert len(re.findall(told, done.err)) == 1
    seen = malus("stokes", tmp_path / "3_0.png", "--gain", 0, "--model", tmp_path / "m.h5", "-o", tmp_path / "stokes")
    assert len(re.findall(told, seen.err)) == 1


def test_a_gain_that_the_model_lacks_is_told_with_its_name(refused, frames, tmp_path):
    raw = frame(frames, 12)
    for command in (["denoise", raw, "--gain", 99], ["stokes", raw, "--gain", 99], ["renoise", raw, "--from", 99, "--to", 99],
                    ["synthesize", raw, "--gain", 99]):
        assert "imx250myr-simulated: " in refused(*command, "--model", "imx250myr-simulated", "--layout", "polar-bayer-rggb", "-o",
                                                  tmp_path / "none"), command
    assert not (tmp_path / "none").exists()


def test_what_an_earlier_run_left_beside_a_result_goes(malus, frames, tmp_path):
    out, raw = tmp_path / "out", frame(frames, 12)
    denoise(malus, raw, out, "--gain", 12, "--uncertainty", "--planes", "--u16")
    kept = {out / (raw.stem + "_denoised" + end) for end in (".tif", ".json")}
    assert len(list(out.iterdir())) == 5
    (out / "note.txt").write_text("mine")
    denoise(malus, raw, out, "--gain", 12, "--strength", "0.7")
    assert set(out.iterdir()) == kept | {out / "note.txt"}


def test_a_file_that_is_read_is_not_taken_for_an_earlier_result(malus, frames, tmp_path):
    raw = frame(frames, 12)
    denoise(malus, raw, tmp_path, "--gain", 12, "--format", "exr")
    reference = tmp_path / (raw.stem + "_planes.exr")  # as --planes would name its own
    (tmp_path / (raw.stem + "_denoised.exr")).rename(reference)
    denoise(malus, raw, tmp_path, "--gain", 12, "--reference", reference)
    assert reference.exists()


def test_a_record_beside_its_frame_names_it(malus, frames, tmp_path):
    here = tmp_path / "shot"
    here.mkdir()
    (here / "a.tif").write_bytes(frame(frames, 12).read_bytes())
    (tmp_path / "link").symlink_to(here)
    for start, out in ((here, "../out"), (tmp_path / "link", "../out"), (tmp_path, "shot/../out")):
        raw = "a.tif" if start != tmp_path else "link/../shot/a.tif"
        malus("denoise", raw, "--model", MODEL, "--gain", 12, "-o", out, "--profile", "fast", "--force", cwd=start)
        done = tmp_path / "out" / "a_denoised.json"
        assert json.loads(done.read_text())["input_file"] == "../shot/a.tif"
        malus("report", done, "-o", tmp_path / "r.html", "--force")


def test_a_guess_of_white_is_told(malus, frames, tmp_path):
    codes = np.array(Image.open(frame(frames, 12)))
    Image.fromarray(codes).save(tmp_path / "a.tif")
    given = (tmp_path / "a.tif", "--layout", LAYOUT, "--black", BLACK, "--force", "-o", tmp_path / "out")
    for command in ("denoise", "stokes"):
        assert "white level not known, taken as 65453 DN above black" in malus(command, *given).err
        assert "white level" not in malus(command, *given, "--white", WHITE).err


def test_what_many_frames_share_is_told_once(malus, frames, tmp_path):
    names = [tmp_path / f"{name}.tif" for name in "abcd"]
    for name in names:
        name.write_bytes(frame(frames, 12).read_bytes())
    lines = malus("stokes", *names, "--layout", "polar-bayer-bggr", "-o", tmp_path / "out").err.splitlines()
    told = [line for line in lines if "its layout is" in line]
    assert len(told) == 2 and told[0].startswith(f"warning: {names[0]}: ") and told[1].startswith("warning: also of 3 more files: ")
    assert told[0].removeprefix(f"warning: {names[0]}: ") == told[1].removeprefix("warning: also of 3 more files: ")


def test_a_gain_that_is_not_calibrated_names_the_model(refused, frames, tmp_path):
    line = refused("denoise", frame(frames, 12), "--model", MODEL, "--gain", 90, "-o", tmp_path / "out")
    assert line.startswith(f"malus: {MODEL}: ") and ".tif: 90 dB: " in line


def test_a_file_larger_than_allowed_is_reported(refused, frames, tmp_path):
    def limit():
        resource.setrlimit(resource.RLIMIT_FSIZE, (20480, 20480))

    line = refused("denoise", frame(frames, 12), "--model", MODEL, "--gain", 12, "--profile", "fast", "-o", tmp_path / "out",
                   preexec_fn=limit)
    assert "File too large" in line
    assert not (tmp_path / "out").exists()


def test_a_cut_off_tiff_names_no_impossible_line(refused, frames, tmp_path):
    whole = frame(frames, 12).read_bytes()
    (tmp_path / "cut.tif").write_bytes(whole[: len(whole) // 2])
    assert "4294967295" not in refused("info", tmp_path / "cut.tif")


@pytest.mark.parametrize("light", (40, 400))
def test_lines_of_text_are_not_taken_for_row_noise(malus, tmp_path, light):
    """Marks in lines of changing height, a Bayer camera without row noise and no model: the result is nearer the truth than the frame."""
    rng = np.random.default_rng(4)
    page, top = np.full((512, 512), float(light)), 3
    while top < 500:
        marks = np.repeat(rng.random(171) < 0.35, 3)[:512]
        page[top:top + 8][:, marks] = 0.15 * light
        top += int(rng.integers(11, 17))
    codes = np.rint(0.4 * rng.poisson(page / 0.4) + rng.normal(100, 1.2, page.shape))
    np.save(tmp_path / "page.npy", codes.astype(np.uint16))
    done = malus("denoise", tmp_path / "page.npy", "--layout", "bayer-rggb", "--black", 100, "--white", 4095, "-o", tmp_path, "--profile", "fast")
    assert "row noise 0.00 DN removed" in done.out
    denoised = np.array(Image.open(tmp_path / "page_denoised.tif"))
    assert np.square(denoised - page).mean() < 0.7 * np.square(codes - 100 - page).mean()


def test_integers_that_cannot_hold_the_frame_are_refused(malus, refused, tmp_path):
    """On a scale of 0 to 1 all of them would be 0; above 16 bits the light ends at 65535."""
    even = np.random.default_rng(6).normal(0.4, 0.01, (256, 256)).astype(np.float32)
    for name, scale, white, said in (("unit", 1, 1, "rounding"), ("large", 800000, 800000, "65535"), ("camera", 4095, 4095, "")):
        np.save(tmp_path / f"{name}.npy", even * scale)
        command = ["denoise", tmp_path / f"{name}.npy", "--layout", "mono", "--black", 0, "--white", white, "--profile", "fast",
                   "--u16", "-o", tmp_path / name]
        if said:
            line = refused(*command)
            assert name in line and said in line and "--u16" in line and not list((tmp_path / name).glob("*"))
        else:
            malus(*command)
            assert np.array(Image.open(tmp_path / "camera/camera_denoised_u16.tif")).mean() == pytest.approx(0.4 * 4095, rel=0.01)


def test_integers_of_what_is_no_number_are_0_or_white_and_told(malus, tmp_path):
    dn = np.random.default_rng(9).normal(400, 10, (256, 256)).astype(np.float32)
    dn[10, 20], dn[30, 40], dn[50, 60] = np.nan, np.inf, -np.inf
    np.save(tmp_path / "holes.npy", dn)
    done = malus("denoise", tmp_path / "holes.npy", "--layout", "mono", "--black", 80, "--white", 4095, "--profile", "fast", "--u16",
                 "-o", tmp_path)
    assert "--u16 writes pixels that hold no light as integers 0 or white" in done.err
    codes = np.array(Image.open(tmp_path / "holes_denoised_u16.tif"))
    assert (codes[10, 20], codes[30, 40], codes[50, 60]) == (0, 4095, 0)


def test_a_white_that_leaves_no_range_is_refused(refused, misused, tmp_path):
    """The tables of the noise reach up to it."""
    dark = np.random.default_rng(7).normal(-5, 1, (256, 256)).clip(None, -0.1).astype(np.float32)
    np.save(tmp_path / "dark.npy", dark)
    assert "white is not known" in refused("denoise", tmp_path / "dark.npy", "-o", tmp_path / "out")
    np.save(tmp_path / "light.npy", dark + 500)
    line = misused("denoise", tmp_path / "light.npy", "--layout", "polar-mono", "--model", "imx250mzr-simulated", "--gain", 12,
                   "--white", "1e300", "-o", tmp_path / "out")
    assert "--white: 1e+300 DN is beyond all that cameras count" in line


@pytest.mark.parametrize("kind, white", ((np.float32, 700), (np.uint8, 255)))
def test_what_is_known_as_saturated_stays_so_in_the_result(malus, tmp_path, kind, white):
    """Nobody tells white: the camera's pixels pile up at it, its estimates lie about it."""
    r, c = np.mgrid[:256, :256]
    light = white * np.where(np.hypot(r - 128, c - 100) < 40, 1.1, 0.5 + 0.1 * np.sin(c / 40))
    noisy = np.random.default_rng(5).normal(light, np.sqrt(light))
    np.save(tmp_path / "lamp.npy", np.clip(noisy if kind == np.float32 else np.rint(noisy), 0, white).astype(kind))
    done = malus("denoise", tmp_path / "lamp.npy", "--layout", "mono", "--black", 2, "-o", tmp_path, "--profile", "fast", "--json")
    assert done.json["saturated_pixels"] > 4000
    result = malus("info", tmp_path / "lamp_denoised.tif", "--json").json
    assert result["white_known"] and result["white"] == white - 2
    assert result["saturated_share"]["value"][0] * 256**2 == pytest.approx(done.json["saturated_pixels"], rel=0.02)
