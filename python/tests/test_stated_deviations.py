"""What stokes(model=) states of raw frames whose rows and columns have offsets, against the known light."""

import os
import pathlib
import subprocess

import numpy as np
import pytest

malus = pytest.importorskip("malus", reason="the Python module is not built (pybind11 is missing)")

BLACK, WHITE, GAIN, READ_DN, SIDE = 64.0, 4095.0, 2.0, 5.0, 256


def camera(random, light_dn, row_dn, column_dn):
    dn = GAIN * random.poisson(light_dn / GAIN, (SIDE, SIDE)) + random.normal(0, READ_DN, (SIDE, SIDE))
    dn += random.normal(0, row_dn, (SIDE, 1)) + random.normal(0, column_dn, (1, SIDE))
    return np.clip(np.round(BLACK + dn), 0, WHITE).astype(np.uint16)


def calibrated(random, row_dn, column_dn):
    sets = [malus.FrameSet("bias", [camera(random, 0, row_dn, column_dn) for _ in range(20)], gain_db=0)]
    for k in range(1, 5):
        sets.append(malus.FrameSet("flat", [camera(random, 800 * k, row_dn, column_dn) for _ in range(2)], gain_db=0, exposure_s=k))
    return malus.calibrate(sets, layout="polar-mono", black=BLACK, white=WHITE)


@pytest.mark.parametrize(("row_dn", "column_dn"), [(0, READ_DN), (READ_DN, READ_DN), (0, 0)])
def test_in_the_dark_they_are_true(row_dn, column_dn):
    """Within 5 %: 8 frames of 128 lines are 1.6 %, calibration 1 %, and up to 2 % are too much with 2.5 electrons of read noise. Were columns
    independent from pixel to pixel, S0's would be 0.82 of the truth, and with the variance of no light for all pixels below it 8 % too large."""
    random = np.random.default_rng(11)
    model = calibrated(random, row_dn, column_dn)
    error2, stated2 = {}, {}
    for _ in range(8):
        frame = malus.Frame(camera(random, 0, row_dn, column_dn), "polar-mono", black=BLACK, white=WHITE)
        seen = malus.stokes(frame, model=model, gain=0)
        for name in ("s0", "s1", "s2"):
            error2.setdefault(name, []).append(np.mean(seen[name] ** 2))
            stated2.setdefault(name, []).append(np.mean(seen[f"{name}_sd"] ** 2))
    for name in error2:
        assert np.sqrt(np.mean(stated2[name]) / np.mean(error2[name])) == pytest.approx(1, abs=0.05), name


def test_frames_of_synthesize_share_no_columns():
    """It draws column noise as noise of pixels: S0's deviation would be stated 1.2 times the true one."""
    model = calibrated(np.random.default_rng(12), 0, READ_DN)
    noisy = model.synthesize(np.zeros((SIDE, SIDE), np.float32), gain=0, seed=3, parameters="mean")
    seen = malus.stokes(noisy, model=model, gain=0)
    assert np.sqrt(np.mean(seen["s0_sd"] ** 2)) / np.std(seen["s0"]) == pytest.approx(1, abs=0.05)


def test_the_program_states_the_same(tmp_path):
    program = pathlib.Path(os.environ.get("MALUS_PROGRAM", pathlib.Path(malus.__file__).parents[2] / "malus"))
    if not program.exists():
        pytest.skip("needs the program beside the module")
    random = np.random.default_rng(13)
    model, raw = calibrated(random, READ_DN, READ_DN), camera(random, 100, READ_DN, READ_DN)
    model.save(tmp_path / "camera.h5")
    np.save(tmp_path / "raw.npy", raw)
    subprocess.run([program, "stokes", tmp_path / "raw.npy", "--model", tmp_path / "camera.h5", "--layout", "polar-mono", "--black", str(BLACK), "--white",
                    str(WHITE), "--gain", "0", "--format", "npy", "--no-pictures", "-o", tmp_path], check=True, capture_output=True)
    seen = malus.stokes(malus.Frame(raw, "polar-mono", black=BLACK, white=WHITE), model=model, gain=0)
    for name in ("s0", "s0_sd", "s1_sd", "dolp_sd"):
        assert np.array_equal(np.squeeze(np.load(tmp_path / f"raw_{name}.npy")), seen[name][0], equal_nan=True), name
