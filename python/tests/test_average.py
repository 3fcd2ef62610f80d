"""Means of frames: what a model's noise is in them."""

import pickle

import malus
import numpy as np
import pytest

LAYOUT, GAIN_DB, FRAMES = "polar-mono", 24, 8


@pytest.fixture(scope="module")
def camera():
    return malus.Model("imx250mzr-simulated")


@pytest.fixture(scope="module")
def clean():
    ramp = np.linspace(100, 900, 128, dtype=np.float32)
    return np.add.outer(0.3 * ramp, ramp)


@pytest.fixture(scope="module")
def burst(camera, clean):
    return [malus.Frame(camera.synthesize(clean, gain=GAIN_DB, seed=3, frame=i), LAYOUT, black=0, white=3900, gain_db=GAIN_DB)
            for i in range(FRAMES)]


def test_a_mean_knows_what_it_is_of(burst, tmp_path):
    mean = malus.average(burst)
    assert mean.mean_of == FRAMES and burst[0].mean_of == 1 and mean.gain_db == GAIN_DB
    np.testing.assert_allclose(mean.dn, np.mean([f.dn for f in burst], axis=0), rtol=1e-6)
    assert pickle.loads(pickle.dumps(mean)).mean_of == FRAMES and f"mean of {FRAMES}" in repr(mean)
    assert malus.info(mean)["mean_of"] == FRAMES
    np.save(tmp_path / "own.npy", mean.dn)
    assert malus.load_frame(tmp_path / "own.npy", LAYOUT, mean_of=5).mean_of == 5


def test_stated_deviations_are_those_of_the_mean(burst, camera, clean):
    mean = malus.average(burst)
    stokes, truth = malus.stokes(mean, model=camera), malus.stokes(clean, LAYOUT)
    for name in ("s0", "s1", "s2"):
        # Of 4096 cells: ±2.2 %.
        assert np.mean(((stokes[name] - truth[name]) / stokes[f"{name}_sd"]) ** 2) == pytest.approx(1, abs=0.1)
    one, done = (malus.denoise(frame, model=camera, variance=True) for frame in (burst[0], mean))
    assert np.mean(done["sigma_used_dn"]) == pytest.approx(np.mean(one["sigma_used_dn"]) / np.sqrt(FRAMES), rel=0.02)
    error = (done["dn"] - clean) ** 2
    assert np.mean(error) < 0.5 * np.mean((one["dn"] - clean) ** 2)
    assert np.mean(np.sqrt(error / done["variance"]) < 2) > 0.93


def test_what_no_mean_is_for_is_refused(burst, camera):
    mean = malus.average(burst)
    with pytest.raises(malus.InputError, match="mean of 8 frames"):
        malus.average([mean, burst[0]])
    with pytest.raises(malus.InputError, match="mean of 8 frames"):
        malus.renoise(mean, camera, 30)
    with pytest.raises(malus.InputError, match="mean of 8 frames"):
        malus.calibrate([malus.FrameSet("bias", [mean, mean], gain_db=24), malus.FrameSet("flat", [mean, mean], gain_db=24, exposure_s=1)])
    with pytest.raises(malus.InputError, match="^average: of 1 frame; give 2"):
        malus.average(burst[:1])
    with pytest.raises(malus.InputError, match="has the same pixels as"):
        malus.average([burst[0], burst[1], burst[0]])
    with pytest.raises(malus.InputError, match=r"^frames\[2\]: has the same pixels as frames\[0\]"):
        malus.average([burst[0], burst[1], burst[0]])
    small = malus.Frame(burst[1].dn[:64], LAYOUT, black=0, white=3900, gain_db=GAIN_DB)
    with pytest.raises(malus.InputError, match=r"^frames\[1\]: has 128 x 64 pixels, other ones than frames\[0\] has"):
        malus.average([burst[0], small])
    assert malus.average(burst).source == burst[0].source == "array"
    with pytest.raises(TypeError, match=r"frames\[1\] is none"):
        malus.average([burst[0], burst[1].dn])
    with pytest.raises(TypeError, match="list of Frames"):
        malus.average([burst[0].dn, burst[1].dn])
    with pytest.raises(malus.InputError, match="mean_of"):
        malus.Frame(mean.dn, LAYOUT, mean_of=0)


def test_what_is_cut_off_at_0_is_told():
    random = np.random.default_rng(4)
    dark = [malus.Frame(np.maximum(np.round(random.normal(2, 4, (64, 64))), 0).astype(np.uint16), "mono", black=2, white=4095)
            for _ in range(2)]
    with pytest.warns(UserWarning, match="too bright"):
        malus.average(dark)
