"""A camera with a hot and a stuck pixel, from its frames to a denoised one."""

import h5py
import numpy as np
import pytest
from PIL import Image

ROWS, COLS, BLACK, WHITE, K = 96, 120, 80, 4095, 0.5
HOT, STUCK = (41, 50), (60, 71)


def taken(rng, electrons, hot=(HOT,)):
    dn = BLACK + K * rng.poisson(electrons) + rng.normal(0, 1.5, (ROWS, COLS))
    for place in hot:
        dn[place] += 300
    dn[STUCK] = WHITE
    return np.clip(np.round(dn), 0, WHITE).astype(np.uint16)


def record(folder, hot=(HOT,)):
    rng = np.random.default_rng(3)
    text = f'[sensor]\nlayout = "polar-bayer-rggb"\nblack = {BLACK}\nwhite = {WHITE}\nrow_group = 2\n'
    for level in range(7):
        for n in range(4 if level else 20):
            Image.fromarray(taken(rng, np.full((ROWS, COLS), 700.0 * level), hot)).save(folder / f"{level}_{n}.png")
        kind = "flat" if level else "bias"
        text += f'[[frames]]\nkind = "{kind}"\nexposure_s = {level / 100}\ngain_db = 0\npaths = ["{level}_*.png"]\n'
    (folder / "s.toml").write_text(text)
    Image.fromarray(taken(rng, np.full((ROWS, COLS), 400.0), hot)).save(folder / "raw.png")
    return folder


@pytest.fixture(scope="module")
def camera(tmp_path_factory):
    return record(tmp_path_factory.mktemp("camera"))


def test_defects_of_the_model_are_filled(malus, camera, tmp_path):
    malus("calibrate", camera / "s.toml", "-o", tmp_path / "m.h5")
    with h5py.File(tmp_path / "m.h5") as model:
        listed = set(zip(model["defects/row"][:].tolist(), model["defects/col"][:].tolist()))
        assert np.isfinite(model["physics/000/K/mean"][:]).all()  # the stuck pixel did not cost it
    assert listed == {HOT, STUCK}
    run = ("denoise", camera / "raw.png", "--model", tmp_path / "m.h5", "--gain", 0, "--format", "npy", "--json")
    assert malus(*run, "-o", tmp_path / "out").json["defect_pixels"] == 2
    dn = np.load(tmp_path / "out" / "raw_denoised.npy").reshape(ROWS, COLS)
    assert abs(dn - 200).max() < 20
    assert malus(*run, "--no-defects", "-o", tmp_path / "left").json["defect_pixels"] == 0
    left = np.load(tmp_path / "left" / "raw_denoised.npy").reshape(ROWS, COLS)
    assert left[HOT] > 300 and left[STUCK] > 4000


def test_a_crop_of_the_sensor_says_where_it_lies(malus, refused, camera, tmp_path):
    malus("calibrate", camera / "s.toml", "-o", tmp_path / "m.h5")
    Image.open(camera / "raw.png").crop((20, 12, 100, 92)).save(tmp_path / "crop.png")
    run = ("denoise", tmp_path / "crop.png", "--model", tmp_path / "m.h5", "--gain", 0, "--format", "npy", "--json", "--force", "-q",
           "-o", tmp_path / "out")
    done = malus(*run)
    assert done.json["defect_pixels"] == 0
    assert "80 x 80 pixels of a sensor of 120 x 96: the model's 2 defect pixels" in done.err and "--origin" in done.err
    assert "--origin" not in malus(*run, "--no-defects", "--no-fixed-pattern").err
    done = malus(*run, "--origin", "12,20")
    assert done.json["defect_pixels"] == 2 and done.json["origin_row_col"] == [12, 20] and "--origin" not in done.err
    assert abs(np.load(tmp_path / "out" / "crop_denoised.npy").reshape(80, 80) - 200).max() < 20
    assert "row 13, column 20 of the sensor, where it begins, is not a multiple of 4 rows and 4 columns" in refused(*run, "--origin", "13,20")
    assert "reach beyond the model's sensor of 120 x 96" in refused(*run, "--origin", "20,20")


def test_captures_are_scored_without_defects_in_the_middle_too(malus, camera, tmp_path):
    """What the model knows of pixels lies at the same places of the middle that an experiment scores."""
    malus("calibrate", camera / "s.toml", "-o", tmp_path / "m.h5")
    raw = np.array(Image.open(camera / "raw.png"))
    light = np.full((ROWS, COLS), 2000, np.float32)
    light[HOT], light[STUCK] = 2300, 3900
    np.save(tmp_path / "reference.npy", light)

    def scored(short, reference, *flags):
        Image.fromarray(short).save(tmp_path / "short.png")
        np.save(tmp_path / "reference.npy", reference)
        (tmp_path / "pairs.json").write_text('{"pairs": [{"name": "a_00", "short": "short.png", "reference": "reference.npy", '
                                             '"ratio": 10, "gain_db": 0, "iso": null}]}')
        return malus("experiment", "denoise", "--test-pairs", tmp_path / "pairs.json", "--model", tmp_path / "m.h5", "--methods",
                     "bm3d/fast", "--json", *flags)

    top, left, side = 16, 28, 64
    middle = (slice(top, top + side), slice(left, left + side))
    known = light.copy()
    known[HOT] = known[STUCK] = np.nan
    Image.fromarray(raw[middle]).save(tmp_path / "middle.png")
    malus("denoise", tmp_path / "middle.png", "--model", tmp_path / "m.h5", "--gain", 0, "--origin", f"{top},{left}", "--method", "bm3d",
          "--profile", "fast", "--format", "npy", "-o", tmp_path)
    result = np.load(tmp_path / "middle_denoised.npy").reshape(side, side)
    squares = ((result * 10 - known[middle]) / (WHITE - BLACK)) ** 2
    done = scored(raw, light, "--crop", side)
    assert done.json["methods"][1]["image_psnr_db"] == pytest.approx(-10 * np.log10(np.nanmean(squares)), rel=1e-4)
    assert done.json["captures"][0]["unknown_share"] == pytest.approx(2 / (ROWS * COLS))
    assert "left out" not in done.err
    # Frames of a part of the sensor: the places are not known, and that is said without a flag that is not there.
    part = scored(raw[:80], light[:80])
    assert "120 x 80 pixels are another size than that of the model's sensor" in part.err and "--origin" not in part.err
    assert part.json["captures"][0]["unknown_share"] == 0


def test_a_list_of_many_defects_is_doubted(malus, tmp_path):
    hot = [(r, c) for r in range(3, ROWS, 8) for c in range(2, COLS, 7)]
    camera = record(tmp_path, hot)
    said = malus("calibrate", camera / "s.toml", "-o", tmp_path / "m.h5", "--json").err
    assert f"{len(hot) + 1} pixels, 1.8 % of the sensor, are listed as defects" in said
    done = malus("denoise", camera / "raw.png", "--model", tmp_path / "m.h5", "--gain", 0, "-o", tmp_path / "out")
    assert f"{len(hot) + 1} pixels, 1.8 % of the frame, are defects by the model's list" in done.err
