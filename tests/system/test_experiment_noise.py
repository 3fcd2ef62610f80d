"""`malus experiment noise`: kinds of noise models against a camera's own frames, gain by gain."""

import json

import numpy as np
import pytest
from PIL import Image

from conftest import BUILD
from test_noise_kinds import write_mono_session

pytestmark = pytest.mark.slow
NETWORKS = (BUILD / "malus_networks.so").exists()


@pytest.fixture
def picture(tmp_path):
    rows, cols = np.mgrid[0:160, 0:160]
    light = 120 + 60 * np.sin(cols / 27) + 40 * np.cos(rows / 31)
    path = tmp_path / "picture.png"
    Image.fromarray(np.clip(light[..., None] * (1, 0.9, 0.7), 0, 255).astype(np.uint8)).save(path)
    return path


def simulated(tmp_path, picture, *more):
    return ["experiment", "noise", "--model", "nikon-d850", "--pictures", picture, "--cases", "1600:4", "6400:4", "400:1",
            "-o", tmp_path / "captures", "--crop", 160, "--seed", 3, *more]


def test_kinds_of_a_simulated_camera(malus, tmp_path, picture):
    run = simulated(tmp_path, picture, "--json", "--report", tmp_path / "page.html")
    told = malus(*run).json
    assert [gain["gain"] for gain in told["gains"]] == ["ISO 400", "ISO 1600", "ISO 6400"]
    rows = {row["name"]: row["gains"] for row in told["rows"]}
    assert list(rows) == ["physics", "poisson-gaussian", "gaussian", "nonparametric"]
    for name in ("physics", "nonparametric"):
        for cell in rows[name]:
            # 25,600 samples; the floor is a mean: the JSD of n bins is a chi square, and half as much again is 5 deviations of
            # some 100 bins.
            assert 0.5 * cell["sqrt_jsd_floor"] < cell["sqrt_jsd"] < 1.25 * cell["sqrt_jsd_floor"], name
            assert cell["kld_floor"] == pytest.approx(4 * np.log(2) * cell["sqrt_jsd_floor"] ** 2)
    assert (tmp_path / "page.html").stat().st_size > 10000
    text = malus(*simulated(tmp_path, picture)).out
    assert text.startswith("| root of JSD (base 2) | ISO 400 | ISO 1600 | ISO 6400 |\n") and "| KLD [nats] |" in text
    assert text.count("| floor: two samples of one distribution |") == 2
    assert [row["name"] for row in malus(*simulated(tmp_path, picture, "--kinds", "gaussian,physics", "--json")).json["rows"]] == [
        "gaussian", "physics"]
    # Noise of another camera is told from it.
    other = malus(*simulated(tmp_path, picture, "--camera", "canon-5d4", "--kinds", "physics", "--json")).json["rows"][0]["gains"]
    assert all(cell["sqrt_jsd"] > 2 * cell["sqrt_jsd_floor"] for cell in other)


@pytest.mark.skipif(not NETWORKS, reason="built without networks (libtorch is missing)")
def test_a_flow_has_a_cell_where_it_knows_the_gain(malus, tmp_path, picture):
    malus(*simulated(tmp_path, picture, "-q"))
    short = next((tmp_path / "captures/case0").glob("*_short.tif"))
    reference = next((tmp_path / "captures/case0").glob("*_reference.npy"))
    (tmp_path / "list.json").write_text(json.dumps({"pairs": [{"name": "a_00", "short": str(short), "reference": str(reference),
                                                               "ratio": 4, "gain_db": None, "iso": 1600}]}))
    np.save(tmp_path / "clean.npy", np.load(reference) / 4)
    (tmp_path / "flow.toml").write_text(
        f'[network]\narchitecture = "noise-flow"\n[sensor]\nlayout = "bayer-rggb"\nblack = 800\nwhite = 16383\n[[pairs]]\n'
        f'noisy = "{short.relative_to(tmp_path)}"\nclean = "clean.npy"\niso = 1600\n[train]\nsteps = 40\ncouplings = 0\n')
    malus("train", tmp_path / "flow.toml", "-o", tmp_path / "flow")
    flow = tmp_path / "flow/weights.safetensors"
    done = malus(*simulated(tmp_path, picture, "--flow", flow, "--kinds", "physics", "--json"))
    cells = done.json["rows"][1]["gains"]
    assert done.json["rows"][1]["name"] == "Noise Flow" and cells[0] is None and cells[2] is None
    assert 0 < cells[1]["sqrt_jsd"] < 0.3
    assert "Noise Flow is not compared at ISO 400, ISO 6400: ISO 400: the flow was trained from ISO 1600 to ISO 1600" in done.err
    listed = malus("experiment", "noise", "--model", "nikon-d850", "--pairs", tmp_path / "list.json", "--flow", flow, "--seed", 3, "--json")
    assert [row["name"] for row in listed.json["rows"]] == ["physics", "poisson-gaussian", "Noise Flow"]


def test_what_a_reference_at_white_does_not_tell_is_no_noise(malus, tmp_path, picture):
    malus(*simulated(tmp_path, picture, "-q"))
    short = next((tmp_path / "captures/case0").glob("*_short.tif"))
    reference = np.load(next((tmp_path / "captures/case0").glob("*_reference.npy")))
    reference[:60] = 16383 - 800  # the scene is darker there
    np.save(tmp_path / "clipped.npy", reference)
    (tmp_path / "list.json").write_text(json.dumps({"pairs": [{"name": "a_00", "short": str(short), "reference": "clipped.npy", "ratio": 4,
                                                               "gain_db": None, "iso": 1600}]}))
    told = malus("experiment", "noise", "--model", "nikon-d850", "--pairs", tmp_path / "list.json", "--kinds", "physics", "--seed", 3, "--json")
    cell = told.json["rows"][0]["gains"][0]
    assert cell["sqrt_jsd"] < 1.4 * cell["sqrt_jsd_floor"]


def test_a_model_that_knows_none_of_the_gains_is_refused(refused, tmp_path, picture):
    run = simulated(tmp_path, picture, "--camera", "nikon-d850")
    run[run.index("--model") + 1] = "imx250myr-simulated"
    assert "names its gains in dB" in refused(*run)
    pairs = [{"name": f"{k}_00", "short": str(short), "reference": str(short).replace("_short.tif", "_reference.npy"), "ratio": 1,
              "gain_db": None, "iso": 25600} for k, short in enumerate(sorted((tmp_path / "captures/case0").glob("*_short.tif")))]
    (tmp_path / "list.json").write_text(json.dumps({"pairs": pairs}))
    line = refused("experiment", "noise", "--model", "nikon-d850", "--pairs", tmp_path / "list.json")
    assert "physics: can be drawn at none of the frames' gains (ISO 25600: " in line


def test_kinds_against_a_session(malus, tmp_path):
    session = write_mono_session(tmp_path)
    malus("calibrate", session("s.toml", "bias", "flat", "burst"), "--kind", "physics", "gaussian", "--level-samples", 4000, "-o",
          tmp_path / "model.h5")
    told = malus("experiment", "noise", "--model", tmp_path / "model.h5", "--session", session("held.toml", "bias", "flat"),
                 "--json").json
    assert told["gains"] == [{"gain": "0 dB", "frames": 9}]  # a dark set and eight flats
    rows = {row["name"]: row["gains"][0] for row in told["rows"]}
    assert list(rows) == ["physics", "poisson-gaussian", "gaussian"]
    for cell in rows.values():
        assert cell["sqrt_jsd"] < cell["sqrt_jsd_floor"] + 0.02


def test_what_is_compared_with_nothing_is_refused(malus, refused, tmp_path, picture):
    def usage(*arguments):
        told = malus(*base, *arguments, code=2).err
        assert told.endswith("Run with --help for usage.\n")
        return told

    base = ["experiment", "noise", "--model", "nikon-d850"]
    assert "one of --pairs, --session and --pictures is required" in usage()
    assert "--cases" in usage("--pictures", picture)
    assert "--pairs excludes --pictures" in usage("--pairs", "none.json", "--pictures", picture)
    assert "--camera requires --pictures" in usage("--pairs", "none.json", "--camera", "nikon-d850")
    assert '"400" is not GAIN:RATIO' in usage("--pictures", picture, "--cases", "400")
    (tmp_path / "none.json").write_text('{"pairs": []}')
    assert "holds no pairs" in refused(*base, "--pairs", tmp_path / "none.json")
    assert "--cases requires --pictures" in usage("--pairs", "none.json", "--cases", "400:1")
