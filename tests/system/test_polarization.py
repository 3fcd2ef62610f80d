"""Stokes, normals, evaluate and denoise on pictures drawn here, judged by numpy and by the shapes that were drawn."""

import numpy as np
import pytest
from PIL import Image

# The cell of polar-mono.
ANGLES = np.array([[90, 45], [135, 0]])
LAYOUT = ["--layout", "polar-mono", "--black", "0", "--white", "4080"]
INDEX = 1.5


def diffuse_dolp(zenith):
    """Degree of polarization of light from inside a dielectric (Atkinson and Hancock, IEEE TIP 15, 2006, Eq. 7)."""
    s2, n = np.sin(zenith) ** 2, INDEX
    return (n - 1 / n) ** 2 * s2 / (2 + 2 * n * n - (n + 1 / n) ** 2 * s2
                                    + 4 * np.cos(zenith) * np.sqrt(n * n - s2))


def ellipsoids(cells, parts):
    """Normals x right, y up, z to the camera, one per cell; NaN outside. parts: (row, column, radius down, across)."""
    rows, cols = np.mgrid[:cells, :cells] + 0.5
    normals = np.full((3, cells, cells), np.nan)
    for row, col, down, across in parts:
        u, v = (cols - col) / across, (row - rows) / down
        inside = u * u + v * v < 0.97
        z = np.sqrt(1 - np.where(inside, u * u + v * v, 0))
        n = np.stack([u / across, v / down, z / min(down, across)])
        n /= np.linalg.norm(n, axis=0)
        normals[:, inside] = n[:, inside]
    return normals


OBJECTS = {
    "sphere": [(96, 96, 85, 85)],
    "ellipsoid": [(96, 96, 50, 88)],
    "four spheres": [(48, 48, 42, 42), (48, 144, 42, 42), (144, 48, 42, 42), (144, 144, 42, 42)],
}


def rendered(normals, brightest=3000):
    """Mosaic of a matt surface lit from the camera, polarized by diffuse reflection; the four pixels of a cell see the
    same point, so that what is measured is the noise and not the sampling."""
    inside = np.isfinite(normals[2]).repeat(2, 0).repeat(2, 1)
    x, y, z = np.where(np.isfinite(normals), normals, 0.5).repeat(2, 1).repeat(2, 2)
    zenith, azimuth = np.arccos(np.clip(z, 0, 1)), np.arctan2(y, x)
    polarizer = np.radians(np.tile(ANGLES, normals.shape[1:]))
    light = brightest * (0.3 + 0.7 * z) * (1 + diffuse_dolp(zenith) * np.cos(2 * (polarizer - azimuth)))
    return np.where(inside, light, 0.004 * brightest).astype(np.float32)


@pytest.mark.slow
@pytest.mark.parametrize("name", OBJECTS)
def test_denoising_brings_normals_back(malus, tmp_path, name):
    """The table of docs/polarization.md (-s prints it): mean angular error of the normals, one per cell."""
    normals = ellipsoids(192, OBJECTS[name])
    np.save(tmp_path / "clean.npy", rendered(normals))
    np.save(tmp_path / "truth.npy", normals.astype(np.float32))
    np.save(tmp_path / "mask.npy", np.isfinite(normals[2]).astype(np.float32))

    def error(path):
        shown = malus("normals", path, *LAYOUT, "-o", tmp_path / "normals", "--mask", tmp_path / "mask.npy",
                      "--reference", tmp_path / "truth.npy", "--index", INDEX, "--force", "--json")
        return shown.json["mean_angular_error_deg"]

    clean = error(tmp_path / "clean.npy")
    assert clean < 0.1
    for ratio in (3, 10, 30):
        model = ["--model", "imx250mzr-simulated", "--gain", "12"]
        malus("synthesize", tmp_path / "clean.npy", *LAYOUT, *model, "--ratio", ratio, "--seed", "4", "--float",
              "-o", tmp_path / "raw", "--force")
        malus("denoise", tmp_path / "raw/clean_000.tif", *model, "-o", tmp_path / "out", "--force")
        noisy, denoised = error(tmp_path / "raw/clean_000.tif"), error(tmp_path / "out/clean_000_denoised.tif")
        print(f"| {name} | 1/{ratio} | {clean:.2f} | {noisy:.1f} | {denoised:.1f} |")
        assert denoised < 0.3 * noisy


def test_normals_say_which_zenith_and_refuse_flags_that_change_nothing(malus, tmp_path):
    """Reflected light has two zeniths for one DoLP, diffuse light has one; with a mask no light tells the object."""
    np.save(tmp_path / "f.npy", np.random.default_rng(3).uniform(200, 4000, (32, 32)).astype(np.float32))
    np.save(tmp_path / "mask.npy", np.ones((16, 16), np.float32))
    command = ["normals", tmp_path / "f.npy", *LAYOUT, "-o", tmp_path / "out", "--force"]
    for flags, words in ((["--model", "specular"], "the one below Brewster"),
                         (["--model", "specular", "--above-brewster"], "the one above Brewster")):
        assert words in malus(*command, *flags).err
    assert "Brewster" not in malus(*command).err
    assert "--above-brewster" in malus(*command, "--above-brewster", code=2).err
    assert "--foreground" in malus(*command, "--mask", tmp_path / "mask.npy", "--foreground", "0.1", code=2).err


def test_normals_are_judged_where_the_reference_has_one(malus, refused, tmp_path):
    """The usual background of a reference, (0, 0, 0), counts no more than NaN does."""
    truth = ellipsoids(64, [(32, 32, 27, 27)]).astype(np.float32)
    frame = tmp_path / "f.npy"
    np.save(frame, np.random.default_rng(3).uniform(200, 4000, (128, 128)).astype(np.float32))
    command = ["normals", "-q", frame, *LAYOUT, "-o", tmp_path / "out", "--force", "--reference", tmp_path / "truth.npy"]
    errors = []
    for background in (np.nan, 0):
        np.save(tmp_path / "truth.npy", np.where(np.isfinite(truth), truth, np.float32(background)))
        errors.append(malus(*command, "--json").json["mean_angular_error_deg"])
    assert errors[0] == errors[1] > 30
    np.save(tmp_path / "truth.npy", np.zeros_like(truth))
    assert "truth.npy: has no normal: every pixel is (0, 0, 0) or not finite" in refused(*command)


def test_a_reference_that_holds_no_normals_is_refused(malus, refused, tmp_path):
    """A picture of normals has three channels too; its error would be that of another thing."""
    truth = ellipsoids(64, [(32, 32, 27, 27)]).astype(np.float32)
    np.save(tmp_path / "f.npy", rendered(truth))
    command = ["normals", "-q", tmp_path / "f.npy", *LAYOUT, "--index", INDEX, "--force", "-o", tmp_path / "out"]
    malus(*command)
    (tmp_path / "out/f_normals.png").rename(tmp_path / "picture.png")
    line = refused(*command, "--reference", tmp_path / "picture.png")
    assert "picture.png: holds integers" in line and "_normals.exr" in line
    np.save(tmp_path / "picture.npy", np.where(np.isfinite(truth), (truth + 1) / 2, 0))
    assert "picture.npy: its vectors are no normals" in refused(*command, "--reference", tmp_path / "picture.npy")
    (tmp_path / "out/f_normals.exr").rename(tmp_path / "truth.exr")
    assert malus(*command, "--reference", tmp_path / "truth.exr", "--json").json["mean_angular_error_deg"] < 0.01


def test_a_mask_is_drawn_in_any_colour_or_in_alpha(malus, refused, tmp_path):
    truth = ellipsoids(64, [(32, 32, 27, 27)]).astype(np.float32)
    np.save(tmp_path / "f.npy", rendered(truth))
    inside = np.isfinite(truth[2])
    drawn = np.where(inside, 255, 0).astype(np.uint8)
    none, whole = np.zeros_like(drawn), np.full_like(drawn, 255)
    masks = {"grey": drawn, "green": [none, drawn, none], "palette": drawn, "alpha": [none, none, none, drawn],
             "opaque": [drawn, drawn, none, whole], "green on nothing": [none, whole, none, drawn]}
    command = ["normals", "-q", tmp_path / "f.npy", *LAYOUT, "--force", "-o", tmp_path / "out", "--mask", tmp_path / "mask.png"]
    for name, planes in masks.items():
        picture = Image.fromarray(np.stack(planes, 2) if isinstance(planes, list) else planes)
        (picture.convert("P") if name == "palette" else picture).save(tmp_path / "mask.png")
        assert malus(*command, "--json").json["object_pixels"] == inside.sum(), name
    Image.fromarray(none).save(tmp_path / "mask.png")
    assert "mask.png: no pixel is above 0" in refused(*command)
    Image.fromarray(np.stack([drawn, drawn, drawn, none], 2)).save(tmp_path / "mask.png")  # transparent
    assert "mask.png: no pixel is above 0 and seen" in refused(*command)
    np.save(tmp_path / "mask.npy", np.stack([drawn, drawn, drawn, none]))  # nobody told what the fourth plane is
    assert malus(*command[:-1], tmp_path / "mask.npy", "--json").json["object_pixels"] == inside.sum()


def test_full_resolution_makes_no_light_up(malus, tmp_path):
    """Where the frame has none, nothing is known; and one pixel out of all range spoils no other."""
    dn = np.full((64, 64), 500, np.float32)
    dn[20:41, 10:33] = np.nan
    dn[50, 50] = 3e38
    np.save(tmp_path / "f.npy", dn)
    malus("stokes", "-q", tmp_path / "f.npy", *LAYOUT, "--full", "--format", "npy", "-o", tmp_path)
    s0 = np.load(tmp_path / "f_s0.npy")
    broken = ~(dn < 1e6)
    assert np.isnan(s0[broken]).all()
    assert s0[~broken] == pytest.approx(1000, rel=1e-4)


def stokes(mosaic):
    i90, i45, i135, i0 = mosaic[::2, ::2], mosaic[::2, 1::2], mosaic[1::2, ::2], mosaic[1::2, 1::2]
    return (i0 + i45 + i90 + i135) / 2, i0 - i90, i45 - i135


def test_evaluate_agrees_with_numpy(malus, tmp_path):
    rng = np.random.default_rng(8)
    reference = rng.uniform(500, 2000, (64, 96)).astype(np.float32)
    test = (reference + rng.normal(0, 60, reference.shape)).astype(np.float32)
    np.save(tmp_path / "reference.npy", reference)
    np.save(tmp_path / "test.npy", test)
    result = malus("evaluate", "--reference", tmp_path / "reference.npy", "--test", tmp_path / "test.npy", *LAYOUT,
                   "--json").json
    result = result.get("results", [result])[0]
    mse = np.mean((test.astype(float) - reference) ** 2)
    assert result["image"]["psnr"] == pytest.approx(10 * np.log10(4080**2 / mse), abs=1e-3)
    (s0, s1, s2), (t0, t1, t2) = stokes(reference.astype(float)), stokes(test.astype(float))
    dolp, shown = np.clip(np.hypot(s1, s2) / s0, 0, 1), np.clip(np.hypot(t1, t2) / t0, 0, 1)
    assert result["dolp"]["psnr"] == pytest.approx(-10 * np.log10(np.mean((dolp - shown) ** 2)), abs=1e-3)
    turn = np.degrees(np.angle(np.exp(1j * (np.arctan2(s2, s1) - np.arctan2(t2, t1))))) / 2
    assert result["aolp"]["circular_deg"] == pytest.approx(np.sqrt(np.sum(dolp * turn**2) / np.sum(dolp)), rel=1e-3)


def test_float_pictures_in_dn_are_not_judged_by_the_peak_of_displayed_ones(malus, tmp_path):
    light = np.random.default_rng(3).uniform(0, 1.2, (3, 32, 48)).astype(np.float32)
    light[0, 0, 0] = 1.25
    for scale, peak in ((1, 1), (3000, 3750)):
        np.save(tmp_path / "r.npy", light * np.float32(scale))
        np.save(tmp_path / "t.npy", light * np.float32(scale * 1.01))
        for flags, expected, said in (([], peak, scale > 1), (["--peak", 4000], 4000, False), (["--white", 4015], 4015, False)):
            run = malus("evaluate", "--reference", tmp_path / "r.npy", "--test", tmp_path / "t.npy", *flags, "--json")
            assert run.json["peak_dn"] == expected and ("r.npy: reaches far beyond 1" in run.err) == said
            mse = np.mean((light.astype(float) * scale * 0.01) ** 2)
            assert run.json["image"]["psnr"] == pytest.approx(10 * np.log10(expected**2 / mse), abs=1e-2)


def test_evaluate_counts_both_greens(malus, tmp_path):
    """000 Table 1: a packed colour mosaic has four DoLP channels. Here one green alone is wrong, so the mean is a quarter of its error."""
    rng = np.random.default_rng(9)
    reference = rng.uniform(500, 2000, (64, 96))
    test = reference.copy()
    rows, cols = np.mgrid[0:64, 0:96]
    green = ((rows // 2 % 2) == 0) & ((cols // 2 % 2) == 1)  # G1 of polar-bayer-rggb
    test[green] += rng.normal(0, 60, green.sum())
    for name, mosaic in (("reference", reference), ("test", test)):
        np.save(tmp_path / f"{name}.npy", mosaic.astype(np.float32))
    result = malus("evaluate", "--reference", tmp_path / "reference.npy", "--test", tmp_path / "test.npy", "--layout", "polar-bayer-rggb",
                   "--white", 4080, "--json").json
    dolp = lambda s: np.clip(np.hypot(s[1], s[2]) / s[0], 0, 1)
    whole = (dolp(stokes(reference)) - dolp(stokes(test))) ** 2  # one value per 2x2 block: every colour's
    assert np.count_nonzero(whole) == whole.size // 4
    assert result["dolp"]["psnr"] == pytest.approx(-10 * np.log10(whole.mean()), abs=1e-3)


@pytest.mark.parametrize("rows, cols", [(1, 1), (2, 2), (3, 3), (3, 40), (40, 2)])
def test_less_than_a_cell_has_no_polarization(malus, refused, tmp_path, rows, cols):
    """Channels without a pixel of their own would be compared with themselves. To denoise it, a piece needs no cell."""
    frame = tmp_path / "f.npy"
    np.save(frame, np.random.default_rng(1).normal(300, 5, (rows, cols)).astype(np.float32))
    facts = ["--layout", "polar-bayer-rggb", "--black", 0, "--white", 4095]
    model = ["--model", "imx250myr-simulated", "--gain", 12]
    for command in (["stokes", frame, "-o", tmp_path / "out"], ["stokes", frame, *model, "-o", tmp_path / "out"],
                    ["stokes", frame, "--full", "-o", tmp_path / "out"], ["normals", "-q", frame, "-o", tmp_path / "out"],
                    ["evaluate", "--reference", frame, "--test", frame],
                    ["denoise", frame, *model, "--reference", frame, "-o", tmp_path / "out"]):
        line = refused(*command, *facts)
        assert f"f.npy: {cols} x {rows} pixels, smaller than one cell of polar-bayer-rggb (4 x 4)" in line
    malus("denoise", frame, *facts, *model, "--format", "npy", "-o", tmp_path / "out")
    denoised = np.load(tmp_path / "out/f_denoised.npy")
    assert denoised.shape == (rows, cols) and np.abs(denoised - 300).max() < 100


def test_full_resolution_stokes_of_a_uniform_scene(malus, tmp_path):
    dolp, aolp = 0.3, 20.0
    mosaic = 1000 * (1 + dolp * np.cos(2 * np.radians(np.tile(ANGLES, (24, 20)) - aolp)))
    np.save(tmp_path / "m.npy", mosaic.astype(np.float32))
    malus("stokes", tmp_path / "m.npy", *LAYOUT, "--full", "-o", tmp_path, "--format", "npy")
    read = {name: np.load(tmp_path / f"m_{name}.npy").squeeze() for name in ("s0", "dolp", "aolp")}
    assert read["s0"].shape == mosaic.shape
    assert np.allclose(read["s0"], 2000, rtol=1e-5)
    assert np.allclose(read["dolp"], dolp, atol=1e-5) and np.allclose(read["aolp"], aolp, atol=1e-3)


def test_dolp_is_corrected_downward_for_noise_and_upward_for_a_filter(malus, tmp_path):
    """A dark textured scene of known DoLP: noise lengthens (S1, S2), the filter shortens it; both corrections help the mean."""
    model, dolp = ["--model", "imx250mzr-simulated", "--gain", "24"], 0.25
    rng = np.random.default_rng(6)
    light = np.kron(rng.uniform(400, 1600, (48, 48)), np.ones((4, 4)))
    aolp = np.radians(np.kron(rng.uniform(0, 180, (24, 24)), np.ones((8, 8))))
    np.save(tmp_path / "c.npy", (light * (1 + dolp * np.cos(2 * (np.radians(np.tile(ANGLES, (96, 96))) - aolp)))).astype(np.float32))
    malus("synthesize", tmp_path / "c.npy", *LAYOUT, *model, "--ratio", "8", "--seed", "2", "--float", "-o", tmp_path / "raw")
    noisy = tmp_path / "raw/c_000.tif"
    malus("denoise", noisy, *model, "-o", tmp_path, "--uncertainty")
    malus("stokes", noisy, *model, "-o", tmp_path, "--format", "npy")
    malus("stokes", tmp_path / "c_000_denoised.tif", "--variance", tmp_path / "c_000_variance.exr", "-o", tmp_path, "--format", "npy")
    mean = {name: np.nanmean(np.load(tmp_path / f"c_000{name}.npy"))
            for name in ("_dolp", "_dolp_corrected", "_denoised_dolp", "_denoised_dolp_corrected")}
    assert dolp < mean["_dolp_corrected"] < mean["_dolp"], mean
    assert mean["_denoised_dolp"] < mean["_denoised_dolp_corrected"] < dolp, mean


def test_a_frame_that_says_it_is_above_black_is_believed(malus, tmp_path):
    """The model's black level is for files that do not know theirs."""
    model = ["--model", "imx250mzr-simulated", "--gain", "12"]
    np.save(tmp_path / "c.npy", np.full((64, 64), 300, np.float32))
    malus("synthesize", tmp_path / "c.npy", *LAYOUT, *model, "--ratio", "1", "--float", "-o", tmp_path / "raw")
    malus("denoise", tmp_path / "raw/c_000.tif", *model, "-o", tmp_path / "out", "--format", "npy")
    assert np.load(tmp_path / "out/c_000_denoised.npy").mean() == pytest.approx(300, abs=10)


def test_black_is_subtracted_once_from_frames_above_it(malus, tmp_path):
    """Whoever states the camera's black level: denoise and stokes believe the file, and say so of the flag."""
    np.save(tmp_path / "c.npy", np.full((64, 64), 300, np.float32))
    session = tmp_path / "session.toml"
    session.write_text('[sensor]\nlayout = "polar-mono"\nblack = 82\nwhite = 4095\n')
    malus("synthesize", tmp_path / "c.npy", *LAYOUT, "--model", "imx250mzr-simulated", "--gain", "12", "--ratio", "1",
          "--float", "-o", tmp_path / "raw")
    frame = tmp_path / "raw/c_000.tif"
    for stated, said in (["--session", session], ""), (["--black", 82], "says that it is above black"):
        found = malus("denoise", frame, *stated, "--model", "imx250mzr-simulated", "--gain", "12", "--format", "npy",
                      "-o", tmp_path / "out", "--force")
        assert said in found.err and found.err.count("--black") == bool(said)
        assert np.load(tmp_path / "out/c_000_denoised.npy").mean() == pytest.approx(300, abs=10)
        found = malus("stokes", frame, *stated, "--format", "npy", "-o", tmp_path / "out", "--force")
        assert said in found.err and found.err.count("--black") == bool(said)
        assert np.load(tmp_path / "out/c_000_s0.npy").mean() == pytest.approx(600, abs=20)


def test_a_sessions_black_level_is_not_that_of_float_pixels(malus, tmp_path):
    """Which is said, since they may hold it; then --black states it."""
    np.save(tmp_path / "c.npy", np.random.default_rng(1).normal(300, 5, (64, 64)).astype(np.float32))
    session = tmp_path / "session.toml"
    session.write_text('[sensor]\nlayout = "polar-mono"\nblack = 82\nwhite = 4095\n')
    model = ["--model", "imx250mzr-simulated", "--gain", "12", "--format", "npy", "-o", tmp_path / "out", "--force"]
    for stated, mean, said in (["--session", session], 300, True), (["--session", session, "--black", 82], 218, False):
        found = malus("denoise", tmp_path / "c.npy", *stated, *model)
        assert ("give --black 82 if they hold the camera's" in found.err) == said
        assert np.load(tmp_path / "out/c_denoised.npy").mean() == pytest.approx(mean, abs=10)


@pytest.mark.parametrize("command", ["stokes", "normals"])
def test_full_resolution_of_too_small_a_frame_names_it(refused, tmp_path, command):
    np.save(tmp_path / "tiny.npy", np.full((3, 12), 300, np.float32))
    line = refused(command, "-q", tmp_path / "tiny.npy", *LAYOUT, "--full", "-o", tmp_path / "out")
    assert "tiny.npy: 12 x 3 pixels are fewer than two 2 x 2 cells each way" in line


@pytest.mark.parametrize("shape", [(1, 1), (1, 97), (97, 1), (3, 5), (66, 70)])
@pytest.mark.parametrize("kind", ["constant", "saturated", "nan"])
def test_denoise_takes_any_picture(malus, tmp_path, shape, kind):
    value = {"constant": 500, "saturated": 4080, "nan": np.nan}[kind]
    np.save(tmp_path / "f.npy", np.full(shape, value, np.float32))
    malus("denoise", tmp_path / "f.npy", *LAYOUT, "--model", "imx250mzr-simulated", "--gain", "12", "-o", tmp_path / "out",
          "--format", "npy", "--uncertainty")
    out = np.load(tmp_path / "out/f_denoised.npy").reshape(shape)
    if kind == "nan":
        assert np.isnan(out).all()
    else:  # the model's bias is below 20 DN, its dark noise below 5
        assert np.abs(out - value).max() < 25
        assert np.ptp(out) < 1
