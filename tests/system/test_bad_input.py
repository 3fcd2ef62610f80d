"""Bad input gives one line that names the file, what is wrong and what to do; exit code 1; nothing half-written."""

import os
import shutil
import subprocess
import tempfile
import zlib

import numpy as np
import pytest
from PIL import Image

from conftest import PROGRAM

LAYOUT = ["--layout", "polar-mono", "--black", "0", "--white", "255"]


@pytest.fixture
def frame(tmp_path):
    rng = np.random.default_rng(1)
    path = tmp_path / "frame.png"
    Image.fromarray(rng.integers(20, 200, (64, 64), dtype=np.uint8)).save(path)
    return path


def write(path, content):
    path.write_bytes(content) if isinstance(content, bytes) else path.write_text(content)
    return path


def test_missing_file(refused, tmp_path):
    line = refused("info", tmp_path / "no.png")
    assert "no.png" in line


@pytest.mark.parametrize("ending", ["png", "tif", "exr", "fits", "npy", "dng", "h5"])
def test_empty_and_nonsense_files(refused, tmp_path, ending):
    empty = write(tmp_path / f"empty.{ending}", b"")
    nonsense = write(tmp_path / f"nonsense.{ending}", b"this is no picture at all" * 10)
    command = ["model", "show"] if ending == "h5" else ["info"]
    for path in (empty, nonsense):
        assert path.name in refused(*command, path)


@pytest.mark.parametrize("ending", ["png", "tif"])
def test_truncated_files(refused, tmp_path, ending):
    whole = tmp_path / f"whole.{ending}"
    Image.fromarray(np.random.default_rng(2).integers(0, 255, (64, 64), dtype=np.uint8)).save(whole)
    cut = write(tmp_path / f"cut.{ending}", whole.read_bytes()[: whole.stat().st_size * 2 // 3])
    assert "cut" in refused("denoise", cut, *LAYOUT, "-o", tmp_path / "out")
    assert not list((tmp_path / "out").glob("*")) if (tmp_path / "out").exists() else True


def test_truncated_npy_and_headerless(refused, tmp_path):
    np.save(tmp_path / "a.npy", np.zeros((32, 32), np.uint16))
    cut = write(tmp_path / "cut.npy", (tmp_path / "a.npy").read_bytes()[:-10])
    assert "cut.npy" in refused("info", cut)
    raw = write(tmp_path / "frame.raw", b"\0" * 1000)
    assert "frame.raw" in refused("info", raw, "--raw-format", "mono12p", "--size", "64x64")


def test_a_png_of_no_size_gives_one_line(malus, frame):
    """The decoder's library has a line of its own for it."""
    content = bytearray(frame.read_bytes())
    content[16:20] = bytes(4)
    content[29:33] = zlib.crc32(content[12:29]).to_bytes(4, "big")
    done = malus("info", write(frame.with_name("zero.png"), bytes(content)), code=1)
    assert done.err.count("\n") == 1 and "zero.png: the PNG file declares 0x64 pixels; " in done.err


def test_a_name_of_two_lines_does_not_break_a_warning(malus, tmp_path):
    np.save(tmp_path / "two\nlines.npy", np.full((64, 64), 230, np.uint16))
    done = malus("info", tmp_path / "two\nlines.npy")
    assert done.err.startswith("warning: ") and "two lines.npy: " in done.err and done.err.count("\n") == 1


def test_a_folder_is_no_frame(refused, tmp_path):
    assert str(tmp_path.name) in refused("info", tmp_path)


@pytest.mark.parametrize("command", [["stokes"], ["denoise", "--model", "imx250mzr-simulated"], ["simulate"], ["report"]])
def test_names_that_no_system_takes(refused, tmp_path, command):
    error = refused(*command, tmp_path / f"{'a' * 300}.npy", "-o", tmp_path / "out")
    assert error.startswith(f"malus: {tmp_path}")
    # simulate names its result, which is checked first.
    assert ("its name is too long" if command == ["simulate"] else "File name too long; check the name") in error


def test_black_above_white(misused, frame, tmp_path):
    line = misused("denoise", frame, "--layout", "polar-mono", "--black", "300", "--white", "255", "-o", tmp_path / "out")
    assert "--black" in line and "--white" in line


def test_negative_black(malus, refused, tmp_path):
    """Refused where the codes have no sign, by session and by flag; dark may lie below 0 where they have one."""
    for name, kind in (("plain", np.uint16), ("signed", np.int16), ("float", np.float32)):
        for i in range(3):
            np.save(tmp_path / f"{name}{i}.npy", np.random.default_rng(i).normal(50, 3, (32, 32)).astype(kind))
        session = write(tmp_path / f"{name}.toml", '[sensor]\nlayout = "mono"\nblack = -100\nwhite = 4095\n[[frames]]\n'
                        f'kind = "bias"\ngain_db = 0\npaths = ["{name}*.npy"]\n')
        if name == "plain":
            line = refused("calibrate", session, "-o", tmp_path / "m.h5")
            assert "plain0.npy: black -100 DN" in line
            assert "black -100 DN" in refused("info", tmp_path / "plain0.npy", "--black=-100")
        else:
            malus("calibrate", session, "-o", tmp_path / "m.h5", "--force")


def test_unknown_key_in_a_session_names_the_nearest(refused, tmp_path):
    session = write(tmp_path / "s.toml", '[sensor]\nlayuot = "mono"\n[[frames]]\nkind = "bias"\npaths = ["*.png"]\n')
    line = refused("calibrate", session, "-o", tmp_path / "m.h5")
    assert "layuot" in line and "layout" in line
    assert not (tmp_path / "m.h5").exists()


def test_frames_of_another_size_than_the_session(refused, tmp_path):
    for i in range(3):
        Image.fromarray(np.full((32, 32 + 8 * (i == 2)), 10 + i, np.uint8)).save(tmp_path / f"b{i}.png")
    session = write(tmp_path / "s.toml", '[sensor]\nlayout = "mono"\n[[frames]]\nkind = "bias"\npaths = ["b*.png"]\n')
    assert "b2.png" in refused("calibrate", session, "-o", tmp_path / "m.h5")


def test_calibrate_refuses_pixels_that_are_no_numbers(refused, tmp_path):
    for i in range(3):
        pixels = np.random.default_rng(i).normal(10, 1, (32, 32)).astype(np.float32)
        pixels[3, 4] = [1, np.nan, np.inf][i]
        np.save(tmp_path / f"b{i}.npy", pixels)
    session = write(tmp_path / "s.toml", '[sensor]\nlayout = "mono"\nwhite = 255\n[[frames]]\nkind = "bias"\npaths = ["b*.npy"]\n')
    assert "b1.npy" in refused("calibrate", session, "-o", tmp_path / "m.h5")


def test_denoise_says_when_texture_taken_for_noise_moved_the_mean(malus, tmp_path):
    rng = np.random.default_rng(4)
    row, col = np.mgrid[:256, :256]
    # Finer than the channels are apart, so that nothing tells it from noise.
    shaded, grained = 200 + row + col, 50 + 3000 * (rng.random(row.shape) < 0.1)
    for name, clean in (("shaded", shaded), ("grained", grained)):
        noisy = 64 + 1.5 * rng.poisson(clean / 1.5) + 3.5 * rng.standard_normal(clean.shape)
        frame = tmp_path / f"{name}.npy"
        np.save(frame, np.rint(noisy).clip(0, 4095).astype(np.uint16))
        done = malus("denoise", frame, "--layout", "polar-mono", "--black", "64", "--white", "4095", "-o", tmp_path)
        assert ("moved the mean of channel" in done.err) == (name == "grained"), done.err


def test_denoise_keeps_and_reports_pixels_that_are_no_numbers(malus, tmp_path):
    pixels = np.random.default_rng(3).normal(100, 5, (256, 256)).astype(np.float32)
    pixels[10, 11], pixels[20, 21] = np.nan, np.inf
    np.save(tmp_path / "f.npy", pixels)
    result = malus("denoise", tmp_path / "f.npy", *LAYOUT, "-o", tmp_path / "out", "--format", "npy")
    assert "2 pixels are NaN, infinite, or beyond 100 times white; they stay as they are" in result.err
    out = np.load(tmp_path / "out" / "f_denoised.npy")
    assert np.isnan(out[10, 11]) and np.isinf(out[20, 21])
    assert np.isfinite(out).sum() == out.size - 2
    pixels[10, 11] = pixels[20, 21] = -3.4e38  # "no data" of many files
    np.save(tmp_path / "f.npy", pixels)
    told = malus("denoise", tmp_path / "f.npy", *LAYOUT, "-o", tmp_path / "filled", "--format", "npy").err
    assert "2 pixels are NaN, infinite, or beyond 100 times white; they stay as they are" in told
    filled = np.load(tmp_path / "filled" / "f_denoised.npy")
    assert filled[10, 11] == filled[20, 21] == np.float32(-3.4e38)
    np.testing.assert_array_equal(filled[out < 1e9], out[np.isfinite(out)])


def test_a_frame_of_nothing_else_is_reported_and_kept(malus, tmp_path):
    np.save(tmp_path / "f.npy", np.full((64, 64), np.nan, np.float32))
    result = malus("denoise", tmp_path / "f.npy", *LAYOUT, "--model", "imx250mzr-simulated", "--gain", 12,
                   "--format", "npy", "-o", tmp_path / "out")
    warnings = [line for line in result.err.splitlines() if line.startswith("warning:")]
    assert len(warnings) == 1 and "4096 pixels are NaN, infinite, or beyond 100 times white; they stay" in warnings[0]
    assert np.isnan(np.load(tmp_path / "out/f_denoised.npy")).all()


def test_gain_outside_the_calibrated_range_needs_a_flag(malus, refused, frame, tmp_path):
    for command in ("denoise", "stokes"):
        arguments = [command, frame, *LAYOUT, "--model", "imx250mzr-simulated", "-o", tmp_path / "out", "--gain", "36"]
        assert "36" in refused(*arguments)
        result = malus(*arguments, "--extrapolate-gain")
        assert "imx250mzr-simulated: extrapolated to 36 dB from the calibrated range 0 dB to 30 dB" in result.err


def test_existing_outputs_need_force(malus, refused, frame, tmp_path):
    arguments = ["stokes", frame, *LAYOUT, "-o", tmp_path / "out"]
    malus(*arguments)
    before = {path: path.stat().st_mtime_ns for path in (tmp_path / "out").iterdir()}
    assert "--force" in refused(*arguments)
    assert before == {path: path.stat().st_mtime_ns for path in (tmp_path / "out").iterdir()}
    malus(*arguments, "--force")


@pytest.mark.parametrize("command", [
    ["stokes"], ["denoise", "--layout", "bayer-rggb", "--model", "imx250mzr-simulated", "--gain", "90"], ["normals"],
    ["synthesize", "--layout", "bayer-rggb", "-m", "imx250mzr-simulated", "--gain", "12"],
    ["renoise", "--layout", "bayer-rggb", "-m", "imx250mzr-simulated", "--from", "6", "--to", "90"]])
def test_refused_runs_leave_no_folder(refused, tmp_path, command):
    np.save(tmp_path / "f.npy", np.full((16, 16), 300, np.uint16))
    refused(command[0], tmp_path / "f.npy", *command[1:], "-o", tmp_path / "new/out")
    assert not (tmp_path / "new").exists()
    (tmp_path / "mine").mkdir()
    refused(command[0], tmp_path / "f.npy", *command[1:], "-o", tmp_path / "mine")
    assert (tmp_path / "mine").exists()


def test_output_folder_that_is_a_file(refused, frame, tmp_path):
    blocked = write(tmp_path / "blocked", "a file")
    assert "blocked" in refused("stokes", frame, *LAYOUT, "-o", blocked)


def test_a_model_without_rights_tells_the_cause(tmp_path):
    """Also where root runs the tests, who may read everything."""
    folder = tempfile.mkdtemp(dir="/tmp")
    try:
        os.chmod(folder, 0o755)
        shutil.copy(write(tmp_path / "model.h5", b"any"), f"{folder}/model.h5")
        os.chmod(f"{folder}/model.h5", 0)
        done = subprocess.run([PROGRAM, "model", "show", f"{folder}/model.h5"], capture_output=True, text=True, env={**os.environ, "LC_ALL": "C"},
                              **({"user": 65534} if os.geteuid() == 0 else {}))
    finally:
        shutil.rmtree(folder)
    assert (done.returncode, done.stderr) == (1, f"malus: {folder}/model.h5: cannot be opened: Permission denied; check its permissions\n")


def test_output_folder_without_rights(refused, frame, tmp_path):
    if os.geteuid() == 0:
        pytest.skip("root may write everywhere")
    folder = tmp_path / "locked"
    folder.mkdir(mode=0o500)
    assert "locked" in refused("stokes", frame, *LAYOUT, "-o", folder)


def test_full_disk_leaves_nothing(refused, small_disk, tmp_path):
    Image.fromarray(np.random.default_rng(1).integers(0, 255, (512, 512), dtype=np.uint8)).save(tmp_path / "f.png")
    assert "full" in refused("denoise", tmp_path / "f.png", *LAYOUT, "-o", small_disk)
    assert not list(small_disk.iterdir())


def test_noise_is_not_compared_with_itself(malus, refused, tmp_path):
    rng = np.random.default_rng(7)
    for name in "ab":
        np.save(tmp_path / f"{name}.npy", rng.normal(100, 5, (64, 64)).astype(np.float32))
    (tmp_path / "link.npy").symlink_to("a.npy")
    shutil.copy(tmp_path / "a.npy", tmp_path / "copy.npy")
    a, b, link, copy = (tmp_path / f"{name}.npy" for name in ("a", "b", "link", "copy"))
    for same in (a, link):
        line = refused("evaluate", "--noise", "--reference", a, "--test", b, same)
        assert same.name in line and "--reference" in line and "--test" in line
    assert "b.npy" in refused("evaluate", "--noise", "--reference", a, "--test", b, b)
    assert "a.npy" in refused("evaluate", "--noise", "--reference", a, "--test", b, "--clean", a)
    told = malus("evaluate", "--noise", "--reference", a, "--test", copy)
    assert "copy.npy" in told.err and "copies of" in told.err
    assert "copies" not in malus("evaluate", "--noise", "--reference", a, "--test", b).err


def test_noise_of_several_gains_is_not_taken_for_that_of_one(malus, refused, tmp_path):
    """A model drew all frames at the first one's gain: the frames of 6 dB were 0.32 away from themselves (root JSD) with some of 24."""
    np.save(tmp_path / "flat.npy", np.full((64, 64), 300, np.float32))
    camera = ["--model", "imx250myr-simulated"]
    taken = {}
    for gain in (6, 24):
        malus("synthesize", tmp_path / "flat.npy", *camera, "--gain", gain, "--frames", 4, "-o", tmp_path / f"g{gain}")
        taken[gain] = sorted((tmp_path / f"g{gain}").glob("*.tif"))
    mixed = [*taken[6][:2], taken[24][0]]
    line = refused("evaluate", "--noise", "--reference", *mixed, *camera)
    assert "g24" in line and "was taken at 24 dB" in line and "g6" in line and "at 6 dB" in line
    for alike in ([*taken[6], *camera], [*mixed, *camera, "--gain", 6], [*taken[6], "--test", *taken[24]]):  # --gain wins over the file
        assert "was taken at" not in malus("evaluate", "--noise", "--reference", *alike).err
    told = malus("evaluate", "--noise", "--reference", *taken[6][2:], "--test", *mixed).err
    assert "was taken at 24 dB" in told and "of one gain" in told


def test_a_data_set_has_no_pairs_of_nan(refused, tmp_path):
    scene = np.full((64, 64), 300, np.float32)
    scene[5, 7:9] = np.nan
    np.save(tmp_path / "scene.npy", scene)
    (tmp_path / "plan.toml").write_text('model = "imx250mzr-simulated"\nclean = ["scene.npy"]\n[dataset]\nsamples = 2\npatch = 32\n'
                                        "ratios = [4]\n")
    line = refused("dataset", tmp_path / "plan.toml", "-o", tmp_path / "out")
    assert "scene.npy: 2 pixels are NaN or infinite" in line
    assert not list((tmp_path / "out").glob("shard-*.tar"))


def test_synthesized_frames_begin_with_a_whole_cell(malus, refused, tmp_path):
    """They name the model's layout, which is another at any other place."""
    np.save(tmp_path / "flat.npy", np.full((16, 16), 300, np.float32))
    run = ["synthesize", tmp_path / "flat.npy", "-m", "imx250mzr-simulated", "--gain", "24", "-o", tmp_path / "out"]
    for origin in ("1,0", "0,3"):
        line = refused(*run, "--origin", origin)
        assert "flat.npy: row" in line and "is not a multiple of" in line and "--origin" in line
    assert not (tmp_path / "out").exists()
    malus(run[0], "--origin", "4,2", *run[1:])  # what follows it is no part of it


def test_pictures_of_several_channels_have_no_black_level(malus, tmp_path):
    Image.fromarray(np.zeros((16, 16, 3), np.uint8)).save(tmp_path / "p.png")
    found = malus("evaluate", "--reference", tmp_path / "p.png", "--test", tmp_path / "p.png", "--black", 4, code=2)
    assert "p.png is a picture of several channels" in found.err


def test_seeds_are_decimal_digits(malus, frame, tmp_path):
    assert "--seed" in malus("train", frame, "--seed", "", code=2).err
    np.save(tmp_path / "flat.npy", np.full((16, 16), 300, np.float32))
    drawn = {}
    for seed in ("8", "10", "18446744073709551615"):
        malus("synthesize", tmp_path / "flat.npy", "-m", "imx250mzr-simulated", "--gain", "24", "--seed", seed, "-o", tmp_path / seed)
        drawn[seed] = (tmp_path / seed / "flat_000.tif").read_bytes()
    assert len(set(drawn.values())) == 3


def test_names_with_control_characters_stay_on_one_line(refused, tmp_path):
    refused("info", tmp_path / "two\nlines.png")


def test_a_frame_is_never_replaced_by_the_result_of_another(refused, tmp_path):
    rng = np.random.default_rng(3)
    for name in ("a.png", "a_s0.png"):
        Image.fromarray(rng.integers(20, 200, (64, 64), dtype=np.uint8)).save(tmp_path / name)
    before = (tmp_path / "a_s0.png").read_bytes()
    frames = [tmp_path / "a.png", tmp_path / "a_s0.png"]
    assert "a_s0.png" in refused("stokes", *frames, *LAYOUT, "-o", tmp_path, "--force")
    assert (tmp_path / "a_s0.png").read_bytes() == before


def test_calibrate_replaces_nothing_that_it_reads(malus, refused, tmp_path):
    rng = np.random.default_rng(2)
    for i in range(4):
        np.save(tmp_path / f"b{i}.npy", rng.normal(100, 3, (64, 64)).round().astype(np.uint16))
    session = write(tmp_path / "session.toml", '[sensor]\nlayout = "mono"\nblack = 100\nwhite = 4095\n'
                    '[[frames]]\nkind = "bias"\ngain_db = 0\npaths = ["b*.npy"]\n')
    before = {path: path.read_bytes() for path in tmp_path.iterdir()}
    model, frame = tmp_path / "m.h5", tmp_path / "b2.npy"
    arguments = ["calibrate", session, "--kind", "dark-frames", "--force"]
    for output, report in ((session, None), (frame, None), (model, session), (model, frame), (model, model),
                           (model, tmp_path / "." / "m.h5")):
        line = refused(*arguments, "-o", output, *(["--report", report] if report else []))
        assert ("--report" if report else "-o") in line and "replace" in line
        assert before == {path: path.read_bytes() for path in tmp_path.iterdir()}
    malus(*arguments, "-o", model, "--report", tmp_path / "m.html")
    malus(*arguments, "-o", model, "--report", "/dev/null")
    assert "dark frames of 0 dB only" in refused("model", "show", model, "--gain", 8)


def test_reports_of_experiments_and_trainings_replace_nothing_that_is_read(refused, tmp_path):
    (tmp_path / "scene").mkdir()
    for angle in (0, 45, 90, 135):
        Image.fromarray(np.full((64, 64, 3), 90 + angle // 9, np.uint8)).save(tmp_path / f"scene/I{angle}.png")
    for name in ("photo.png", "short.png", "long.png", "weights.safetensors"):
        Image.fromarray(np.full((64, 64, 3), 90, np.uint8)).save(tmp_path / name, format="png")
    write(tmp_path / "pairs.json", '{"pairs": [{"name": "a_00", "short": "short.png", "reference": "long.png", "ratio": 10, "iso": 100, '
                                   '"gain_db": null}]}')
    config = write(tmp_path / "config.toml", '[network]\narchitecture = "unet"\n[package]\nlayout = "bayer-rggb"\n[data]\n'
                                             'pictures = ["pho*.png"]\npairs = ["pairs.json"]\n[noise]\nmodels = ["sony-a7s2"]\n')
    rows = write(tmp_path / "rows.toml", '[[rows]]\nname = "a"\nconfig = "config.toml"\n')
    empty = write(tmp_path / "empty.toml", '[[rows]]\nname = "a"\nmethod = "bm3d"\n')
    before = {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}
    behind = ["config.toml", "photo.png", "pairs.json", "short.png", "long.png"]
    out = ["-o", tmp_path / "out"]
    runs = [(["denoise", tmp_path / "scene", "--methods", "bm3d/fast", tmp_path / "weights.safetensors"],
             ["scene/I45.png", "weights.safetensors"]),
            (["denoise", tmp_path / "photo.png", "--model", "sony-a7s2"], ["photo.png", "scene/../photo.png"]),
            (["table1", rows, "--scenes", tmp_path / "scene", *out], ["rows.toml", "scene/I0.png", *behind]),
            (["denoise", "--test-pairs", tmp_path / "pairs.json", "--model", "sony-a7s2"], ["pairs.json", "short.png", "long.png"]),
            (["table2", empty, "--model", "sony-a7s2", "--pairs", tmp_path / "pairs.json", "--test-pairs", tmp_path / "pairs.json", *out],
             ["empty.toml", "pairs.json", "short.png", "long.png"]),
            (["denoise-demosaic", rows, "--pictures", tmp_path / "scene/I90.png", *out], ["rows.toml", "scene/I90.png", *behind]),
            (["table-s1", rows, "--pairs", tmp_path / "pairs.json", "--test-pairs", tmp_path / "pairs.json", *out],
             ["rows.toml", *behind])]
    for arguments, reports in runs:
        for report in reports:
            line = refused("experiment", *arguments, "--report", tmp_path / report, "--force")
            assert "--report" in line and "is an input and would be replaced" in line
    for report in behind:
        assert "is an input" in refused("train", config, *out, "--report", tmp_path / report, "--force")
    assert "another result" in refused("train", config, *out, "--report", tmp_path / "out/best.safetensors", "--force")
    (tmp_path / "old.html").write_text("old")
    assert "--force" in refused("train", config, *out, "--report", tmp_path / "old.html")
    (tmp_path / "old.html").unlink()
    assert before == {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}


def test_results_replace_nothing_that_is_read(refused, frame, tmp_path):
    """Not with --force either: a truth, mask, guide or variance named as a result would be."""
    (tmp_path / "sub").mkdir()
    rng = np.random.default_rng(4)
    for name in ("frame_denoised.npy", "frame_renoised.npy"):
        np.save(tmp_path / name, rng.uniform(20, 200, (64, 64)).astype(np.float32))
    for name, ending in (("frame_normals", "png"), ("frame_s0", "png")):
        Image.fromarray(np.full((32, 32), 255, np.uint8)).save(tmp_path / f"{name}.{ending}")
    before = {path: path.read_bytes() for path in tmp_path.iterdir() if path.is_file()}
    out = ["-o", tmp_path / "sub" / "..", "--force"]
    model = ["--model", "imx250mzr-simulated"]
    for arguments, read in (
            (["denoise", frame, *LAYOUT, "--format", "npy", "--reference"], "frame_denoised.npy"),
            (["denoise", frame, *LAYOUT[:2], "--format", "npy", "--dark"], "frame_denoised.npy"),
            (["denoise", frame, *LAYOUT[:2], "--dark", tmp_path / "frame_renoised.npy", "--report"], "frame_renoised.npy"),
            (["normals", frame, *LAYOUT, "--reference"], "frame_normals.png"),
            (["normals", frame, *LAYOUT, "--mask"], "frame_normals.png"),
            (["stokes", frame, *LAYOUT, "--variance"], "frame_s0.png"),
            (["renoise", frame, *LAYOUT, *model, "--from", 6, "--to", 12, "--format", "npy", "--guide"], "frame_renoised.npy")):
        line = refused(*arguments, tmp_path / read, *out)
        assert read in line and "is an input and would be replaced" in line
    assert before == {path: path.read_bytes() for path in tmp_path.iterdir() if path.is_file()}
