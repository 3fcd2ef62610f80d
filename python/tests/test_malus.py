import os
import pathlib
import re
import subprocess
import threading
import time

import numpy as np
import pytest

malus = pytest.importorskip("malus", reason="the Python module is not built (pybind11 is missing)")

ROOT = pathlib.Path(__file__).resolve().parents[2]
MODEL = "imx250myr-simulated"


def test_model_tells_what_it_is(model):
    assert model.layout == "polar-bayer-rggb"
    assert model.channels[0] == "R90" and len(model.channels) == 16
    shown = model.as_dict()
    assert shown["channels"] == model.channels
    assert shown["gains"][0]["K"]["unit"] == "DN/e-"


def test_names_in_model_files_may_be_any_bytes(tmp_path):
    h5py = pytest.importorskip("h5py")
    path = tmp_path / "m.h5"
    path.write_bytes((ROOT / "fuzz/corpus/model/good_full.h5").read_bytes())
    with h5py.File(path, "a") as file:
        for name in ("name", "origin"):
            del file["sensor"][name]
            file["sensor"][name] = np.bytes_(b"caf\xe9")
    model = malus.Model(path)
    assert os.fsencode(model.sensor) == b"caf\xe9"
    assert "caf\N{REPLACEMENT CHARACTER}" in str(model.as_dict())


def test_same_seed_gives_same_noise_for_any_number_of_threads(model):
    clean = np.full((64, 96), 150, np.float32)
    drawn = []
    for threads in (1, 2, 3):
        malus.set_threads(threads)
        drawn.append(model.synthesize(clean, gain=12, seed=7, frame=3))
    malus.set_threads(0)
    assert all(np.array_equal(drawn[0], other) for other in drawn[1:])
    assert not np.array_equal(drawn[0], model.synthesize(clean, gain=12, seed=0, frame=3))


def test_variance_follows_the_model(model):
    """Shot and read noise at one gain: K s + dark variance, within 4 standard errors of a variance of 65536 samples."""
    shown = next(gain for gain in model.as_dict()["gains"] if gain["gain_db"] == 12)
    signal = 400.0
    noisy = model.synthesize(np.full((1024, 1024), signal, np.float32), gain=12, seed=1, parameters="mean", row=False)
    for row in range(4):
        for col in range(4):
            channel = 4 * row + col
            sample = noisy[row::4, col::4].astype(float)
            gain = shown["K"]["value"][channel]
            dark = shown["temporal_sd_dark"]["value"][channel] ** 2 - shown["sigma_row"]["mean"][channel] ** 2
            expected = gain * signal + dark
            assert sample.var() == pytest.approx(expected, rel=4 * np.sqrt(2 / sample.size) + 0.01)


def test_writes_into_an_existing_array_without_copying(model):
    clean = np.zeros((32, 64), np.float32)
    whole = np.zeros((32, 80), np.float32)
    view = whole[:, :64]
    result = model.synthesize(clean, gain=0, seed=1, out=view)
    assert np.shares_memory(result, view)
    assert view.std() > 0 and not whole[:, 64:].any()


@pytest.mark.parametrize("name, gain, rows, cols", [(MODEL, 24, 8, 16), (MODEL, 24, 70, 13), ("imx250mzr-simulated", 24, 41, 33),
                                                    ("sony-a7s2", 1600, 129, 7)])
def test_packed_planes_equal_the_packed_mosaic(name, gain, rows, cols):
    model = malus.Model(name)
    cell = {16: 4, 4: 2}[len(model.channels)]
    mosaic = np.random.default_rng(0).uniform(0, 500, (rows * cell, cols * cell)).astype(np.float32)
    pack = lambda m: np.stack([m[r::cell, c::cell] for r in range(cell) for c in range(cell)])
    expected = pack(model.synthesize(mosaic, gain=gain, seed=5))
    assert np.array_equal(model.synthesize(pack(mosaic), gain=gain, seed=5), expected)


def test_other_threads_run_meanwhile(model):
    clean = np.full((2048, 2048), 100, np.float32)
    ticks = []
    stop = threading.Event()

    def tick():
        while not stop.is_set():
            ticks.append(time.monotonic())
            time.sleep(0.001)

    thread = threading.Thread(target=tick)
    thread.start()
    start = time.monotonic()
    model.synthesize(clean, gain=12, seed=1, exact=True)
    end = time.monotonic()
    stop.set()
    thread.join()
    assert sum(start < t < end for t in ticks) >= 3


def test_the_help_of_denoise_names_all_that_it_tells(model):
    noisy = model.synthesize(np.full((64, 64), 300.0), gain=24, seed=1)
    result = malus.denoise(noisy, layout=model.layout, white=4000, model=model, gain=24)
    untold = [name for name in result if not re.search(rf"\b{name}\b", malus.denoise.__doc__)]
    assert not untold and result["tiles"] == 1


@pytest.mark.parametrize("method", ["bm3d", "nl-ridge"])
def test_denoise_stokes_and_metrics(model, method):
    """A polarized ramp: denoising brings it closer to the truth in the picture, in DoLP and in AoLP."""
    rows, cols = np.mgrid[0:256, 0:256]
    angle = np.deg2rad(np.array([[90, 45], [135, 0]]))[rows % 2, cols % 2]
    clean = ((200 + rows) * (1 + 0.5 * np.cos(2 * angle - np.deg2rad(60)))).astype(np.float32)
    noisy = model.synthesize(clean, gain=24, seed=2, debias=True)
    result = malus.denoise(noisy, layout=model.layout, white=4000, model=model, gain=24, variance=True, method=method)
    assert result["dn"].shape == clean.shape and result["variance"].min() > 0
    before = malus.evaluate(clean, noisy, model.layout, 4000)
    after = malus.evaluate(clean, result["dn"], model.layout, 4000)
    assert after["image_psnr"] > before["image_psnr"] + 6
    assert after["dolp_psnr"] > before["dolp_psnr"] + 6
    assert after["pixels_left_out"] == 0
    holed = clean.copy()
    holed[7, 9] = np.nan
    assert malus.evaluate(holed, result["dn"], model.layout, 4000)["pixels_left_out"] > 0
    truth = malus.stokes(clean, model.layout)
    assert truth["dolp"].shape == (3, 64, 64)
    assert np.allclose(truth["dolp"], 0.5, atol=0.02)
    # With the bias left in, which denoise takes out: two stated deviations hold the truth in 95 % (docs/uncertainty.md).
    result = malus.denoise(model.synthesize(clean, gain=24, seed=2), layout=model.layout, white=4000, model=model, gain=24,
                           variance=True, method=method)
    stated = malus.stokes(result["dn"], model.layout, variance=result["variance"])
    for name in ("s0", "s1", "s2", "dolp"):
        assert stated[f"{name}_sd"].shape == (3, 64, 64) and stated[f"{name}_sd"].min() > 0
        assert np.mean(np.abs(stated[name] - truth[name]) < 2 * stated[f"{name}_sd"]) > 0.9, name
    # The angles' errors are shared: more of them in S0, less in S1 and S2 as far as they are alike.
    v90, v45, v135, v0 = (result["variance"][r::4, c::4] for r, c in ((0, 0), (0, 1), (1, 0), (1, 1)))  # red
    deviations = sum(np.sqrt(v) for v in (v0, v45, v90, v135))
    assert np.allclose(stated["s0_sd"][0] ** 2, 0.25 * (0.65 * (v0 + v45 + v90 + v135) + 0.35 * deviations ** 2), rtol=1e-4)
    assert np.allclose(stated["s1_sd"][0] ** 2, v0 + v90 - 2 * 0.35 * np.sqrt(v0 * v90), rtol=1e-4)
    raw = malus.stokes(result["dn"], model.layout, variance=result["variance"], denoised=False)
    assert np.allclose(raw["s1_sd"][0] ** 2, v0 + v90, rtol=1e-4)
    with pytest.raises(malus.InputError, match="variance: 255 x 256, the mosaic 256 x 256"):
        malus.stokes(clean, model.layout, variance=result["variance"][:, :255])
    with pytest.raises(malus.InputError, match="per cell only"):
        malus.stokes(clean, model.layout, variance=result["variance"], demosaick="residual")
    for method in ("residual", "bilinear"):
        full = malus.stokes(clean, model.layout, demosaick=method)
        assert full["dolp"].shape == (3, 256, 256)
        assert np.allclose(full["dolp"][:, 8:-8, 8:-8], 0.5, atol=0.02)
        assert np.allclose(full["aolp_deg"][:, 8:-8, 8:-8], 30, atol=1)
    with pytest.raises(malus.InputError, match='demosaick: "best" is not known; give bilinear or residual, or None'):
        malus.stokes(clean, model.layout, demosaick="best")


def test_headerless_frames_and_what_a_notebook_shows(tmp_path):
    values = np.arange(48, dtype="<u2").reshape(6, 8) + 4000
    values.tofile(tmp_path / "frame.raw")
    frame = malus.load_frame(tmp_path / "frame.raw", "polar-mono", [80, 81, 82, 83], 4095, raw_format="mono16", size=(8, 6))
    assert (frame.dn == values).all()
    assert repr(frame) == f"<malus.Frame {tmp_path}/frame.raw: 8x6 polar-mono, black 80 to 83, white 4095 DN>"
    session = malus.Session(ROOT / "examples/emva/session.toml")
    assert repr(session).endswith(f"examples/emva/session.toml: {sum(len(g.paths) for g in session.groups)} frames in {len(session.groups)} groups>")
    assert repr(session.groups[0]) == "<malus.FrameGroup flat: 2 frames, 4e-05 s, level 1>"
    assert repr(malus.Model("imx250mzr-simulated")) == "<malus.Model Sony IMX250MZR (simulated): polar-mono, physics>"
    with pytest.raises(malus.InputError, match="a headerless file needs its size"):
        malus.load_frame(tmp_path / "frame.raw", raw_format="mono16")


def test_calibrates_the_shipped_session():
    measured = malus.calibrate(ROOT / "examples/emva/session.toml").as_dict()
    assert measured["gains"][0]["K"]["value"][0] == pytest.approx(0.28, abs=0.01)


def test_divergences():
    a, b = np.array([1, 2, 1]), np.array([1, 1, 2])
    p, q = a / 4, b / 4
    middle = (p + q) / 2
    expected = 0.5 * np.sum(p * np.log2(p / middle)) + 0.5 * np.sum(q * np.log2(q / middle))
    assert malus.jsd_bits(a, b) == pytest.approx(expected)
    assert malus.kld_nats(a, b) == pytest.approx(np.sum(p * np.log(p / q)))


@pytest.mark.parametrize("divergence, names", [(malus.jsd_bits, ("a", "b")), (malus.kld_nats, ("test_q", "reference_p"))])
def test_histograms_hold_counts(divergence, names):
    good = [1, 2]
    for bad in ([1.7, 2.2], [1, -2], [1, float("nan")], [float("inf"), 1], [2**62, 2**62], np.array([2**63, 1], np.uint64)):
        for which, given in ((0, (bad, good)), (1, (good, bad))):
            with pytest.raises(malus.InputError, match=f"^{names[which]}: "):
                divergence(*given)
    expected = divergence([3, 4], [1, 2])
    for kind in (float, np.float32, np.uint8, np.uint64, np.int16, ">i4"):
        assert divergence(np.array([3, 4], kind), np.array([1, 2], kind)) == expected


def test_paths_need_not_be_utf8(tmp_path):
    path = f"{tmp_path}/\udcfe"
    with pytest.raises(malus.InputError, match="\udcfe.h5: does not exist"):
        malus.Model(path + ".h5")
    np.save(path + ".npy", np.arange(64, dtype=np.uint16).reshape(8, 8))
    assert malus.load_frame(path + ".npy", layout="mono").source == path + ".npy"


def test_errors_have_the_words_of_the_program_but_for_names(model, tmp_path):
    program = pathlib.Path(os.environ.get("MALUS_PROGRAM", pathlib.Path(malus.__file__).parents[2] / "malus"))
    if not program.exists():
        pytest.skip("needs the program beside the module")
    np.save(tmp_path / "clean.npy", np.zeros((8, 8), np.float32))
    synthesize = [tmp_path / "clean.npy", "--layout", "polar-bayer-rggb", "-o", tmp_path / "out"]
    for call, arguments in ((lambda: malus.Model("/no/such.h5"), ["model", "show", "/no/such.h5"]),
                            (lambda: malus.Session("/no/such.toml"), ["calibrate", "/no/such.toml", "-o", tmp_path / "m.h5"]),
                            (lambda: model.synthesize(np.zeros((8, 8)), gain=99),
                             ["synthesize", *synthesize, "--model", MODEL, "--gain", "99"])):
        with pytest.raises(malus.InputError) as raised:
            call()
        done = subprocess.run([program, *arguments], capture_output=True, text=True)
        assert done.returncode == 1
        model_of_the_program = f"{MODEL}: " if "--gain" in arguments else ""  # the object does not know its file
        said = f"{raised.value}".replace("malus.models()", "`malus model list`").replace("extrapolate_gain=True", "--extrapolate-gain")
        assert done.stderr.strip() == f"malus: {model_of_the_program}{said}"


def test_version_is_the_program_s():
    assert malus.__version__ == re.search(r"VERSION ([\d.]+)", (ROOT / "CMakeLists.txt").read_text().split("project(")[1])[1]


@pytest.mark.parametrize("call, error", [
    (lambda m: malus.Model("/no/such.h5"), malus.InputError),
    (lambda m: m.synthesize(np.zeros((4, 4)), gain=99), malus.InputError),
    (lambda m: m.synthesize(np.zeros((4, 4)), gain=12, kidn="physics"), TypeError),
    (lambda m: m.synthesize(np.zeros((4, 4)), gain=12, kind="fysics"), ValueError),
    (lambda m: m.synthesize(np.zeros(4), gain=12), ValueError),
    (lambda m: m.synthesize(np.zeros((4, 4)), gain=12, out=np.zeros((4, 5), np.float32)), ValueError),
    (lambda m: malus.stokes(np.zeros((4, 4)), "bayer-rggb"), malus.InputError),
    (lambda m: malus.evaluate(np.zeros((4, 4)), np.zeros((4, 8)), m.layout, 100), malus.InputError),
    (lambda m: malus.evaluate(np.zeros((4, 4)), np.zeros((4, 4)), m.layout, 0), malus.InputError),
    (lambda m: malus.evaluate(np.zeros((4, 4)), np.zeros((4, 4)), m.layout, float("nan")), malus.InputError),
    (lambda m: malus.denoise(np.zeros((8, 8)), layout=m.layout, white=10, black=82, model=m, gain=12), malus.InputError),
    (lambda m: malus.denoise(np.zeros((8, 8)), layout=m.layout, white=float("nan"), model=m, gain=12), malus.InputError),
    (lambda m: malus.calibrate(None), TypeError),
])
def test_mistakes_raise(model, call, error):
    with pytest.raises(error):
        call(model)
