"""What a researcher writes first: frames and calibrations of arrays, pictures' noise, polarization, processes and threads."""

import concurrent.futures
import copy
import multiprocessing
import os
import pathlib
import pickle
import re
import signal

import numpy as np
import pytest

malus = pytest.importorskip("malus", reason="the Python module is not built (pybind11 is missing)")

EXAMPLE = pathlib.Path(__file__).resolve().parents[2] / "examples/emva/session.toml"
LAYOUT = "polar-mono"
BLACK, WHITE, GAIN_DN_PER_E, READ_DN = 60.0, 4095.0, 0.5, 3.0


@pytest.fixture(scope="module")
def model():
    return malus.Model("imx250myr-simulated")


def camera(light_dn, frames, seed, size=128):
    """Known physics: Poisson electrons, Gaussian read noise, rounding."""
    rng = np.random.default_rng(seed)
    electrons = rng.poisson(light_dn / GAIN_DN_PER_E, (frames, size, size))
    return np.clip(np.round(BLACK + GAIN_DN_PER_E * electrons + rng.normal(0, READ_DN, electrons.shape)), 0, WHITE).astype(np.uint16)


def session(wrap=lambda frames: frames, **gain):
    sets = [malus.FrameSet("bias", wrap(camera(0, 8, 0)), **gain)]
    return sets + [malus.FrameSet("flat", wrap(camera(250 * k, 4, k)), exposure_s=1e-3 * k, **gain) for k in range(1, 9)]


class Lazy:
    """Decoded when it is asked for, as a data set in a file is."""

    def __init__(self, frames):
        self.frames, self.asked = frames, 0

    def __len__(self):
        return len(self.frames)

    def __getitem__(self, index):
        self.asked += 1
        return self.frames[index]


def test_arrays_are_calibrated():
    """K and the dark deviation of the simulation: K within 2 % (its standard error is 0.4 %), the deviation within 0.1 DN."""
    told = dict(layout=LAYOUT, black=BLACK, white=WHITE)
    found = malus.calibrate(session(gain_db=12), sensor="simulated", **told)
    assert found.sensor == "simulated" and found.layout == LAYOUT
    (gain,) = found.as_dict()["gains"]
    assert gain["gain_db"] == 12
    assert gain["K"]["value"] == pytest.approx([GAIN_DN_PER_E] * 4, rel=0.02)
    assert gain["temporal_sd_dark"]["value"] == pytest.approx([np.hypot(READ_DN, 12 ** -0.5)] * 4, abs=0.1)
    # The same of other sequences of the same frames, and of Frames that tell all themselves.
    lazy = Lazy(camera(0, 8, 0))
    for sets, given in ((session(list, gain_db=12), told), (session(lambda frames: frames.astype(">f8"), gain_db=12), told),
                        (session(lambda frames: [malus.Frame(f, LAYOUT, BLACK, WHITE) for f in frames], gain_db=12), {}),
                        ([malus.FrameSet("bias", lazy, gain_db=12)] + session(gain_db=12)[1:], told)):
        again = malus.calibrate(sets, **given).as_dict()["gains"][0]
        assert again["K"]["value"] == gain["K"]["value"], sets
    assert lazy.asked >= 8


def test_what_a_calibration_warns_about_is_warned_of():
    """As the program does: with the gain, and that it also stands in the model does not hide it."""
    sets = session(gain_db=12)
    with pytest.warns(UserWarning) as said:
        (gain,) = malus.calibrate(sets[:1], layout=LAYOUT, black=BLACK, white=WHITE).as_dict()["gains"]
    assert gain["warnings"] and {f"12 dB: {text}" for text in gain["warnings"]} <= {str(w.message) for w in said}


def test_a_gain_that_nobody_told_is_warned_of(recwarn):
    found = malus.calibrate(session(), layout="mono", black=BLACK, white=WHITE)
    recwarn.clear()
    clean = np.full((16, 16), 300, np.float32)
    found.synthesize(clean)
    assert not recwarn.list
    for use in (lambda: found.at_gain(12), lambda: found.synthesize(clean, 12),
                lambda: malus.renoise(malus.Frame(camera(500, 1, 1)[0], "mono", BLACK, WHITE), found, 12)):
        with pytest.warns(UserWarning, match="does not say its gain; it is taken for 12 dB"):
            use()


def test_a_list_of_sets_is_checked():
    good = session()
    for sets, words in (([], "session: holds no sets"), (good + good[:1], "there are two such sets; give their frames as one"),
                        ([malus.FrameSet("bias", camera(0, 2, 0)[:, :, :127])] + good[1:], "is 128x128 pixels, but .* is 127x128")):
        with pytest.raises(malus.InputError, match=words):
            malus.calibrate(sets, layout="mono", black=BLACK, white=WHITE)
    with pytest.raises(malus.InputError, match="^session: holds no bias frames; add a FrameSet of kind bias: frames taken with"):
        malus.calibrate(good[1:], layout="mono", black=BLACK, white=WHITE)
    with pytest.raises(malus.InputError, match="bias, 12 dB, frame 1: has the same pixels as bias, 12 dB, frame 0"):
        malus.calibrate([malus.FrameSet("bias", camera(0, 1, 0).repeat(3, 0), gain_db=12)], layout="mono", black=BLACK, white=WHITE)
    with pytest.raises(malus.InputError, match='kind: "dark" is no kind of frames; .*there are bias, flat'):
        malus.FrameSet("dark", camera(0, 2, 0))
    with pytest.raises(malus.InputError, match="holds no frames"):
        malus.FrameSet("bias", [])
    with pytest.raises(TypeError, match="a sequence of mosaics"):
        malus.FrameSet("bias", iter([]))
    with pytest.raises(TypeError, match="a list of FrameSet"):
        malus.calibrate(["session.toml"])
    with pytest.raises(malus.InputError, match="session: tells sensor, layout"):
        malus.calibrate(malus.Session(EXAMPLE), layout="mono")
    assert repr(good[1]) == "<malus.FrameSet flat, unknown gain, 0.001 s: 4 frames>" and len(good[1]) == 4


def test_numbers_of_a_calibration_of_arrays_have_the_ranges_of_sessions():
    good, told = session(), dict(layout=LAYOUT, black=BLACK, white=WHITE)
    for rows in (0, -1, 65):
        with pytest.raises(malus.InputError, match=f"^row_group: {rows} is outside its range; give 1 to 64$"):
            malus.calibrate(good, row_group=rows, **told)
    with pytest.raises(malus.InputError, match="32 rows are one row group of 64: nothing to compare; correct row_group, or leave it out$"):
        malus.calibrate([malus.FrameSet("bias", camera(0, 4, 0, 32))], row_group=64, **told)
    for level in (-1, 1000001):
        with pytest.raises(malus.InputError, match=f"^level: {level} is outside its range; give 0 to 1e\\+06$"):
            malus.FrameSet("bias", camera(0, 2, 0), level=level)
    assert "level 1000000" in repr(malus.FrameSet("flat", camera(0, 2, 0), level=1000000))
    with pytest.raises(malus.InputError, match="^kinds: names no kind of model; choose of physics, gaussian"):
        malus.calibrate(good, (), **told)


def test_gain_and_exposure_of_frames_are_those_of_their_set():
    def frames(light, count, **settings):
        return [malus.Frame(f, LAYOUT, BLACK, WHITE, **settings) for f in camera(light, count, int(light))]

    sets = [malus.FrameSet("bias", frames(0, 8, gain_db=12))]
    sets += [malus.FrameSet("flat", frames(250 * k, 4, gain_db=12, exposure_s=1e-3 * k)) for k in range(1, 9)]
    own = malus.calibrate(sets)
    assert own.as_dict()["gains"][0]["gain_db"] == 12
    flat = frames(250, 4, gain_db=12, exposure_s=1e-3)
    for told, odd, words in (
            ({}, {"gain_db": 24, "exposure_s": 1e-3}, "flat, 12 dB, 0.001 s, frame 4: was taken at 24 dB, the first of its set at 12 dB; give frames of each setting"),
            ({}, {"gain_db": 12, "exposure_s": 1.05e-3}, "frame 4: was taken at 0.00105 s, the first of its set at 0.001 s;"),
            ({"exposure_s": 1.02e-3}, {"exposure_s": 1.05e-3}, "frame 4: was taken at 0.00105 s, the first of its set at 0.001 s;"),
            ({"exposure_s": 2.5e-3}, {}, "frame 0: was taken at 0.001 s, its set at 0.0025 s;")):
        mixed = malus.FrameSet("flat", flat + frames(251, 1, **odd), **told)
        with pytest.raises(malus.InputError, match=words):
            malus.calibrate([sets[0], mixed] + sets[2:])
    with pytest.raises(malus.InputError, match="bias, 24 dB, frame 0: was taken at 12 dB, its set at 24 dB;"):
        malus.calibrate([malus.FrameSet("bias", frames(0, 8, gain_db=12), gain_db=24)])
    with pytest.raises(malus.InputError, match="there are two such sets"):
        malus.calibrate([sets[0], malus.FrameSet("bias", frames(0, 2), gain_db=12)])
    with pytest.raises(malus.InputError, match="frame 0: exposure_s: is 0 s; an exposure is positive"):
        malus.calibrate([sets[0], malus.FrameSet("flat", frames(250, 4, gain_db=12, exposure_s=0))])
    alone = malus.calibrate(session(list), layout=LAYOUT, black=BLACK, white=WHITE)
    with pytest.raises(malus.InputError, match="model: was calibrated at one gain that nobody told"):
        alone.random_gain(1, 2)


@pytest.mark.filterwarnings("ignore")  # of frames without row noise
def test_the_random_gain_of_a_kind_is_the_one_that_is_drawn(model):
    """Dark frames are not interpolated, so theirs is one of the gains that have them."""
    sets = [each for gain in (6, 24) for each in session(gain_db=gain)]
    both = malus.calibrate(sets, kinds=["physics", "dark-frames"], layout=LAYOUT, black=BLACK, white=WHITE)
    gains = [both.random_gain(5, frame, kind="dark-frames") for frame in range(12)]
    assert set(gains) == {6, 24}
    clean = np.full((64, 64), 100, np.float32)
    for frame, gain in enumerate(gains):
        told = dict(seed=5, frame=frame, kind="dark-frames")
        assert np.array_equal(both.synthesize(clean, gain=None, **told), both.synthesize(clean, gain=gain, **told))
    with pytest.raises(malus.InputError, match="holds no dark-frames model"):
        model.random_gain(5, 0, kind="dark-frames")
    with pytest.raises(malus.InputError, match="kind: lognormal is not known"):
        model.random_gain(5, 0, kind="lognormal")


def test_settings_of_arrays_are_checked_as_those_of_sessions():
    codes = camera(0, 2, 0)
    for bad, words in (({"iso": -5}, "^iso: is -5; ISO is positive"), ({"iso": float("inf")}, "^iso: is inf"), ({"gain_db": float("nan")}, "^gain_db: is nan"),
                       ({"gain_db": 240}, "beyond any camera's; give decibels"), ({"exposure_s": -1}, "^exposure_s: is -1 s; an exposure is positive"),
                       ({"exposure_s": float("nan")}, "^exposure_s: is nan"), ({"gain_db": 1, "iso": 100}, "^iso: stands beside gain_db")):
        for make in (lambda **told: malus.FrameSet("bias", codes, **told), lambda **told: malus.Frame(codes[0], **told)):
            with pytest.raises(malus.InputError, match=words):
                make(**bad)
    with pytest.raises(malus.InputError, match="^exposure_s: is 0 s"):
        malus.FrameSet("flat", codes, exposure_s=0)
    assert len(malus.FrameSet("bias", codes, exposure_s=0)) == 2 and malus.Frame(codes[0], exposure_s=0).exposure_s == 0


def test_what_a_sequence_raises_arrives():
    class Broken(Lazy):
        def __getitem__(self, index):
            if index == 2:
                raise OSError("the disk is gone")
            return super().__getitem__(index)

    with pytest.raises(OSError, match="the disk is gone"):
        malus.calibrate([malus.FrameSet("bias", Broken(camera(0, 4, 0)))], layout="mono", black=BLACK, white=WHITE)


def test_frames_of_arrays():
    codes = camera(300, 1, 1)[0]
    frame = malus.Frame(codes, LAYOUT, [60, 61, 62, 63], 4095, gain_db=12, exposure_s=0.01)
    assert (frame.dn == codes).all() and frame.black_dn == [60, 61, 62, 63] and frame.gain_db == 12 and frame.exposure_s == 0.01
    assert repr(frame) == "<malus.Frame array: 128x128 polar-mono, black 60 to 63, white 4095 DN, 12 dB, 0.01 s>"
    assert malus.Frame(codes).white_dn == 65535 and malus.Frame(codes.astype(np.uint8)).white_dn == 255
    assert malus.Frame(codes.astype(np.int64)).white_dn == codes.max()  # no camera fills 64 bits
    for bad in ({"black": 300, "white": 200}, {"layout": "polar-mona"}, {"gain_db": 1, "iso": 100}):
        with pytest.raises(malus.InputError):
            malus.Frame(codes, **bad)
    again = pickle.loads(pickle.dumps(frame))
    assert repr(again) == repr(frame) and (again.dn == frame.dn).all()
    noise = malus.Model("imx250mzr-simulated")
    assert np.array_equal(malus.denoise(again, model=noise)["dn"], malus.denoise(frame, model=noise)["dn"], equal_nan=True)


def test_every_kind_of_array_is_denoised_alike(model):
    codes = np.random.default_rng(0).poisson(282, (64, 64))
    given = dict(model=model, gain=24, black=82, white=4095)
    expected = malus.denoise(codes.astype(np.float32), **given)["dn"]
    frozen = codes.astype(np.float32)
    frozen.flags.writeable = False
    for kind in ("<u2", ">u2", "<u4", "i8", "f2", ">f4", "f8"):
        assert np.array_equal(malus.denoise(codes.astype(kind), **given)["dn"], expected), kind
    for other in (np.asfortranarray(codes), np.repeat(codes, 2, 1)[:, ::2], codes[::-1, ::-1][::-1, ::-1], frozen, codes.tolist()):
        assert np.array_equal(malus.denoise(other, **given)["dn"], expected)
    assert np.array_equal(malus.denoise(codes, **{**given, "model": "imx250myr-simulated"})["dn"], expected)
    with pytest.raises(ValueError, match=r"^raw has to be \[row, column\], not of shape \(2, 64, 64\)$"):
        malus.denoise(np.zeros((2, 64, 64)), **given)
    with pytest.raises(TypeError, match="^raw is a masked array, whose mask would be lost"):
        malus.denoise(np.ma.masked_greater(codes, 300), **given)
    with pytest.raises(malus.InputError, match="row -4, column 0 is no place on a sensor; correct origin=$"):
        malus.denoise(codes, origin=(-4, 0), **given)
    for name, value in (("origin", (0, 0)), ("extrapolate_gain", True)):
        with pytest.raises(malus.InputError, match=f"^{name}: is of a model, and none is given"):
            malus.denoise(codes, layout="mono", white=4095, **{name: value})


def test_a_gain_outside_is_taken_where_it_is_asked_for(model):
    codes = np.random.default_rng(0).poisson(282, (64, 64)).astype(np.uint16)
    with pytest.raises(malus.InputError, match="extrapolate_gain=True"):
        malus.denoise(codes, model=model, gain=31)
    with pytest.warns(UserWarning, match="extrapolated to 31 dB from the calibrated range 0 dB to 30 dB"):
        malus.denoise(codes, model=model, gain=31, extrapolate_gain=True)


def test_noise_of_a_picture():
    """Within 10 % of the simulation's slope and offset, 3 % of the deviation at 300 DN: six of its stated errors."""
    ramp = np.linspace(20, 600, 512)[None, :].repeat(512, 0)
    rng = np.random.default_rng(3)
    codes = np.round(BLACK + GAIN_DN_PER_E * rng.poisson(ramp / GAIN_DN_PER_E) + rng.normal(0, READ_DN, ramp.shape)).astype(np.uint16)
    found = malus.estimate_noise(codes, layout="mono", black=BLACK, white=WHITE)
    assert found["slope_dn"][0] == pytest.approx(GAIN_DN_PER_E, rel=0.1)
    expected = GAIN_DN_PER_E * 300 + READ_DN ** 2
    assert found["slope_dn"][0] * 300 + found["offset_dn2"][0] == pytest.approx(expected, rel=0.06)
    assert 0 < found["relative_error"] < 0.03 and "DN" in found["trust"]
    assert malus.estimate_noise(malus.Frame(codes, "mono", BLACK, WHITE)) == found
    with pytest.raises(malus.InputError, match="cannot be estimated: .*; give a larger picture, or calibrate the camera"):
        malus.estimate_noise(np.zeros((64, 64), np.uint16), layout="mono", white=WHITE)
    for function in (malus.estimate_noise, malus.denoise):
        with pytest.raises(malus.InputError, match="has no pixels"):
            function(np.full((0, 5), 200, np.uint16), layout="polar-mono", white=WHITE)


def test_stokes_of_frames_and_mosaics_of_stokes(model):
    truth = np.stack([np.full((32, 32), v, np.float32) for v in (500, 700, 900)])
    s1, s2 = 0.3 * truth, -0.2 * truth
    mosaic = malus.mosaic(truth, s1, s2, model.layout)
    angle = {0: s1, 45: s2, 90: -s1, 135: -s2}  # Malus's law at the four angles, S0 / 2 + this / 2
    for k, name in enumerate(model.channels):
        colour = "RGB".index(name[0])
        degrees = int(re.fullmatch(r"(?:R|B|G\d_)(\d+)", name)[1])
        seen = (truth + angle[degrees])[colour, 0, 0] / 2
        assert np.allclose(mosaic[k // 4::4, k % 4::4], seen, rtol=1e-6), name
    measured = malus.stokes(mosaic, model.layout)
    assert np.allclose(measured["s1"], s1[:, :8, :8], rtol=1e-5) and np.allclose(measured["dolp"], np.hypot(0.3, 0.2), rtol=1e-5)
    frame = malus.Frame(mosaic + 82, model.layout, black=82, white=4095)
    assert np.allclose(malus.stokes(frame)["s2"], measured["s2"], atol=1e-3)
    with pytest.raises(malus.InputError, match="layout: is not told by an array; name it, or give a Frame"):
        malus.stokes(mosaic)
    found = malus.check_layout(mosaic)
    assert found["winner"] == "diagonal" and found["margin"] > 1.15
    for wrong in ((truth[:2], s1, s2), (truth, s1[:, :16], s2)):
        with pytest.raises(ValueError):
            malus.mosaic(*wrong, model.layout)
    packed = malus.pack(mosaic, model.layout)
    assert packed.shape == (16, 8, 8) and np.array_equal(malus.unpack(packed, model.layout), mosaic)
    with pytest.raises(malus.InputError, match="planes: are 3; give one for each of the 16 channels"):
        malus.unpack(packed[:3], model.layout)


def test_stokes_of_raw_frames_state_their_errors(model):
    """Stated deviations against the spread over 60 frames: their mean ratio within 3 % (one standard error is 0.5 % and less)."""
    clean = malus.mosaic(np.full((1, 64, 64), 800.0), np.full((1, 64, 64), 200.0), np.full((1, 64, 64), 100.0), model.layout)
    raws = [model.synthesize(clean, gain=12, seed=4, frame=n, parameters="mean", row=False) for n in range(60)]
    seen = [malus.stokes(raw, model=model, gain=12) for raw in raws]
    for name in ("s0", "s1", "s2", "dolp"):
        spread = np.std([s[name] for s in seen], axis=0, ddof=1)
        stated = np.mean([s[f"{name}_sd"] for s in seen], axis=0)
        assert np.mean(spread) / np.mean(stated) == pytest.approx(1, abs=0.03 + (1 - 59 ** 0.5 / 60 ** 0.5)), name
    # The bias is taken out, and a Frame tells the rest.
    assert np.mean([s["s0"] for s in seen]) == pytest.approx(800, abs=0.5)
    frame = malus.Frame(raws[0] + 82, model.layout, black=82, white=82 + 900, gain_db=12)
    of_frame = malus.stokes(frame, model="imx250myr-simulated")
    assert np.allclose(of_frame["s1_sd"], seen[0]["s1_sd"], rtol=1e-4)
    for bad, words in (({"gain": 12, "variance": clean}, "variance: and model tell the same"), ({}, "the gain is not known"),
                       ({"gain": 12, "demosaick": "residual"}, "per cell only; leave it or model out"), ({"gain": 31}, "extrapolate_gain=True")):
        with pytest.raises(malus.InputError, match=words):
            malus.stokes(raws[0], model=model, **bad)
    with pytest.warns(UserWarning, match="extrapolated to 31 dB"):
        malus.stokes(raws[0], model=model, gain=31, extrapolate_gain=True)
    with pytest.raises(malus.InputError, match="^extrapolate_gain: is of a model, and none is given; give model=, or leave it out$"):
        malus.stokes(raws[0], model.layout, extrapolate_gain=True)


def test_saturated_cells_of_an_array_have_no_stated_error(model):
    """As of the Frame of the same light: white above black is the model's."""
    raw = np.full((16, 16), 900.0, np.float32)
    raw[4, 5] = 4095
    seen = malus.stokes(raw, model=model, gain=12)
    unknown = np.zeros((3, 4, 4), bool)  # colours and cells of polar-bayer-rggb
    unknown[0, 1, 1] = True
    frame = malus.Frame(raw + 82, model.layout, black=82, white=4095, gain_db=12)
    for of in (seen, malus.stokes(frame, model=model)):
        assert (np.isnan(of["s0_sd"]) == unknown).all() and (np.isnan(of["dolp_sd"]) == unknown).all()


def test_normals_of_a_sphere():
    """Diffuse Fresnel polarization of a sphere, index 1.5: its normals again, to half a degree in the mean."""
    y, x = np.mgrid[1:-1:64j, -1:1:64j]
    radius = np.hypot(x, y)
    inside = radius < 0.9
    z = np.sqrt(np.where(inside, 1 - radius ** 2, 1))
    sine2, n = np.where(inside, radius ** 2, 0), 1.5
    dolp = (n - 1 / n) ** 2 * sine2 / (2 + 2 * n ** 2 - (n + 1 / n) ** 2 * sine2 + 4 * z * np.sqrt(n ** 2 - sine2))
    azimuth = np.arctan2(y, x)
    s0 = np.where(inside, 1000.0, 0)
    grow = lambda plane: np.repeat(np.repeat(plane, 2, 0), 2, 1)[None]
    mosaic = malus.mosaic(grow(s0), grow(s0 * dolp * np.cos(2 * azimuth)), grow(s0 * dolp * np.sin(2 * azimuth)), LAYOUT)
    normals = malus.normals(mosaic, LAYOUT)
    assert normals.shape == (3, 64, 64) and normals.dtype == np.float32
    assert np.array_equal(np.isfinite(normals[0]), inside & np.isfinite(normals[0])) and np.isfinite(normals[0])[inside].mean() > 0.99
    cosine = normals[0] * x + normals[1] * y + normals[2] * z
    assert np.nanmean(np.degrees(np.arccos(np.clip(cosine[inside], -1, 1)))) < 0.5
    assert np.isnan(malus.normals(mosaic, LAYOUT, mask=np.zeros((64, 64), bool))).all()
    assert malus.normals(mosaic, LAYOUT, demosaick="bilinear").shape == (3, 128, 128)
    with pytest.raises(malus.InputError, match="mask: 128 x 128, the normals 64 x 64; give one value per cell"):
        malus.normals(mosaic, LAYOUT, mask=np.ones((128, 128)))


def draw(job):
    model, frame = job
    return model.synthesize(np.full((16, 16, 16), 200, np.float32), gain=None, seed=5, frame=frame)


def test_models_travel_to_threads_and_processes(model):
    alone = [draw((model, frame)) for frame in range(6)]
    with concurrent.futures.ThreadPoolExecutor(3) as pool:
        together = list(pool.map(draw, [(model, frame) for frame in range(6)]))
    assert all(np.array_equal(a, b) for a, b in zip(alone, together))
    with multiprocessing.get_context("fork").Pool(2) as pool:
        together = pool.map(draw, [(model, frame) for frame in range(6)])
    assert all(np.array_equal(a, b) for a, b in zip(alone, together))
    for again in (pickle.loads(pickle.dumps(model)), copy.deepcopy(model)):
        assert again.as_dict() == model.as_dict() and np.array_equal(draw((again, 0)), alone[0])


def test_what_is_there_and_what_it_is(model):
    assert "imx250myr-simulated" in malus.models() and all(malus.Model(name).kinds for name in malus.models())
    assert repr(model.at_gain(24)) == "<malus.Noise physics at 24 dB>"
    assert repr(malus.Model("sony-a7s2").at_gain(None)) == "<malus.Noise physics at random gains>"


def test_calibration_hears_of_ctrl_c():
    """Asked between frames: the exception of a signal handler comes out."""
    class Stopping(Lazy):
        def __getitem__(self, index):
            if index == 1:
                os.kill(os.getpid(), signal.SIGINT)
            return super().__getitem__(index)

    before = signal.signal(signal.SIGINT, signal.default_int_handler)  # a job in the background has it ignored
    try:
        with pytest.raises(KeyboardInterrupt):
            malus.calibrate([malus.FrameSet("bias", Stopping(camera(0, 32, 0, 256)))], layout="mono", black=BLACK, white=WHITE)
    finally:
        signal.signal(signal.SIGINT, before)
