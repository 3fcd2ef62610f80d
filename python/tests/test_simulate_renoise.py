"""malus.simulate and malus.renoise: arrays in, arrays out, and what the program writes."""

import os
import pathlib
import subprocess
import warnings

import numpy as np
import pytest

malus = pytest.importorskip("malus", reason="the Python module is not built (pybind11 is missing)")

ROOT = pathlib.Path(__file__).resolve().parents[2]
PACKAGE = pathlib.Path(malus.__file__).parent
PROGRAM = pathlib.Path(os.environ.get("MALUS_PROGRAM", PACKAGE.parents[1] / "malus"))
needs_program = pytest.mark.skipif(not PROGRAM.exists(), reason="needs the program")
MODEL = "imx250myr-simulated"
LAYOUT = "polar-bayer-rggb"


def run(*arguments):
    subprocess.run([PROGRAM, *map(str, arguments)], check=True, capture_output=True)


@pytest.fixture(scope="module")
def picture():
    return np.random.default_rng(1).integers(0, 256, (3, 66, 69)).astype(np.uint8)


@needs_program
def test_simulated_scene_is_the_programs(picture, tmp_path):
    np.save(tmp_path / "p.npy", picture)
    run("simulate", tmp_path / "p.npy", "--polarized", "--truth", "--seed", 3, "--first-scene", 5, "--exposure", 0.5, "--gloss", 0.2,
        "--white-balance", 2, 1, 1.5, "--format", "npy", "-o", tmp_path)
    settings = dict(polarized=True, truth=True, seed=3, scene=5, exposure=0.5, gloss=0.2, white_balance=[2, 1, 1.5])
    made = malus.simulate(picture, **settings)
    assert made["dn"].shape == (64, 68)
    assert np.array_equal(made["dn"], np.load(tmp_path / "p_clean.npy"))
    assert made["s0"].shape == made["dolp"].shape == made["normals"].shape == (3, 64, 68)
    # The mosaic is what a sensor sees of the truth, and the truth fits together.
    assert np.allclose(malus.mosaic(made["s0"], made["s1"], made["s2"], LAYOUT), made["dn"])
    dolp = np.hypot(made["s1"], made["s2"]) / np.maximum(made["s0"], 1e-6)
    assert np.allclose(dolp, made["dolp"], atol=1e-3) and 0.01 < made["dolp"].mean() < 0.9
    assert np.allclose(np.linalg.norm(made["normals"], axis=0), 1, atol=1e-5)
    for given in (tmp_path / "p.npy", np.moveaxis(picture, 0, 2)):
        assert np.array_equal(malus.simulate(given, **settings)["dn"], made["dn"])


def test_pixels_of_a_picture_that_are_no_numbers_are_dark(tmp_path):
    picture = np.full((8, 8), 0.5, np.float32)
    picture[2, 3], picture[4, 5] = np.nan, np.inf
    np.save(tmp_path / "odd.npy", picture)
    for given, name in ((picture, "picture"), (tmp_path / "odd.npy", ".*odd.npy")):
        with pytest.warns(UserWarning, match=f"^{name}: 2 pixels are NaN or infinite; taken as dark$"):
            made = malus.simulate(given, "mono")["dn"]
        assert made[2, 3] == made[4, 5] == 0 and made.max() == 2000
    with pytest.raises(malus.InputError, match="^picture: all pixels are NaN or infinite; check how it was made$"):
        malus.simulate(np.full((8, 8), np.nan, np.float32))


@needs_program
def test_floats_that_are_not_from_0_to_1_are_told(picture, tmp_path):
    """They are 255 times as bright as white; the program says so of its files, in the same words."""
    with pytest.warns(UserWarning, match="^picture: more than a tenth .* or lower exposure=") as told:
        malus.simulate(picture.astype(np.float32))
    np.save(tmp_path / "p.npy", picture.astype(np.float32))
    said = subprocess.run([PROGRAM, "simulate", tmp_path / "p.npy", "-o", tmp_path], check=True, capture_output=True, text=True).stderr
    assert said == f"warning: {str(told[0].message).replace('picture: ', f'{tmp_path}/p.npy: ').replace('exposure=', '--exposure')}\n"
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        malus.simulate(picture.astype(np.float32), exposure=1 / 255)
        malus.simulate(picture.astype(np.float32) / 255)


def test_simulate_takes_light_as_it_is_told():
    grey = np.full((8, 8), 0.5, np.float32)
    assert set(malus.simulate(grey)) == {"dn"}
    assert np.allclose(malus.simulate(grey, "mono")["dn"], 2000)
    assert np.allclose(malus.simulate(grey, "mono", full_scale=1000)["dn"], 500)
    assert np.allclose(malus.simulate(grey, "polar-mono")["dn"], 1000)  # a polarizer passes half
    assert np.allclose(malus.simulate(grey, "mono", tone="srgb")["dn"], 4000 * ((0.5 + 0.055) / 1.055) ** 2.4, rtol=1e-4)
    code = np.full((8, 8), 32767, np.uint16)
    assert np.allclose(malus.simulate(code, "mono", tone="linear")["dn"], 2000, rtol=1e-4)
    assert malus.simulate(code, "mono")["dn"].mean() < 900
    for kind, half in (("u1", 127.5), ("i2", 2**14), ("?", 1)):
        light = malus.simulate(np.full((8, 8), half, kind), "mono", tone="linear")["dn"]
        assert np.allclose(light, 4000 if kind == "?" else 2000, rtol=5e-3), kind
    truth = malus.simulate(grey, truth=True)
    assert "normals" not in truth and (truth["s1"] == 0).all()


@pytest.mark.parametrize("given, words", [
    (dict(picture=np.zeros((3, 2, 2))), r"^picture: is smaller than one cell of 4 x 4; use a larger picture$"),
    (dict(tone="gamma"), r"^tone: gamma is not known; choose one of auto, srgb, linear$"),
    (dict(white_balance=[0, 1, 1]), r"^white_balance: 0 is outside its range"),
    (dict(white_balance=[1, 1]), r"^white_balance: has 2 numbers; give three$"),
    (dict(picture=np.zeros((8, 8)), color_matrix=[1, 0, 0]), r"^color_matrix: has 3 numbers; give nine$"),
    (dict(layout="polar-bayer-rgbg"), r"polar-bayer-rgbg"),
    *((dict(picture=np.full((8, 8), 200, kind)), "^picture: holds integers of more than 16 bits, and how large white is among them is not known; "
       "store 8 or 16 bit unsigned integers, or floats of 0 to 1$") for kind in ("i4", "u4", "i8", "u8")),
])
def test_simulate_refuses(given, words):
    with pytest.raises(malus.InputError, match=words):
        malus.simulate(**{"picture": np.zeros((3, 8, 8)), **given})
    with pytest.raises(TypeError, match="did you mean gloss"):
        malus.simulate(np.zeros((8, 8)), glos=1.0)


@pytest.fixture(scope="module")
def quiet():
    model = malus.Model(MODEL)
    light = np.tile(np.linspace(20, 600, 96, dtype=np.float32), (64, 1))
    return np.rint(model.synthesize(light, gain=0, seed=1) + 82).clip(0, 4095).astype(np.uint16)


@needs_program
@pytest.mark.parametrize("rounded", [False, True])
@pytest.mark.parametrize("settings", [{}, {"method": "naive"}])
def test_renoised_frame_is_the_programs(quiet, tmp_path, settings, rounded):
    np.save(tmp_path / "q.npy", quiet)
    run("renoise", tmp_path / "q.npy", "--model", MODEL, "--layout", LAYOUT, "--black", 82, "--white", 4095, "--from", 0, "--to", 18, "--seed", 4,
        "--first-frame", 7, *[f"--{name}={value}" for name, value in settings.items()], *([] if rounded else ["--float"]), "--format", "npy",
        "-o", tmp_path)
    made = malus.renoise(quiet, MODEL, 18, from_gain=0, black=82, white=4095, seed=4, frame=7, rounded=rounded, **settings)
    assert made.dtype == np.float32 and np.array_equal(made, np.load(tmp_path / "q_renoised.npy"))


def test_renoised_frame_has_the_noise_of_its_gain(quiet):
    """Of a frame that knows its gain, with a guide: the added variance is the difference of the two gains'."""
    model = malus.Model(MODEL)
    clean = np.full((256, 256), 300, np.float32)
    frame = malus.Frame(model.synthesize(clean, gain=0, seed=2) + np.float32(82), LAYOUT, 82, 4095, gain_db=0)
    made = malus.renoise(frame, model, 18, guide=clean, seed=5)
    direct = model.synthesize(clean, gain=18, seed=9, parameters="mean")
    spread = lambda mosaic: np.mean([mosaic[r::4, c::4].std() for r in range(4) for c in range(4)])
    assert spread(made) == pytest.approx(spread(direct), rel=0.05)
    assert spread(made) > 2 * spread(frame.dn)


@pytest.mark.parametrize("given, fate, pixels", [
    ({}, "kept as read", [np.nan, np.inf]), (dict(rounded=True), "as integers 0 or white", [0, 4095]),
    (dict(rounded=True, method="naive"), "as integers 0 or white", [0, 4095])])
def test_pixels_that_are_no_numbers_are_said(quiet, given, fate, pixels):
    """In the frame and in a guide, as the program says them (tests/system/test_pixels_without_light.py)."""
    holes = quiet.astype(np.float32)
    holes[10, 11], holes[20, 21] = np.nan, np.inf
    call = lambda raw, **more: malus.renoise(malus.Frame(raw, LAYOUT, 82, 4095, gain_db=0), MODEL, 18, seed=5, **given, **more)
    with pytest.warns(UserWarning, match=f"^array: 2 pixels are NaN or infinite; {fate}$"):
        made = call(holes)
    assert np.array_equal([made[10, 11], made[20, 21]], pixels, equal_nan=True)
    naive = "method" in given
    with pytest.warns(UserWarning, match=f"^guide: 2 pixels are NaN or infinite; {fate if naive else 'no noise is added there'}$"):
        call(quiet, guide=holes)
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        call(holes, guide=quiet)  # of a given guide, new noise alone does not see the frame
    assert len(said) == (not naive)
    nothing = np.full_like(holes, np.nan)
    for raw, more, name in ((nothing, {}, "array"), (quiet, dict(guide=nothing), "guide")):
        with pytest.raises(malus.InputError, match=f"^{name}: all pixels are NaN or infinite; check how it was made$"):
            call(raw, **more)


@pytest.mark.parametrize("given, words", [
    (dict(from_gain=12), r"^array: was taken at 0 dB, from_gain says 12 dB; give the frame's own gain$"),
    (dict(to_gain=99), r"outside the calibrated range"),
    (dict(guide=np.zeros((8, 8))), r"^guide: has 8 x 8 pixels, the frame 64 x 64"),
    (dict(model=None), r"^model: is None"),
    (dict(kind="gaussian"), r"^kind: gaussian is not known; known: physics, nonparametric$"),
    (dict(kind="nonparametric"), r"nonparametric"),
])
def test_renoise_refuses(given, words):
    frame = malus.Frame(np.full((64, 64), 300, np.uint16), LAYOUT, 82, 4095, gain_db=0)
    with pytest.raises(malus.InputError, match=words):
        malus.renoise(**{"raw": frame, "model": MODEL, "to_gain": 12, **given})
    with pytest.raises(malus.InputError, match="^array: does not tell its gain, and the model holds several; give from_gain=$"):
        malus.renoise(np.full((64, 64), 300, np.uint16), MODEL, 12)
    with pytest.raises(malus.InputError, match="choose a target gain with more noise than the source"):
        malus.renoise(malus.Frame(np.full((64, 64), 300, np.uint16), LAYOUT, 82, 4095, gain_db=24), MODEL, 0)
