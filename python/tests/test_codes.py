"""Integers are a camera's codes in Python too: their black level is taken off, or asked for; and drawn noise becomes codes by one rounding."""

import pathlib
import re
import warnings

import numpy as np
import pytest

malus = pytest.importorskip("malus", reason="the Python module is not built (pybind11 is missing)")

ROOT = pathlib.Path(__file__).resolve().parents[2]
MODEL, LAYOUT = "imx250mzr-simulated", "polar-mono"


@pytest.fixture(scope="module")
def light():
    """Of DoLP 0.5, in DN above black."""
    r, c = np.mgrid[:64, :64]
    return (300 * (1 + 0.5 * np.cos(np.radians(2 * np.array([[90, 45], [135, 0]])[r % 2, c % 2])))).astype(np.float32)


@pytest.fixture(scope="module")
def codes(model, light):
    return model.synthesize(light, gain=0, seed=1, rounded=True).astype(np.uint16)


def test_stokes_takes_the_black_level_of_the_model_from_integers(model, black, codes):
    frame = malus.Frame(codes, LAYOUT, black=black, white=model.as_dict()["white"]["value"])
    of_frame = malus.stokes(frame, model=model, gain=0)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        of_array = malus.stokes(codes, LAYOUT, model=model, gain=0)
        of_told = malus.stokes(codes, model=model, gain=0, black=black)
        of_floats = malus.stokes(codes.astype(np.float32), LAYOUT, model=model, gain=0, black=black)
    for name, plane in of_frame.items():
        for other in (of_array, of_told, of_floats):
            assert np.array_equal(plane, other[name], equal_nan=True), name
    assert of_array["dolp"].mean() == pytest.approx(0.5, abs=0.01)


@pytest.mark.parametrize("work", [malus.stokes, malus.normals])
def test_integers_of_unknown_black_are_told(work, codes, black):
    def seen(dn, **told):
        result = work(dn, LAYOUT, **told)
        return result["dolp"] if work is malus.stokes else result

    with pytest.warns(UserWarning, match="^array: black level not known, taken as 0; DoLP is too low if it is not [(]black=[)]"):
        raised = seen(codes)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert np.array_equal(seen(codes, black=0), raised, equal_nan=True)
        above = seen(codes.astype(np.float32) - np.float32(black[0]))
        for dn in (codes, codes.astype(np.float32), malus.Frame(codes, LAYOUT, black=0, white=4095)):
            assert np.array_equal(seen(dn, black=black[0]), above, equal_nan=True)


def test_the_layout_check_takes_integers_above_black(codes, black):
    with pytest.warns(UserWarning, match="black level not known"):
        raised = malus.check_layout(codes)
    told = malus.check_layout(codes, black=black[0])
    assert told == malus.check_layout(codes.astype(np.float32) - np.float32(black[0]))
    assert told["winner"] == raised["winner"] == "diagonal" and told["column"] > raised["column"]


def test_integers_are_synthesized_above_the_black_that_is_told(model, light):
    whole = np.round(light)
    levels = [80, 81, 82, 83]
    raised = (whole + np.tile(np.reshape(levels, (2, 2)), (32, 32))).astype(np.uint16)
    draw = lambda clean, **told: model.synthesize(clean, gain=12, seed=1, **told)
    for work in (draw, lambda clean, **told: model.at_gain(12).synthesize(clean, seed=1, **told)):
        with pytest.raises(malus.InputError, match="^clean: holds integers, but their black level is not known; give black="):
            work(raised)
        assert np.array_equal(work(raised, black=levels), work(whole))
        assert np.array_equal(work(malus.pack(raised, LAYOUT).astype(np.uint16), black=levels), work(malus.pack(whole, LAYOUT)))
        assert np.array_equal(work(whole.astype(np.int64), black=0), work(whole))
    assert np.array_equal(draw(raised[1:, 1:], row0=1, col0=1, black=levels), draw(whole)[1:, 1:])
    with pytest.warns(UserWarning, match="clean: float pixels are DN above black; black= is not subtracted"):
        assert np.array_equal(draw(whole, black=82), draw(whole))


def test_noise_is_rounded_once(model, black):
    """Uniform noise of a step and rounding on top of it would have 1/6 of a squared step in place of 1/12: 0.4 DN of read noise, whose
    variance is known to 1 % of 256 x 256 pixels; five of them."""
    dark = np.zeros((256, 256), np.float32)
    drawn = dict(gain=0, seed=3, row=False, parameters="mean", kind="physics")
    codes = model.synthesize(dark, **drawn, rounded=True)
    assert codes.dtype == np.float32 and np.array_equal(codes, np.round(codes))
    smooth = model.synthesize(dark, **drawn, quantization=False)
    assert np.array_equal(codes, np.maximum(np.round(smooth + np.tile(np.reshape(black, (2, 2)), (128, 128)).astype(np.float32)), 0))
    twice = np.round(model.synthesize(dark, **drawn))
    assert twice.var() - codes.var() == pytest.approx(1 / 12, abs=0.02)


def test_codes_are_the_same_packed_and_in_place(model, light):
    draw = lambda clean, **more: model.synthesize(clean, gain=12, seed=5, frame=2, rounded=True, **more)
    whole = draw(light)
    packed = malus.pack(light, LAYOUT)
    assert np.array_equal(malus.unpack(draw(packed), LAYOUT), whole)
    assert np.array_equal(malus.unpack(draw(packed[None])[0], LAYOUT), whole)
    assert np.array_equal(draw(light[8:, 12:], row0=8, col0=12), whole[8:, 12:])
    out = light.copy()
    assert draw(out, out=out) is out and np.array_equal(out, whole)
    assert draw(np.full((8, 8), 1e5, np.float32)).max() == model.as_dict()["white"]["value"]
    with pytest.raises(malus.InputError, match="^packed array: 3 planes for the 4 channels"):
        draw(packed[:3])
    for moved in ({"amplify": True, "ratio": 2}, {"debias": True}):
        with pytest.raises(malus.InputError, match="^rounded: an array cannot tell the black level"):
            draw(light, **moved)


def test_the_black_of_a_dark_frame_as_the_documentation_has_it(model, black):
    text = (ROOT / "docs/noise-estimate.md").read_text()
    recipe = re.search(r"in Python `black=(malus\.info\(dark, layout=\.\.\.\).*?)`", text)[1]
    dark = model.synthesize(np.zeros((64, 64), np.float32), gain=0, seed=1, rounded=True).astype(np.uint16)
    levels = eval(recipe.replace("layout=...", "layout=LAYOUT"), {"malus": malus, "dark": dark, "LAYOUT": LAYOUT})
    assert malus.Frame(dark, LAYOUT, black=levels).black_dn == pytest.approx(black, abs=3)


def test_a_path_in_place_of_pixels_is_told():
    for call in (lambda: malus.denoise("frame.png"), lambda: malus.stokes(pathlib.Path("frame.png"), LAYOUT)):
        with pytest.raises(TypeError, match="frame.png.*is a path|is .*frame.png.*, a path or a name; load it with malus.load_frame"):
            call()


def test_too_few_frames_are_told():
    with pytest.raises(malus.InputError, match="^average: .*2"):
        malus.average([])


def test_baselines_refuse_what_they_do_not_look_at(model, codes):
    for name in ("row_noise", "column_noise", "like_pixels"):
        with pytest.raises(malus.InputError, match=f"^{name}: plane-bm3d is a baseline and does not look at it; leave it out"):
            malus.denoise(codes, model=model, gain=0, method="plane-bm3d", **{name: False})


def test_a_denoised_frame_is_told_where_no_model_refuses_it(model, light, tmp_path):
    frame = malus.Frame(model.synthesize(np.tile(light, (3, 3)), gain=24, seed=1), LAYOUT, black=0, white=4000)
    import subprocess, os
    program = pathlib.Path(os.environ.get("MALUS_PROGRAM", pathlib.Path(malus.__file__).parents[2] / "malus"))
    if not program.exists():
        pytest.skip("needs the program beside the module")
    np.save(tmp_path / "raw.npy", frame.dn)
    run = [program, "denoise", "--layout", LAYOUT, "--white", "4000", "--profile", "fast", "-q", "--force", "-o"]
    subprocess.run([*run, tmp_path / "once", tmp_path / "raw.npy"], check=True, capture_output=True)
    done = tmp_path / "once/raw_denoised.tif"
    again = subprocess.run([*run, tmp_path / "twice", done], capture_output=True, text=True)
    assert "raw_denoised.tif: says that it is denoised" in again.stderr or "no noise" in again.stderr
    with pytest.warns(UserWarning, match="raw_denoised.tif: says that it is denoised"):
        try:
            malus.denoise(malus.load_frame(done), profile="fast")
        except malus.InputError:
            pytest.skip("nothing is left to be estimated")
