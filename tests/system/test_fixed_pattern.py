"""A camera whose pixels differ in dark signal and response, from its frames to a denoised one."""

import numpy as np
import pytest
from PIL import Image

ROWS, COLS, BLACK, WHITE, K = 192, 240, 80, 4095, 0.25
DSNU_DN, PRNU, READ_DN = 3.0, 0.02, 1.5

_rng = np.random.default_rng(17)
DARK = _rng.normal(0, DSNU_DN, (ROWS, COLS))
RESPONSE = _rng.normal(1, PRNU, (ROWS, COLS))


def taken(rng, electrons, dark=DARK, response=RESPONSE):
    dn = BLACK + dark + K * rng.poisson(response * electrons) + rng.normal(0, READ_DN, (ROWS, COLS))
    return np.clip(np.round(dn), 0, WHITE).astype(np.uint16)


def scene():
    r, c = np.mgrid[:ROWS, :COLS]
    return 3000 + 1500 * np.sin(0.05 * r) * np.cos(0.03 * c)


@pytest.fixture(scope="module")
def camera(tmp_path_factory, malus):
    folder = tmp_path_factory.mktemp("camera")
    rng = np.random.default_rng(4)
    text = f'[sensor]\nlayout = "polar-bayer-rggb"\nblack = {BLACK}\nwhite = {WHITE}\nrow_group = 2\n'
    for level in range(8):
        for n in range(8 if level else 30):
            Image.fromarray(taken(rng, np.full((ROWS, COLS), 1500.0 * level))).save(folder / f"{level}_{n}.png")
        kind = "flat" if level else "bias"
        text += f'[[frames]]\nkind = "{kind}"\nexposure_s = {level / 100}\ngain_db = 0\npaths = ["{level}_*.png"]\n'
    (folder / "s.toml").write_text(text)
    Image.fromarray(taken(rng, scene())).save(folder / "raw.png")
    Image.fromarray(taken(rng, scene(), 0, 1)).save(folder / "plain.png")
    malus("calibrate", folder / "s.toml", "-o", folder / "m.h5")
    return folder


def denoised(malus, camera, name, folder, *flags):
    done = malus("denoise", camera / name, "--model", camera / "m.h5", "--gain", 0, "--format", "npy", "--json", "-o", folder, *flags)
    dn = np.load(folder / name.replace(".png", "_denoised.npy")).reshape(ROWS, COLS)
    return done.json, float(np.sqrt(np.mean((dn - K * scene()) ** 2)))


def test_the_models_maps_are_taken_out(malus, camera, tmp_path):
    run, error = denoised(malus, camera, "raw.png", tmp_path / "with")
    assert 0.8 < run["dark_pattern_share"] < 1.1 and 0.8 < run["response_pattern_share"] < 1.1
    run, without = denoised(malus, camera, "raw.png", tmp_path / "without", "--no-fixed-pattern")
    assert run["dark_pattern_share"] == run["response_pattern_share"] == 0
    assert error < 0.6 * without


def test_a_frame_without_the_pattern_is_left_alone(malus, camera, tmp_path):
    run, error = denoised(malus, camera, "plain.png", tmp_path / "with")
    assert run["dark_pattern_share"] == run["response_pattern_share"] == 0
    _, without = denoised(malus, camera, "plain.png", tmp_path / "without", "--no-fixed-pattern")
    assert error == without


def test_the_program_says_what_it_took_out(malus, camera, tmp_path):
    done = malus("denoise", camera / "raw.png", "--model", camera / "m.h5", "--gain", 0, "-o", tmp_path / "out")
    assert "of the model's dark shading taken out" in done.out
    assert "of the model's PRNU taken out" in done.out


def test_of_a_part_of_unknown_place_the_pattern_is_noise(malus, camera, tmp_path):
    """2 % of 3000 electrons double the shot noise's variance, the dark pixels add a quarter more; taken for light they stayed in."""
    part, (rows, cols) = tmp_path / "part.png", (slice(60, 188), slice(40, 168))
    Image.open(camera / "raw.png").crop((40, 60, 168, 188)).save(part)
    error = {}
    for flags in ((), ("--no-fixed-pattern",)):
        malus("denoise", part, "--model", camera / "m.h5", "--gain", 0, "--format", "npy", "--force", "-o", tmp_path, *flags)
        dn = np.load(tmp_path / "part_denoised.npy").reshape(128, 128)
        error[flags] = float(np.sqrt(np.mean((dn - K * scene()[rows, cols]) ** 2)))
    assert error[()] < 0.7 * error[("--no-fixed-pattern",)]


def test_a_part_of_the_sensor_has_its_part_of_the_maps(malus, camera, tmp_path):
    Image.open(camera / "raw.png").crop((40, 60, 168, 188)).save(tmp_path / "part.png")
    run = ("denoise", tmp_path / "part.png", "--model", camera / "m.h5", "--gain", 0, "--json", "--force", "-o", tmp_path / "out")
    left = malus(*run)
    assert left.json["dark_pattern_share"] == left.json["response_pattern_share"] == 0
    assert "maps of the fixed pattern are left out" in left.err
    told = malus(*run, "--origin", "60,40")
    # 16384 pixels, shot noise of 14 DN about a dark pattern of 3: 1 ± 0.045, four deviations either way.
    assert 0.8 < told.json["dark_pattern_share"] < 1.2 and 0.8 < told.json["response_pattern_share"] < 1.2
    assert "left out" not in told.err
