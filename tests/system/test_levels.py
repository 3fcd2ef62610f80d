"""What black and white mean: by flag, by file, by the model."""

import numpy as np
import pytest
from PIL import Image

LAYOUT = ("--layout", "polar-mono")
CELL_DEG = np.array([[90, 45], [135, 0]])


def mosaic(s0_dn=800.0, dolp=0.5, aolp_deg=30.0, side=32):
    """A uniform scene by Malus's law, in DN above black."""
    angle = np.tile(np.deg2rad(CELL_DEG), (side // 2, side // 2))
    return 0.5 * s0_dn * (1 + dolp * np.cos(2 * (angle - np.deg2rad(aolp_deg))))


def mean_dolp(malus, *arguments):
    return malus("stokes", *arguments, *LAYOUT, "--no-pictures", "--force", "--json").json["mean_dolp"]


def test_black_of_float_files_is_subtracted_when_the_flag_says_so(malus, tmp_path):
    np.save(tmp_path / "above.npy", mosaic().astype(np.float32))
    np.save(tmp_path / "mean.npy", (mosaic() + 200).astype(np.float32))
    out = ("-o", tmp_path / "out")
    assert mean_dolp(malus, tmp_path / "above.npy", *out) == pytest.approx(0.5, abs=1e-4)
    assert mean_dolp(malus, tmp_path / "mean.npy", *out, "--black", 200) == pytest.approx(0.5, abs=1e-4)
    normals = malus("normals", tmp_path / "mean.npy", *out, "--black", 200, *LAYOUT, "--json", "--force")
    assert "not subtracted" not in normals.err


def test_a_float_file_that_says_it_is_above_black_stays_so(malus, tmp_path):
    np.save(tmp_path / "raw.npy", np.round(mosaic() + 80).astype(np.uint16))
    malus("denoise", tmp_path / "raw.npy", "--model", "imx250mzr-simulated", "--gain", 12, "--black", 80,
          "-o", tmp_path)
    result = malus("stokes", tmp_path / "raw_denoised.tif", *LAYOUT, "--black", 80, "-o", tmp_path / "out", "--json")
    assert "--black is not subtracted" in result.err
    assert result.json["mean_dolp"] == pytest.approx(0.5, abs=0.05)


def test_denoise_and_renoise_take_float_files_as_above_black(malus, tmp_path):
    np.save(tmp_path / "above.npy", mosaic().astype(np.float32))
    model = ("--model", "imx250mzr-simulated")
    denoised = malus("denoise", tmp_path / "above.npy", *model, "--gain", 12, "--format", "npy", "-o", tmp_path)
    assert "taken as DN above black" in denoised.err
    bias = np.load(tmp_path / "above_denoised.npy").mean() - mosaic().mean()
    assert abs(bias) < 15  # the model's bias; its black level would be 80
    renoised = malus("renoise", tmp_path / "above.npy", *model, "--from", 6, "--to", 12, "--float", "--method", "naive",
                     "--format", "npy", "-o", tmp_path)
    assert "taken as DN above black" in renoised.err
    assert abs(np.load(tmp_path / "above_renoised.npy").mean() - mosaic().mean()) < 15


def test_stokes_takes_layout_and_black_from_the_model(malus, tmp_path):
    model = malus("model", "show", "imx250mzr-simulated", "--json").json
    black = np.mean(model["black"]["value"])
    np.save(tmp_path / "raw.npy", np.round(mosaic() + black).astype(np.uint16))
    found = malus("stokes", tmp_path / "raw.npy", "--model", "imx250mzr-simulated", "--gain", 12, "--no-pictures",
                  "-o", tmp_path / "out", "--json")
    assert found.json["mean_dolp"] == pytest.approx(0.5, abs=2e-3)
    assert "black level not known" not in found.err


def test_a_gain_outside_the_models_needs_the_flag_that_is_named(malus, refused, tmp_path):
    np.save(tmp_path / "raw.npy", np.round(mosaic() + 80).astype(np.uint16))
    arguments = ("stokes", tmp_path / "raw.npy", "--model", "imx250mzr-simulated", "--gain", 40, "--no-pictures",
                 "-o", tmp_path / "out")
    assert "--extrapolate-gain" in refused(*arguments)
    malus(*arguments, "--extrapolate-gain")


def test_white_is_the_peak_of_pictures_of_several_channels(malus, tmp_path):
    np.save(tmp_path / "raw.npy", mosaic().astype(np.float32))
    for folder, scale in (("a", 1.0), ("b", 1.01)):
        np.save(tmp_path / "raw.npy", (scale * mosaic()).astype(np.float32))
        malus("stokes", tmp_path / "raw.npy", *LAYOUT, "--no-pictures", "--full", "-o", tmp_path / folder)
    np.save(tmp_path / "a.npy", np.full((3, 20, 30), 1000, np.float32))
    np.save(tmp_path / "b.npy", np.full((3, 20, 30), 1010, np.float32))
    found = malus("evaluate", "--reference", tmp_path / "a.npy", "--test", tmp_path / "b.npy", "--white", 4095, "--json")
    assert found.json["image"]["psnr"] == pytest.approx(20 * np.log10(4095 / 10), abs=1e-3)


def test_the_peak_that_only_the_test_knows_is_said(malus, tmp_path):
    """Amplified frames state a white that is as much brighter: by it they would look better than they are."""
    np.save(tmp_path / "clean.npy", mosaic(200, side=64).astype(np.float32))
    base = ("synthesize", tmp_path / "clean.npy", "-m", "imx250mzr-simulated", "--gain", 12, "--ratio", 4)
    for name, flags in (("dim", ()), ("bright", ("--amplify",))):
        malus(*base, *flags, "-o", tmp_path / name)
    compare = ("evaluate", "--reference", tmp_path / "clean.npy", *LAYOUT, "--json", "--test")
    dim = malus(*compare, tmp_path / "dim/clean_000.tif", "--ratio", 4)
    bright = malus(*compare, tmp_path / "bright/clean_000.tif")
    assert bright.json["peak_dn"] > 3.9 * dim.json["peak_dn"] > 10000
    for found in (dim, bright):
        assert f"clean_000.tif: {found.json['peak_dn']:g} DN above black, its own white, is taken as the peak" in found.err
    told = malus(*compare, tmp_path / "bright/clean_000.tif", "--peak", 4013)
    assert told.json["peak_dn"] == 4013 and "peak" not in told.err


def test_alpha_is_no_colour_to_be_compared(malus, tmp_path):
    rng = np.random.default_rng(4)
    for name in ("reference", "test"):
        rgb = rng.integers(0, 256, (32, 32, 3)).astype(np.uint8)
        alpha = np.full((32, 32, 1), 255, np.uint8)
        for kind, planes in (("rgb", [rgb]), ("rgba", [rgb, alpha]), ("grey", [rgb[:, :, :1]]), ("greya", [rgb[:, :, :1], alpha])):
            Image.fromarray(np.concatenate(planes, 2).squeeze()).save(tmp_path / f"{name}_{kind}.png")
        np.save(tmp_path / f"{name}_planes.npy", np.concatenate([rgb, alpha], 2))

    def decibel(reference, test):
        return malus("evaluate", "--reference", tmp_path / f"reference_{reference}", "--test", tmp_path / f"test_{test}", "--json").json["image"]["psnr"]

    plain = decibel("rgb.png", "rgb.png")
    for pair in (("rgba.png", "rgba.png"), ("rgb.png", "rgba.png"), ("rgba.png", "rgb.png")):
        assert decibel(*pair) == plain
    plain = decibel("greya.png", "greya.png")
    assert decibel("grey.png", "greya.png") == decibel("greya.png", "grey.png") == plain
    assert decibel("planes.npy", "planes.npy") > decibel("rgb.png", "rgb.png") + 1  # nobody told what the fourth plane is


def test_pictures_of_two_scales_are_not_compared(malus, refused, tmp_path):
    eight = np.random.default_rng(5).integers(0, 256, (3, 32, 32)).astype(np.uint8)
    for name, picture in (("eight", eight), ("sixteen", eight.astype(np.uint16) * 257), ("float", (eight / 255).astype(np.float32))):
        np.save(tmp_path / f"{name}.npy", picture)
    compare = lambda reference, test: ("evaluate", "--reference", tmp_path / f"{reference}.npy", "--test", tmp_path / f"{test}.npy")
    line = refused(*compare("eight", "sixteen"))
    assert "sixteen.npy: is of 16 bits, its reference" in line and "eight.npy of 8 bits; " in line and "--peak" in line
    assert "is of floating point, its reference" in refused(*compare("eight", "float"))
    Image.fromarray(np.stack([eight[0], np.full((32, 32), 255, np.uint8)], 2), "LA").save(tmp_path / "grey_with_alpha.png")
    np.save(tmp_path / "grey.npy", eight[0].astype(np.uint16) * 257)  # without alpha it might be a mosaic
    line = refused("evaluate", "--reference", tmp_path / "grey.npy", "--test", tmp_path / "grey_with_alpha.png")
    assert "grey_with_alpha.png: is of 8 bits, its reference" in line and "grey.npy of 16 bits; " in line
    for told in (("--peak", 65535), ("--white", 65535)):
        found = malus(*compare("sixteen", "eight"), "--ratio", 257, *told, "--json")
        assert found.json["image"]["psnr"] is None  # equal


def test_stokes_written_as_fits_can_be_compared(malus, tmp_path):
    rgb = np.random.default_rng(1).uniform(100, 900, (48, 48)).astype(np.float32)
    np.save(tmp_path / "raw.npy", rgb)
    for folder in "ab":
        malus("stokes", tmp_path / "raw.npy", "--layout", "polar-bayer-rggb", "--format", "fits", "--no-pictures",
              "-o", tmp_path / folder)
    found = malus("evaluate", "--reference", tmp_path / "a/raw_s0.fits", "--test", tmp_path / "b/raw_s0.fits", "--json")
    assert found.json["image"]["psnr"] is None  # equal


def test_a_model_is_compared_at_the_light_of_the_frames(malus, refused, tmp_path):
    clean = np.full((128, 128), 220, np.float32)
    np.save(tmp_path / "clean.npy", clean)
    model = ("--model", "imx250mzr-simulated", "--gain", 12)
    malus("synthesize", tmp_path / "clean.npy", *model, "--layout", "polar-mono", "--frames", 4, "--format", "npy",
          "-o", tmp_path / "flats")
    flats = sorted((tmp_path / "flats").glob("*.npy"))
    compared = malus("evaluate", "--noise", "--reference", *flats, *model, "--layout", "polar-mono", "--black", 82,
                     "--json").json
    assert np.mean(compared["test"]["mean_dn"]) == pytest.approx(np.mean(compared["reference"]["mean_dn"]), rel=0.02)
    assert compared["pooled"]["sqrt_jsd"] < 2 * compared["pooled"]["sqrt_jsd_floor"]
    malus("average", *flats[:2], "--layout", "polar-mono", "--black", 82, "--white", 4095, "-o", tmp_path / "mean.tif")
    assert "mean of 2 frames" in refused("evaluate", "--noise", "--reference", tmp_path / "mean.tif", *model)
    assert "mean of 2 frames" in refused("evaluate", "--noise", "--reference", *flats[:2], tmp_path / "mean.tif", *model, "--layout", "polar-mono", "--black", 82)


def test_a_session_of_a_sensor_alone_serves_as_description(malus, tmp_path):
    (tmp_path / "s.toml").write_text('[sensor]\nblack = 80\n[sensor.cell]\nrows = [["90", "45"], ["135", "0"]]\n')
    np.save(tmp_path / "raw.npy", np.round(mosaic() + 80).astype(np.uint16))
    found = malus("stokes", tmp_path / "raw.npy", "--session", tmp_path / "s.toml", "--no-pictures",
                  "-o", tmp_path / "out", "--json")
    assert found.json["mean_dolp"] == pytest.approx(0.5, abs=2e-3)


def test_evaluate_says_where_the_black_of_integers_is_not_known(malus, tmp_path):
    np.save(tmp_path / "clean.npy", mosaic().astype(np.float32))
    np.save(tmp_path / "raw.npy", np.round(mosaic() + 80).astype(np.uint16))
    arguments = ("evaluate", "--reference", tmp_path / "clean.npy", "--test", tmp_path / "raw.npy", *LAYOUT, "--white", 4095)
    assert "raw.npy: black level not known, taken as 0" in malus(*arguments).err
    assert "black" not in malus(*arguments, "--black", 80).err


def test_evaluate_says_where_floats_seem_to_hold_the_black_level(malus, tmp_path):
    """They are taken as above black, beside integers that are not."""
    np.save(tmp_path / "raw.npy", np.round(mosaic() + 80).astype(np.uint16))
    np.save(tmp_path / "mean.npy", (mosaic() + 80).astype(np.float32))
    np.save(tmp_path / "dim.npy", (0.5 * mosaic() + 80).astype(np.float32))
    said = "{}.npy: float pixels are taken as DN above black, but they lie 80 DN higher"
    for reference, test in (("raw", "mean"), ("mean", "raw")):
        found = malus("evaluate", "--reference", tmp_path / f"{reference}.npy", "--test", tmp_path / f"{test}.npy",
                      *LAYOUT, "--black", 80, "--white", 4095)
        assert said.format("mean") in found.err, reference
    dim = malus("evaluate", "--reference", tmp_path / "raw.npy", "--test", tmp_path / "dim.npy", *LAYOUT, "--ratio", 2,
                "--black", 80, "--white", 4095)
    assert "dim.npy: float pixels are taken as DN above black" in dim.err


def test_variances_are_told_from_planes(malus, refused, tmp_path):
    np.save(tmp_path / "raw.npy", np.round(mosaic() + 80).astype(np.uint16))
    malus("denoise", tmp_path / "raw.npy", "--model", "imx250mzr-simulated", "--gain", 12, "--black", 80, "--planes",
          "--uncertainty", "-o", tmp_path)
    stokes = ("stokes", tmp_path / "raw_denoised.tif", "-o", tmp_path / "out", "--no-pictures", "--variance")
    assert "raw_planes.exr: is no file of variances" in refused(*stokes, tmp_path / "raw_planes.exr")
    malus(*stokes, tmp_path / "raw_variance.exr")


def test_white_above_black_is_one_number(malus, tmp_path):
    """What is left for every channel, above the highest of unequal black levels."""
    for name in ("r0", "s0"):
        np.save(tmp_path / f"{name}.npy", np.round(mosaic() + 60).astype(np.uint16))
    (tmp_path / "s.toml").write_text('[sensor]\nlayout = "polar-mono"\nblack = [60, 70, 50, 60]\nwhite = 4000\n' + "".join(
        f'[[frames]]\nkind = "{kind}"\nexposure_s = 1\npaths = ["{path}"]\n'
        for kind, path in (("reference", "r0.npy"), ("short", "s0.npy"))))
    malus("pairs", tmp_path / "s.toml", "-o", tmp_path)
    malus("denoise", tmp_path / "s0.npy", "--session", tmp_path / "s.toml", "--model", "imx250mzr-simulated", "--gain", 12,
          "-o", tmp_path)
    for name in ("scene_00_reference.tif", "s0_denoised.tif"):
        assert malus("info", tmp_path / name, "--json").json["white"] == 4000 - 70


def test_calibrate_says_when_black_lies_above_the_dark_level(malus, tmp_path):
    rng = np.random.default_rng(2)
    for i in range(4):
        np.save(tmp_path / f"b{i}.npy", rng.normal(60, 3, (64, 64)).round().astype(np.uint16))
    errors = {}
    for black in (58, 60, 63, 200):
        (tmp_path / "s.toml").write_text(f'[sensor]\nlayout = "mono"\nblack = {black}\nwhite = 4095\n'
                                         '[[frames]]\nkind = "bias"\ngain_db = 0\npaths = ["b*.npy"]\n')
        run = malus("calibrate", tmp_path / "s.toml", "-o", tmp_path / "m.h5", "--force", "--json")
        errors[black] = [line for line in run.err.splitlines() if "below the black level of" in line]
    assert errors[200] and "140 DN below the black level of 200 DN" in errors[200][0]
    assert not errors[58] and not errors[60] and not errors[63]


def test_a_reference_has_its_own_black_level(malus, tmp_path):
    """Where its file tells one, as float or integer, one or one per channel; else the frame's, which is said."""
    light = np.round(mosaic())
    tag = "[malus layout=polar-mono black={} white=4095]"
    blacks = np.tile([[60, 70], [50, 40]], (16, 16))
    Image.fromarray((light + 80).astype(np.uint16)).save(tmp_path / "raw.tif", description=tag.format(80))
    Image.fromarray((light + 40).astype(np.uint16)).save(tmp_path / "own.tif", description=tag.format(40))
    Image.fromarray((light + blacks).astype(np.uint16)).save(tmp_path / "uneven.tif", description=tag.format("60,70,50,40"))
    Image.fromarray((light + 40).astype(np.float32)).save(tmp_path / "float.tif", description=tag.format(40))
    Image.fromarray((light + 80).astype(np.uint16)).save(tmp_path / "silent.tif")
    for name in ("own", "uneven", "float", "silent"):
        done = malus("denoise", tmp_path / "raw.tif", "--model", "imx250mzr-simulated", "--gain", 12, "--reference",
                     tmp_path / f"{name}.tif", "-o", tmp_path / name, "--json")
        assert done.json["against_reference"]["before"]["image_psnr"] is None, name  # equal
        assert ("taken as the frame's" in done.err) == (name == "silent")


def test_a_float_reference_holds_the_black_level_that_is_stated(malus, tmp_path):
    """Where nothing is, it is taken as above black, which is said where it cannot be so."""
    np.save(tmp_path / "raw.npy", np.round(mosaic() + 80).astype(np.uint16))
    np.save(tmp_path / "mean.npy", np.round(mosaic() + 80).astype(np.float32))
    np.save(tmp_path / "above.npy", np.round(mosaic()).astype(np.float32))

    def done(reference, *flags):
        return malus("denoise", tmp_path / "raw.npy", "--model", "imx250mzr-simulated", "--gain", 12, "--black", 80,
                     "--reference", tmp_path / f"{reference}.npy", *flags, "-o", tmp_path / "out", "--json", "--force")

    for flags, reference in ((("--reference-black", 80), "mean"), ((), "above"), (("--reference-black", 0), "above")):
        found = done(reference, *flags)
        assert found.json["against_reference"]["before"]["image_psnr"] is None, flags  # equal
        assert "float pixels" not in found.err, flags
    assert "mean.npy: float pixels are taken as DN above black, but they lie 80 DN higher" in done("mean").err


@pytest.mark.parametrize("black, dtype", [(0, np.float32), (256, np.uint16)])
def test_a_denoised_file_is_saturated_where_it_says(malus, tmp_path, black, dtype):
    """Below the camera's white by the bias that was taken off. A session that describes the camera is no contradiction."""
    dn = mosaic() + black
    dn[4, 4] = dn[10, 20] = dn[11, 21] = own_white = 3799 + black
    Image.fromarray(dn.round().astype(dtype)).save(tmp_path / "d.tif", description=f"[malus layout=polar-mono black={black} white={own_white} holds=denoised]")
    (tmp_path / "s.toml").write_text('[sensor]\nblack = 256\nwhite = 4095\n')
    said = f"says that it is saturated at {own_white} DN; --white is not taken"
    for told, warned in ((), False), (("--white", 4095), True), (("--black", 256, "--white", 4095), True), (("--session", tmp_path / "s.toml"), False), \
                        (("--white", own_white), False):
        for command in ("stokes", "normals"):
            found = malus(command, tmp_path / "d.tif", *told, "-o", tmp_path / "out", "--force", "--json")
            assert found.json["saturated_cells"] == 2 and "2 cells" in found.err, (command, told)
            assert (said in found.err) == warned, (command, told)
    compared = malus("evaluate", "--reference", tmp_path / "d.tif", "--test", tmp_path / "d.tif", "--white", 4095, "--json")
    assert compared.json["peak_dn"] == 4095 - black and "not taken" not in compared.err  # a peak, as all the files' of a table


def test_a_dark_frame_tells_the_black_level(malus, refused, tmp_path):
    random = np.random.default_rng(2)
    offsets = np.tile([[76, 78], [75, 77]], (64, 64))  # of every channel its own, below what a data sheet says
    light = mosaic(s0_dn=60, side=128)
    for name, signal in (("dark", 0), ("more", 0), ("frame", light)):
        dn = np.round(random.normal(signal + offsets, 3))
        np.save(tmp_path / f"{name}.npy", dn.astype(np.uint16))
    frame, dark = tmp_path / "frame.npy", ("--dark", tmp_path / "dark.npy", tmp_path / "more.npy")
    out, levels = ("-o", tmp_path / "out"), (*LAYOUT, "--white", 1023)
    np.save(tmp_path / "clean.npy", light.astype(np.float32))
    clean = ("--reference", tmp_path / "clean.npy", "--force", "--json")
    known = malus("denoise", frame, *dark, *levels, *out, *clean)
    guessed = malus("denoise", frame, "--black", 80, *levels, *out, *clean)
    for done, hint in ((known, False), (guessed, True)):
        assert ("--dark" in done.err) == hint
    score = [done.json["against_reference"]["after"]["image_psnr"] for done in (known, guessed)]
    assert score[0] > score[1] + 10  # 3.5 DN of bias against 0.03
    for command in ("stokes", "normals"):
        malus(command, frame, *dark, *levels, *out, "--force")
    assert mean_dolp(malus, frame, *dark, "--white", 1023, *out) == pytest.approx(0.5, abs=0.02)
    np.save(tmp_path / "floats.npy", np.load(frame).astype(np.float32))  # a mean of one's own holds its black level
    assert mean_dolp(malus, tmp_path / "floats.npy", *dark, "--white", 1023, *out) == pytest.approx(0.5, abs=0.02)
    assert malus("info", frame, *dark, *levels, "--json").json["black"] == pytest.approx([76, 78, 75, 77], abs=0.1)

    assert "is not that of a dark frame" in refused("stokes", frame, "--dark", frame, *LAYOUT, "--white", 255, *out)
    assert "missing.npy" in refused("stokes", frame, "--dark", tmp_path / "missing.npy", *levels, *out)
    for other in (("--black", 80), ("--model", "imx250mzr-simulated")):
        assert "--dark" in malus("denoise", frame, *dark, *other, *levels, *out, code=2).err
    np.save(tmp_path / "cut.npy", np.clip(np.round(random.normal(0, 3, (64, 64))), 0, 255).astype(np.uint16))
    assert "above the black level" in malus("info", frame, "--dark", tmp_path / "cut.npy", *levels).err


def test_dark_frames_are_of_the_frames_gain(malus, refused, tmp_path):
    tag = "[malus layout=polar-mono white=1023 gain_db={}]"
    for name, gain, level in (("dark", 24, 76), ("more", 0, 80), ("frame", 0, 180)):
        Image.fromarray(np.full((16, 16), level, np.uint16)).save(tmp_path / f"{name}.tif", description=tag.format(gain))
    np.save(tmp_path / "untold.npy", np.full((16, 16), 180, np.uint16))
    frame, dark = tmp_path / "frame.tif", ("--dark", tmp_path / "dark.tif")
    line = "was taken at 0 dB, its dark frames at 24 dB"
    assert line in refused("stokes", frame, *dark, "-o", tmp_path / "out")
    assert line in refused("stokes", tmp_path / "untold.npy", *dark, "--gain", 0, *LAYOUT, "-o", tmp_path / "out")
    assert "the dark frames before it" in refused("info", frame, *dark, tmp_path / "more.tif")
    assert malus("info", frame, "--dark", tmp_path / "more.tif", "--json").json["black"] == [80] * 4
    assert malus("info", tmp_path / "untold.npy", *dark, *LAYOUT, "--json").json["black"] == [76] * 4


def test_dark_frames_of_unknown_layout_have_one_level(malus, tmp_path):
    dark = np.tile([[76, 78], [75, 77]], (8, 8)).astype(np.uint16)
    np.save(tmp_path / "dark.npy", dark)
    Image.fromarray(dark + 100).save(tmp_path / "frame.tif", description="[malus layout=polar-mono white=1023]")
    for flags, black, told in (((), [76.5] * 4, True), (LAYOUT, [76, 78, 75, 77], False)):
        found = malus("info", tmp_path / "frame.tif", "--dark", tmp_path / "dark.npy", *flags, "--json")
        assert found.json["black"] == black
        assert ("all channels get one black level" in found.err) == told


def test_a_stated_black_level_serves_where_the_files_own_have_no_place(malus, tmp_path):
    codes = np.random.default_rng(1).normal(300, 8, (96, 96)).round().astype(np.uint16)
    Image.fromarray(codes).save(
        tmp_path / "bayer.tif", description="[malus layout=bayer-rggb black=64,65,66,64 white=4095]")
    for command in (("denoise", "-o", tmp_path / "out"), ("info",)):
        malus(*command, tmp_path / "bayer.tif", "--layout", "mono", "--black", 64)


def test_a_stated_white_holds_the_black_level_of_the_model(malus, tmp_path):
    """As of a session and of the model itself: a frame above black is saturated that much lower."""
    light = mosaic().astype(np.float32)
    light[:8, :8] = 4095 - 82
    np.save(tmp_path / "above.npy", light)
    model = ("--model", "imx250mzr-simulated", "--gain", 12, "--no-pictures", "-o", tmp_path / "out", "--json", "--force")
    for flags in ((), ("--white", 4095)):
        assert malus("stokes", tmp_path / "above.npy", *model, *flags).json["saturated_cells"] == 16, flags


def test_a_reference_of_codes_beside_floats_is_told(malus, tmp_path):
    np.save(tmp_path / "above.npy", mosaic().astype(np.float32))
    np.save(tmp_path / "codes.npy", np.round(mosaic() + 82).astype(np.uint16))
    run = ("denoise", tmp_path / "above.npy", "--model", "imx250mzr-simulated", "--gain", 12, "-o", tmp_path / "out",
           "--force", "--reference", tmp_path / "codes.npy")
    assert "codes.npy: black level not known, taken as the frame's, 0 DN" in malus(*run).err
    assert "codes.npy" not in malus(*run, "--reference-black", 82).err


def test_endings_that_cannot_hold_the_results_are_refused_before_the_work(misused, tmp_path):
    for name in ("clean", "raw"):  # nothing could be made of them: this would be said first
        np.save(tmp_path / f"{name}.npy", np.full((64, 64), np.nan, np.float32))
    model = ["--model", "imx250mzr-simulated", "-o", tmp_path / "out"]
    for command in (["synthesize", tmp_path / "clean.npy", "--gain", 12], ["renoise", tmp_path / "raw.npy", "--from", 6, "--to", 12]):
        assert "--format png: PNG holds no floating-point values" in misused(*command, *model, "--float", "--format", "png")
        assert "--format exr: EXR holds no 8 or 16 bit integers" in misused(*command, *model, "--format", "exr")
    assert not (tmp_path / "out").exists()


def test_noise_that_was_never_rounded_is_counted_as_the_codes_beside_it(malus, tmp_path):
    """Twelve bits in the upper bits of sixteen: a step is 16 DN, and bins of 1 DN are a comb over it."""
    rng = np.random.default_rng(5)
    light = rng.normal(60, 0.4, (3, 96, 96))
    np.save(tmp_path / "codes.npy", (16 * np.round(light[0])).astype(np.uint16))
    np.save(tmp_path / "floats.npy", (16 * light[1]).astype(np.float32))
    np.save(tmp_path / "wide.npy", (16 * (60 + 5 * (light[2] - 60))).astype(np.float32))
    compare = ["evaluate", "--noise", "--layout", "mono", "--black", 0, "--reference", tmp_path / "codes.npy", "--json", "--test"]
    compared = malus(*compare, tmp_path / "floats.npy")
    assert compared.json["rounded_to_steps_dn"] == {"reference": 0, "test": 16}
    assert compared.json["pooled"]["sqrt_jsd"] < 0.05
    told, = compared.err.splitlines()
    assert "warning: the tests' frames are not in steps of 16 DN" in told and "a noise of 6.5 DN" in told
    wide = malus(*compare, tmp_path / "wide.npy")
    assert "not in steps of 16 DN" in wide.err and "warning" not in wide.err
