"""Black and white as the program takes them: from the caller, else the file, else the model."""

import os
import pathlib
import pickle
import subprocess
import warnings

import numpy as np
import pytest
from PIL import Image

malus = pytest.importorskip("malus", reason="the Python module is not built (pybind11 is missing)")

ROOT = pathlib.Path(__file__).resolve().parents[2]
MODEL = "imx250mzr-simulated"
LAYOUT = "polar-mono"
CELL = [(0, 0), (0, 1), (1, 0), (1, 1)]


@pytest.fixture
def raw(model, black, tmp_path):
    """A flat of 300 DN as the camera writes it: uint16 TIFF without any tag."""
    clean = np.full((96, 128), 300, np.float32)
    codes = np.round(model.synthesize(clean, gain=12, seed=1, parameters="mean", quantization=False) + black[0])
    Image.fromarray(codes.astype(np.uint16)).save(tmp_path / "raw.tif")
    return tmp_path / "raw.tif"


def offsets(dn, values):
    """A mosaic with a number on every position of the cell."""
    for (r, c), value in zip(CELL, values):
        dn[r::2, c::2] += value
    return dn


def test_files_without_a_black_level_get_the_model_s(model, raw, tmp_path):
    dn = malus.denoise(malus.load_frame(raw, layout=LAYOUT), model=model, gain=12)["dn"]
    assert dn.mean() == pytest.approx(300, abs=1)
    program = pathlib.Path(os.environ.get("MALUS_PROGRAM", pathlib.Path(malus.__file__).parents[2] / "malus"))
    if not program.exists():
        pytest.skip("needs the program beside the module")
    subprocess.run([program, "denoise", raw, "--model", MODEL, "--gain", "12", "--layout", LAYOUT, "--format", "npy",
                    "-o", tmp_path / "out"], check=True, capture_output=True)
    assert np.array_equal(np.load(tmp_path / "out/raw_denoised.npy").squeeze(), dn)
    # The file tells no layout either: the model's, as in the program.
    assert np.array_equal(malus.denoise(malus.load_frame(raw), model=model, gain=12)["dn"], dn)


def test_what_is_given_wins(model, raw, black):
    frame = malus.load_frame(raw, layout=LAYOUT, black=black[0] - 10)
    assert malus.denoise(frame, model=model, gain=12)["dn"].mean() == pytest.approx(310, abs=1)
    assert malus.denoise(frame, model=model, gain=12, black=black[0] - 20)["dn"].mean() == pytest.approx(320, abs=1)


def test_integers_are_codes_and_floats_are_light(model, raw, black):
    codes = np.array(Image.open(raw))
    given = dict(layout=LAYOUT, white=4095, model=model, gain=12)
    assert malus.denoise(codes, **given)["dn"].mean() == pytest.approx(300, abs=1)
    light = codes.astype(np.float32) - np.float32(black[0])
    with pytest.warns(UserWarning, match=f"float pixels are taken as DN above black, give black={black[0]:g}"):
        assert malus.denoise(light, **given)["dn"].mean() == pytest.approx(300, abs=1)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert malus.denoise(light, black=0, **given)["dn"].mean() == pytest.approx(300, abs=1)


def test_the_model_tells_layout_and_white_of_an_array(model, raw, black):
    codes = np.array(Image.open(raw))
    codes[40:44, 40:44] = 4095
    told = malus.denoise(codes, layout=LAYOUT, white=4095, black=black, model=model, gain=12, variance=True)
    for given in ({}, {"layout": LAYOUT}, {"white": 4095}, {"black": black}, {"black": black[0]}):
        found = malus.denoise(codes, model=model, gain=12, variance=True, **given)
        assert np.array_equal(found["dn"], told["dn"])
        assert np.isnan(found["variance"]).sum() == 16  # white is known: so are saturated pixels
    light = codes.astype(np.float32) - np.float32(black[0])
    with pytest.warns(UserWarning, match="float pixels are taken as DN above black"):
        assert np.isnan(malus.denoise(light, model=model, gain=12, variance=True)["variance"]).sum() == 16
    with pytest.raises(malus.InputError, match="has the layout mono"):
        malus.denoise(codes, layout="mono", model=model, gain=12)
    with pytest.raises(malus.InputError, match="does not know its layout and white level"):
        malus.denoise(codes)


def test_each_channel_has_its_black(model, raw):
    blacks = [70, 74, 68, 72]
    codes = offsets(np.full((96, 128), 300, np.uint16), blacks)
    np.save(raw.with_name("uneven.npy"), codes)
    means = lambda dn: [dn[r::2, c::2].mean() for r, c in CELL]
    frame = malus.load_frame(raw.with_name("uneven.npy"), layout=LAYOUT, black=blacks, white=4095)
    assert frame.black_dn == blacks
    # Naming the layout that the frame has already changes nothing, and neither does one of the same blacks.
    for other in ({}, {"layout": LAYOUT}):
        dn = malus.denoise(frame, model=model, gain=12, method="vst-bm3d", **other)["dn"]
        assert np.ptp(means(dn)) < 0.5
    for given in (blacks, np.array(blacks), tuple(blacks)):
        dn = malus.denoise(codes, layout=LAYOUT, white=4095, black=given, model=model, gain=12, method="vst-bm3d")["dn"]
        assert np.ptp(means(dn)) < 0.5
    with pytest.raises(malus.InputError, match="has no place for"):
        malus.denoise(frame, layout="mono")


@pytest.fixture
def results(raw, tmp_path):
    """What `malus denoise` makes of it: floats above black, and integers with the black put back."""
    program = pathlib.Path(os.environ.get("MALUS_PROGRAM", pathlib.Path(malus.__file__).parents[2] / "malus"))
    if not program.exists():
        pytest.skip("needs the program beside the module")
    subprocess.run([program, "denoise", raw, "--model", MODEL, "--gain", "12", "--u16", "-o", tmp_path],
                   check=True, capture_output=True)
    return tmp_path / "raw_denoised.tif", tmp_path / "raw_denoised_u16.tif"


def test_the_noise_of_a_denoised_file_is_not_taken_out_again(model, results):
    session = results[0].with_name("session.toml")
    session.write_text('[[frames]]\nkind = "bias"\npaths = ["raw_denoised.tif"]\n[sensor]\nlayout = "polar-mono"\n')
    for frame in (*map(malus.load_frame, results), pickle.loads(pickle.dumps(malus.load_frame(results[0]))),
                  malus.Session(session).load(0, 0)):
        for refused in (malus.denoise, malus.stokes, lambda raw, model: malus.renoise(raw, model, 18)):
            with pytest.raises(malus.InputError, match="denoised(_u16)?.tif: is denoised: model= states the noise of raw"):
                refused(frame, model=model)
        assert malus.stokes(frame)["s0"].mean() == pytest.approx(600, abs=2)


def test_black_is_not_subtracted_from_a_frame_that_is_above_it(model, results, black):
    of_file = malus.load_frame(results[0])
    light = malus.Frame(of_file.dn, LAYOUT, black=0, white=of_file.white_dn, gain_db=12)
    for given in {"black": black}, {"black": black[0], "white": 4000}:
        with pytest.warns(UserWarning, match="raw_denoised.tif: says that it is above black; black= is not subtracted") as said:
            frame = malus.load_frame(results[0], **given)
        assert ("it is saturated at" in str(said[0].message)) == ("white" in given)  # where the file says
        assert frame.black_dn == [0.0] * 4 and frame.white_dn == of_file.white_dn
        with pytest.warns(UserWarning, match="array: says that it is above black"):
            denoised = malus.denoise(light, model=model, method="vst-bm3d", **given)
        assert denoised["dn"].mean() == pytest.approx(300, abs=2)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert np.array_equal(malus.load_frame(results[0], black=0).dn, of_file.dn)
        assert malus.load_frame(results[1], black=70).black_dn == [70.0] * 4


@pytest.mark.parametrize("blacks", [[70, 74], [70] * 5, []])
def test_blacks_are_counted(model, raw, blacks):
    with pytest.raises(malus.InputError, match="one number, or one per channel"):
        malus.load_frame(raw, layout=LAYOUT, black=blacks)
    with pytest.raises(malus.InputError, match="^black: "):
        malus.denoise(malus.load_frame(raw, layout=LAYOUT), black=blacks, model=model, gain=12)


def test_light_beyond_the_calibrated_levels_is_said(tmp_path):
    """In the program's words, and by the pixels of all planes and frames."""
    model = malus.calibrate(ROOT / "examples/emva/session.toml", kinds=["nonparametric"], level_samples=2000)
    model.save(tmp_path / "m.h5")
    bright = np.full((2, 1, 96, 64), 100.0, np.float32)
    bright[1] = 10000  # above white, too, which is another warning

    def of_levels(work):
        with pytest.warns(UserWarning) as said:
            work()
        (line,) = [str(w.message) for w in said if "brightest level" in str(w.message)]
        return line

    assert of_levels(lambda: model.synthesize(bright, kind="nonparametric")).startswith("50 % of the pixels lie above the brightest level")
    line = of_levels(lambda: model.synthesize(bright[1], kind="nonparametric"))
    assert line.startswith("100 % of the pixels lie above the brightest level")
    assert line == of_levels(lambda: model.at_gain(None, kind="nonparametric").synthesize(bright[1, 0]))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        model.synthesize(bright[0], kind="nonparametric")
    program = pathlib.Path(os.environ.get("MALUS_PROGRAM", pathlib.Path(malus.__file__).parents[2] / "malus"))
    if not program.exists():
        pytest.skip("needs the program beside the module")
    np.save(tmp_path / "bright.npy", bright[1, 0])
    done = subprocess.run([program, "synthesize", tmp_path / "bright.npy", "-m", tmp_path / "m.h5", "--kind", "nonparametric",
                           "-o", tmp_path / "out"], check=True, capture_output=True, text=True)
    assert f"warning: {line}" in done.stderr.splitlines()


def test_pixels_without_a_number_are_said_of_polarization():
    dn = np.full((64, 64), 500, np.float32)
    dn[4, 4], dn[20, 31] = np.nan, np.inf
    for work in malus.stokes, malus.normals:
        with pytest.warns(UserWarning) as said:
            work(dn, "polar-mono")
        assert [str(w.message) for w in said] == ["array: 2 pixels are NaN or infinite; S0, DoLP and AoLP are wrong or undefined there"]
        with pytest.raises(malus.InputError, match="all pixels are NaN or infinite"):
            work(np.full_like(dn, np.nan), "polar-mono")


def test_what_makes_polarization_wrong_is_said_in_the_programs_words(tmp_path):
    """Of frames whose black level nobody told, or that lie below it."""
    program = pathlib.Path(os.environ.get("MALUS_PROGRAM", pathlib.Path(malus.__file__).parents[2] / "malus"))
    if not program.exists():
        pytest.skip("needs the program beside the module")
    rows, cols = np.mgrid[0:64, 0:64]
    light = 1000 * (1 + 0.5 * np.cos(np.radians(2 * np.array([[90, 45], [135, 0]])[rows % 2, cols % 2])))
    Image.fromarray(np.round(light + 80).astype(np.uint16)).save(tmp_path / "light.tif")
    given = {"layout": LAYOUT, "black": 80, "white": 4095}
    for told, flags in ({"layout": LAYOUT}, ["--layout", LAYOUT]), \
                       ({**given, "black": 3000}, ["--layout", LAYOUT, "--black", "3000", "--white", "4095"]):
        frame = malus.load_frame(tmp_path / "light.tif", **told)
        for work in malus.stokes, malus.normals:
            with pytest.warns(UserWarning) as said:
                work(frame)
            ran = subprocess.run([program, work.__name__, frame.source, *flags, "-o", tmp_path, "--force"], check=True, capture_output=True, text=True)
            words = [line.removeprefix("warning: ") for line in ran.stderr.splitlines() if line.startswith("warning: ")]
            for flag in "black", "white":
                words = [line.replace(f"--{flag}", f"{flag}=") for line in words]
            assert [str(w.message) for w in said] == words and words
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        malus.stokes(malus.load_frame(tmp_path / "light.tif", **given))
        malus.stokes(malus.Frame(light.astype(np.float32), LAYOUT))  # floats are above black


def test_light_that_is_below_black_is_said_of_arrays():
    for work, told, where in (malus.stokes, {}, "cells"), (malus.normals, {}, "cells"), (malus.stokes, {"demosaick": "bilinear"}, "pixels"), \
                             (malus.stokes, {"model": MODEL, "gain": 12}, "cells"):
        with pytest.warns(UserWarning, match=f"array: no light above black in 100 % of the {where}: DoLP and AoLP are undefined there; check black="):
            work(np.full((64, 64), -500, np.float32), LAYOUT, **told)


def test_saturated_cells_are_said_in_the_programs_words(model, black, tmp_path):
    program = pathlib.Path(os.environ.get("MALUS_PROGRAM", pathlib.Path(malus.__file__).parents[2] / "malus"))
    if not program.exists():
        pytest.skip("needs the program beside the module")
    dn = np.full((64, 64), 500, np.uint16)
    dn[4, 4] = dn[20, 31] = dn[21, 30] = 4095
    Image.fromarray(dn).save(tmp_path / "raw.tif", description=f"[malus layout=polar-mono black={black[0]:g} white=4095]")
    Image.fromarray(dn.astype(np.float32)).save(tmp_path / "done.tif", description="[malus layout=polar-mono black=0 white=4095 holds=denoised]")
    raw, done = malus.load_frame(tmp_path / "raw.tif"), malus.load_frame(tmp_path / "done.tif", white=5000)
    variance = np.where(dn == 4095, np.nan, 4).astype(np.float32)
    for command, frame, told, flags in (malus.stokes, raw, {}, ()), (malus.normals, raw, {}, ()), (malus.stokes, done, {}, ("--white", "5000")), \
                                       (malus.stokes, raw, {"model": model, "gain": 12}, ("--model", MODEL, "--gain", "12")), \
                                       (malus.stokes, done, {"variance": variance}, ()):
        with pytest.warns(UserWarning, match=r"with saturated pixels") as said:
            command(frame, **told)
        words = [str(w.message) for w in said if "saturated" in str(w.message)]
        assert words == [f"{frame.source}: 2 cells (0.2 %) with saturated pixels: S0, DoLP and AoLP are wrong there"]
        ran = subprocess.run([program, command.__name__, frame.source, *flags, "-o", tmp_path, "--force"], check=True, capture_output=True, text=True)
        assert f"warning: {words[0]}" in ran.stderr.splitlines()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        malus.stokes(dn.astype(np.float32), LAYOUT)  # of an array white is not known
        malus.stokes(dn.astype(np.float32), LAYOUT, variance=np.full(dn.shape, 4, np.float32))


@pytest.mark.parametrize("kind", ["i4", "u4", "i8", "u8", ">i8"])
def test_whole_numbers_that_float_rounds_are_refused_as_in_a_file(kind, tmp_path):
    codes = np.full((8, 8), 2**24, kind)
    assert (malus.Frame(codes, LAYOUT, white=2**25).dn == 2**24).all()
    codes[3, 4] += 3
    np.save(tmp_path / "codes.npy", codes)
    calls = [("array", lambda: malus.Frame(codes, LAYOUT)), ("array", lambda: malus.denoise(codes, layout=LAYOUT, white=2**25)),
             ("array", lambda: malus.info(codes.tolist())), (r".*codes\.npy", lambda: malus.load_frame(tmp_path / "codes.npy"))]
    for name, call in calls:
        with pytest.raises(malus.InputError, match=f"^{name}: it holds the integer 16777219, above 2\\^24; scale it down or store it as float$"):
            call()
    assert (malus.Frame(codes.astype(np.float64), LAYOUT).dn >= 2**24).all()
    if kind == "i8":
        with pytest.raises(malus.InputError, match="^array: it holds the integer -16777219, above"):
            malus.Frame(-codes, LAYOUT)


@pytest.mark.parametrize("kind, white", [("u1", 255), ("u2", 65535), ("i2", 32767), ("i4", 240), ("u4", 240), ("u8", 240), ("f4", 240)])
def test_white_that_nobody_tells_is_that_of_a_file(kind, white, tmp_path):
    codes = np.arange(1, 241).reshape(12, 20).astype(kind)
    np.save(tmp_path / "codes.npy", codes)
    assert malus.Frame(codes, LAYOUT).white_dn == malus.load_frame(tmp_path / "codes.npy", layout=LAYOUT).white_dn == white
    if kind in ("i4", "u4", "u8"):
        with pytest.raises(malus.InputError, match=r"codes\.npy: holds integers of more than 16 bits, and how large white"):
            malus.simulate(tmp_path / "codes.npy", "mono")


def test_a_frame_without_polarizers_is_named(tmp_path):
    np.save(tmp_path / "grey.npy", np.full((8, 8), 300, np.uint16))
    for given, name in ((malus.load_frame(tmp_path / "grey.npy", layout="mono"), r".*grey\.npy"), (np.full((8, 8), 300.0), "array")):
        with pytest.raises(malus.InputError, match=f"^{name}"):
            malus.stokes(given, "mono")


def test_codes_without_a_sign_have_no_negative_black():
    for codes, name in ((np.full((8, 8), 300, np.uint16), "uint16"), (np.full((8, 8), 30, ">u4"), "uint32"), (np.ones((8, 8), bool), "bool")):
        for call in (lambda: malus.Frame(codes, LAYOUT, black=-5), lambda: malus.info(codes, layout=LAYOUT, black=-5),
                     lambda: malus.denoise(codes, layout=LAYOUT, black=-5, white=4095)):
            with pytest.raises(malus.InputError, match=f"^array: black -5 DN is negative, its {name} codes begin at 0; check black=, or the session file$"):
                call()
    for codes in (np.full((8, 8), 300, np.int16), np.full((8, 8), 300.0)):
        assert malus.Frame(codes, LAYOUT, black=-5).black_dn == [-5] * 4


def test_black_may_be_any_array_of_numbers(raw):
    codes = np.array(Image.open(raw))
    for one in (82, np.uint16(82), np.array(82), np.array([82.0])):
        assert malus.Frame(codes, LAYOUT, black=one).black_dn == [82] * 4, one
    for four in ([1, 2, 3, 4], (1, 2, 3, 4), np.arange(1, 5), range(1, 5)):
        assert malus.Frame(codes, LAYOUT, black=four).black_dn == [1, 2, 3, 4], four
    with pytest.raises(malus.InputError, match="^black: is an empty list"):
        malus.Frame(codes, LAYOUT, black=np.zeros(0))


def test_black_may_be_a_tensor(raw):
    torch = pytest.importorskip("torch", reason="needs PyTorch")
    codes = np.array(Image.open(raw))
    for one in (torch.tensor(82.0), torch.full((1,), 82)):
        assert malus.Frame(codes, LAYOUT, black=one).black_dn == [82] * 4, one
    assert malus.Frame(codes, LAYOUT, black=torch.arange(1, 5)).black_dn == [1, 2, 3, 4]


def test_denoise_says_what_it_guessed():
    codes = np.random.default_rng(1).normal(300, 8, (192, 192)).round().astype(np.uint16)
    with pytest.warns(UserWarning, match="black level not known, taken as 0; DoLP is too low"):
        malus.denoise(codes, layout=LAYOUT, white=4095)
    with pytest.raises(malus.InputError, match="gain: is of a model"):
        malus.denoise(codes, layout=LAYOUT, white=4095, black=82, gain=24)


def test_a_stated_white_holds_the_black_level_of_the_model(model):
    """Of float pixels that are above black, as in the program."""
    light = np.full((64, 64), 300, np.float32)
    light[:32, :32] = 4095 - 82
    with pytest.warns(UserWarning, match="taken as DN above black"):
        done = malus.denoise(light, model=model, gain=12, white=4095)
    assert done["saturated_pixels"] == 32 * 32


def test_a_mean_of_unknown_white_is_told():
    frame = malus.Frame(np.full((16, 16), 300, np.uint16), layout=LAYOUT, black=82)
    with pytest.warns(UserWarning, match="white level not known"):
        malus.average([frame, frame])


def test_light_of_another_scale_is_said():
    """Of 0 to 1, or of 16 bits for a camera of 12; in one text, which Python shows once."""
    model = malus.Model(MODEL)
    light = np.linspace(0, 3000, 4 * 32 * 32, dtype=np.float32).reshape(4, 32, 32)
    for given, words in ((light / 3000, "^clean: no pixel is brighter than 1 DN"), (light * 16, "^clean: .* brighter than white, 4013 DN")):
        for clean in (given, given[None], given[0]):
            with pytest.warns(UserWarning, match=words):
                model.synthesize(clean, gain=12)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        model.synthesize(light, gain=12)
        model.synthesize(np.full((8, 8), 0.5, np.float32), gain=12)


def test_comparisons_say_what_is_no_noise():
    """A clean scene of ten times the light matched every noise there is, and codes were compared with light, without a word."""
    model = malus.Model(MODEL)
    clean = np.tile(np.linspace(20, 900, 96, dtype=np.float32), (96, 1))
    first, second = (np.stack([model.synthesize(clean, gain=12, frame=2 * k + i) for i in range(2)]) for k in range(2))
    with pytest.warns(UserWarning, match=r"reference shows 0\.(0999|1|1\d\d) times the light of clean"):
        assert malus.compare_noise(first, second, LAYOUT, 10 * clean)["sqrt_jsd"] < 0.05
    codes = np.rint(first + 82).astype(np.uint16)
    with pytest.warns(UserWarning, match="^reference: holds integers"):
        malus.compare_noise(codes, second, LAYOUT, clean)
    with pytest.warns(UserWarning, match="^test: holds integers"):
        malus.evaluate(clean, codes[0], LAYOUT, 4013)
    with pytest.warns(UserWarning, match="DoLP is too low"):
        malus.evaluate(codes[1], codes[0], LAYOUT, 4013)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        malus.compare_noise(first, second, LAYOUT, clean)
        malus.evaluate(codes[1], codes[0], "mono", 4013)
