"""What a report says of the run behind it: its warnings, its conditions, how well the model fits; and folders of runs."""

import json
import math
import re
import shutil

import numpy as np
import pytest

from test_report import page_data, record

BLACK, WHITE = 100, 4095


def blocks_of(page, kind, section=None):
    return [block for s in page["sections"] if section in (None, s["id"]) for block in s["blocks"] if block["kind"] == kind]


def notices_of(page):
    return [(item["level"], item["text"]) for block in blocks_of(page, "notices") for item in block["items"]]


def warnings_of(page):
    return [text for level, text in notices_of(page) if level == "warning"]


def said(result):
    return [line.removeprefix("warning: ") for line in result.err.splitlines() if line.startswith("warning: ")]


def charts_of(page, title):
    return [entry["chart"] for block in blocks_of(page, "charts") for entry in block["charts"] if entry["chart"]["title"].startswith(title)]


K, READ_DN, RATE_E_PER_S, SIDE = 0.5, 2.0, 400000.0, 128
WELL_E, LONG_E = 3300, [500 * (i + 1) for i in range(8)]
EXPOSURES_S = [0.001 * (i + 1) for i in range(12)]  # up to 2400 DN above black, 60 % of the range


@pytest.fixture(scope="module")
def session(tmp_path_factory):
    """A linear camera of known K and read noise, one channel, whose gain is not told."""
    folder = tmp_path_factory.mktemp("camera")
    rng = np.random.default_rng(11)

    def save(name, electrons):
        dn = BLACK + K * rng.poisson(electrons, (SIDE, SIDE)) + rng.normal(0, READ_DN, (SIDE, SIDE))
        np.save(folder / name, np.clip(np.round(dn), 0, WHITE).astype(np.uint16))

    for n in range(24):
        save(f"bias_{n:02}.npy", 0)
    frames = '[[frames]]\nkind = "bias"\npaths = ["bias_*.npy"]\n'
    for i, exposure_s in enumerate(EXPOSURES_S):
        for n in range(2):
            save(f"flat_{i:02}_{n}.npy", RATE_E_PER_S * exposure_s)
        frames += f'[[frames]]\nkind = "flat"\nexposure_s = {exposure_s:.6g}\npaths = ["flat_{i:02}_*.npy"]\n'
    known = f'[sensor]\nlayout = "mono"\nblack = {BLACK}\nwhite = {WHITE}\nrow_group = 1\n'
    (folder / "session.toml").write_text(known + frames)
    (folder / "untold.toml").write_text('[sensor]\nlayout = "mono"\nrow_group = 1\n' + frames)
    return folder


@pytest.fixture(scope="module")
def calibrated(malus, session):
    """The page of `calibrate --report`, and what the command printed."""
    run = malus("calibrate", session / "session.toml", "-o", session / "m.h5", "--report", session / "m.html")
    return page_data(session / "m.html"), run


@pytest.fixture(scope="module")
def untold(malus, session):
    run = malus("calibrate", session / "untold.toml", "-o", session / "u.h5", "--report", session / "u.html")
    malus("report", session / "u.h5", "-o", session / "later.html")
    return run, page_data(session / "u.html"), page_data(session / "later.html")


def test_warnings_of_a_calibration_stand_in_its_page_and_in_its_model(malus, session, untold):
    run, page, later = untold
    assert any("black level is not given" in line for line in said(run))
    assert any("white level is not given" in line for line in said(run))
    for shown in (page, later):
        assert set(said(run)) <= set(warnings_of(shown))
        assert not any(level == "good" for level, _ in notices_of(shown))
    shown = malus("model", "show", session / "u.h5", "--json").json
    assert set(said(run)) == set(shown["warnings"] + shown["gains"][0]["warnings"])
    assert len(shown["warnings"]) == 3  # of black, white and the gain, which no gain has to itself
    assert "black level is not given" in malus("model", "show", session / "u.h5").out


def test_nothing_to_warn_about_is_said_where_that_is_so(calibrated):
    page, run = calibrated
    assert said(run) == [] and warnings_of(page) == []
    assert [text for level, text in notices_of(page) if level == "good"] == ["The calibration has nothing to warn about."]


@pytest.mark.parametrize("model, words", [("imx250myr-simulated", "Invented to be plausible, measured on no camera"),
                                          ("sony-a7s2", "published or computed")])
def test_a_model_without_frames_is_never_good(malus, tmp_path, model, words):
    malus("report", model, "-o", tmp_path / "page.html")
    notices = notices_of(page_data(tmp_path / "page.html"))
    assert not any(level == "good" for level, _ in notices)
    assert any(words in text for _, text in notices)
    assert (notices[0][0] == "warning") == model.endswith("-simulated")


def test_a_calibration_says_what_it_was_measured_from(malus, session, calibrated):
    page, _ = calibrated
    assert page["subtitle"] == ("mono, 1 channel, 24 bias frames, 12 flat levels of 1 to 12 ms, levels used up to 70 % of the range")
    assert page["sections"][0]["lead"] == "mono, one gain, from session.toml"
    tiles = blocks_of(page, "figures")[0]["items"]
    assert {tile["note"] for tile in tiles} == {"camera gain not told"}
    assert "unknown gain" not in json.dumps(page["sections"][0])
    malus("calibrate", session / "session.toml", "-o", session / "half.h5", "--saturation-limit", 0.5)
    malus("report", session / "half.h5", "-o", session / "half.html")
    assert "up to 50 % of the range" in page_data(session / "half.html")["subtitle"]


def test_signal_to_noise_is_that_of_shot_and_read_noise(calibrated):
    page, _ = calibrated
    (chart,) = charts_of(page, "Signal to noise")
    points = next(s for s in chart["series"] if s["mark"] == "points")
    line = next(s for s in chart["series"] if s["mark"] == "line")
    dashed = next(s for s in chart["series"] if s["mark"] == "dashed")
    dark_e2 = (READ_DN**2 + 1 / 12) / K**2
    assert len(points["x"]) == len(EXPOSURES_S)
    for x, y, exposure_s in zip(points["x"], points["y"], EXPOSURES_S):
        electrons = RATE_E_PER_S * exposure_s
        # A variance of 2^14 differences is known to √(2 / 2^14) = 1.1 %, K to less; five deviations.
        assert x == pytest.approx(electrons, rel=0.03)
        assert y == pytest.approx(electrons / math.sqrt(electrons + dark_e2), rel=0.03)
    for x, y in zip(line["x"], line["y"]):
        assert y == pytest.approx(x / math.sqrt(x + dark_e2), rel=0.02)
    assert dashed["y"] == pytest.approx([math.sqrt(x) for x in dashed["x"]])


@pytest.fixture(scope="module")
def long_exposures(malus, tmp_path_factory):
    """Four channels, dark current as strong as the light, dark sets, a full well for the light of the two brightest levels; the
    level of every frame is off by 1 DN. The page, and the model."""
    folder = tmp_path_factory.mktemp("long")
    rng = np.random.default_rng(5)

    def save(name, light_e, dark_e):
        electrons = np.minimum(rng.poisson(light_e, (64, 64)), WELL_E) + rng.poisson(dark_e, (64, 64))
        dn = BLACK + K * electrons + rng.normal(0, READ_DN, (64, 64)) + rng.normal()
        np.save(folder / name, np.clip(np.round(dn), 0, WHITE).astype(np.uint16))

    sensor = f'[sensor]\nlayout = "bayer-rggb"\nblack = {BLACK}\nwhite = {WHITE}\nrow_group = 1\n'
    frames = '[[frames]]\nkind = "bias"\nexposure_s = 1e-4\npaths = ["bias_*.npy"]\n'
    for n in range(12):
        save(f"bias_{n:02}.npy", 0, 0)
    for i, electrons in enumerate(LONG_E):
        for kind, light_e in (("flat", electrons), ("dark", 0)):
            for n in range(4):
                save(f"{kind}_{i}_{n}.npy", light_e, electrons)
            frames += f'[[frames]]\nkind = "{"bias" if kind == "dark" else kind}"\nexposure_s = {i + 1}\npaths = ["{kind}_{i}_*.npy"]\n'
    (folder / "session.toml").write_text(sensor + frames)
    malus("calibrate", folder / "session.toml", "-o", folder / "m.h5", "--report", folder / "m.html")
    return page_data(folder / "m.html"), malus("model", "show", folder / "m.h5", "--json").json


def test_signal_to_noise_has_the_noise_of_dark_current(long_exposures):
    """The points were up to 42 % too high: those of the bias frames' noise."""
    page, _ = long_exposures
    (chart,) = charts_of(page, "Signal to noise")
    points = next(s for s in chart["series"] if s["mark"] == "points")
    assert len(points["x"]) == sum(electrons < WELL_E for electrons in LONG_E)
    for y, electrons in zip(points["y"], LONG_E):
        # The ratio of four frames of 1024 pixels is known to √(2 / 3072) / 2 = 1.3 %; five deviations.
        assert y == pytest.approx(electrons / math.sqrt(2 * electrons + (READ_DN / K) ** 2), rel=0.065)


def test_what_channels_share_does_not_average_out(long_exposures):
    page, model = long_exposures
    sheet = next(b for b in blocks_of(page, "table") if b["title"] == "Data sheet")
    (cell,) = next(row["cells"] for row in sheet["rows"] if row["name"].startswith("dark signal above black"))
    errors = model["gains"][0]["mu"]["stderr"]
    assert cell["error"] == pytest.approx(sum(errors) / len(errors), rel=0.01) and min(errors) > 0.1
    (K_cell,) = next(row["cells"] for row in sheet["rows"] if "K" in row["name"])
    errors = model["gains"][0]["K"]["stderr"]
    assert K_cell["error"] == pytest.approx(math.hypot(*errors) / len(errors), rel=0.01)


def test_where_saturation_counts_to_is_said(calibrated, long_exposures):
    notes = [next(b["note"] for b in blocks_of(page, "table") if b["title"] == "Data sheet") for page, _ in (calibrated, long_exposures)]
    assert "Saturation is the white level's" in notes[0] and "where the temporal noise is largest" in notes[1]


def test_linearity_is_drawn_against_the_exposure(calibrated):
    page, _ = calibrated
    chart, deviation = charts_of(page, "Linearity")
    points = next(s for s in chart["series"] if s["mark"] == "points")
    line = next(s for s in chart["series"] if s["mark"] == "line")
    assert points["x"] == pytest.approx(EXPOSURES_S)
    slope = (line["y"][1] - line["y"][0]) / (line["x"][1] - line["x"][0])
    assert slope == pytest.approx(K * RATE_E_PER_S, rel=0.002)
    assert all(abs(y) < 0.3 for y in deviation["series"][0]["y"])  # %
    sheet = next(b for b in blocks_of(page, "table") if b["title"] == "Data sheet")
    (error,) = [row["cells"][0]["value"] for row in sheet["rows"] if row["name"].startswith("linearity error")]
    assert error == pytest.approx(np.mean(np.abs(deviation["series"][0]["y"])), rel=1e-9)


def test_residuals_say_how_well_the_line_fits(calibrated):
    page, _ = calibrated
    (chart,) = charts_of(page, "Photon transfer, residuals")
    chi_square, freedom = re.search(r"χ² = ([\d.]+) with (\d+) degrees of freedom", chart["text"]).groups()
    assert int(freedom) == len(EXPOSURES_S) - 1
    # The 0.01 and 99.99 % points of chi square with 11 degrees of freedom.
    assert 1.2 < float(chi_square) < 37.4
    drawn = chart["series"][0]
    assert float(chi_square) == pytest.approx(sum((y / e) ** 2 for y, e in zip(drawn["y"], drawn["error"])), rel=1e-3)


def test_right_noise_of_less_than_a_step_lies_on_the_line_of_its_probability_plot(malus, tmp_path):
    """Residuals are of rounded pixels: set beside the bare law they looked up to 20 % too wide at three deviations."""
    rng = np.random.default_rng(5)
    pattern = rng.normal(BLACK, 0.4, (96, 96))

    def save(name, electrons):
        dn = pattern + K * rng.poisson(electrons, pattern.shape) + rng.normal(0, 0.45, pattern.shape)
        np.save(tmp_path / name, np.clip(np.round(dn), 0, WHITE).astype(np.uint16))

    frames = '[[frames]]\nkind = "bias"\npaths = ["bias_*.npy"]\n'
    for n in range(16):
        save(f"bias_{n:02}.npy", 0)
    for level in (500, 1500, 3000):
        for n in range(2):
            save(f"flat_{level}_{n}.npy", level)
        frames += f'[[frames]]\nkind = "flat"\npaths = ["flat_{level}_*.npy"]\n'
    (tmp_path / "session.toml").write_text(f'[sensor]\nlayout = "mono"\nblack = {BLACK}\nwhite = {WHITE}\nrow_group = 1\n' + frames)
    malus("calibrate", tmp_path / "session.toml", "-o", tmp_path / "m.h5", "--report", tmp_path / "m.html")
    page = page_data(tmp_path / "m.html")
    (plot,) = charts_of(page, "Probability plot")
    for series in plot["series"][:2]:  # the noise is normal: both laws hold
        x, y = (np.array(series[axis]) for axis in "xy")
        seen = (np.abs(y) > 0.6) & (np.abs(y) < 1.8)  # one to three deviations
        assert seen.sum() > 10 and np.abs(y[seen] / x[seen] - 1).max() < 0.05, (series["name"], y[seen] / x[seen])
    (density,) = charts_of(page, "Read noise of")
    bars, *laws = density["series"]
    for law in laws:
        x, y = (np.array(law[axis], float) for axis in "xy")
        for at, height in zip(bars["x"], bars["y"]):
            if abs(at) < 1.5:
                assert np.interp(at, x, y) == pytest.approx(height, rel=0.1), (law["name"], at)


def test_the_read_noise_has_its_error_wherever_it_is_shown(malus, session, calibrated):
    page, _ = calibrated
    noise = malus("model", "show", session / "m.h5", "--json").json["gains"][0]["read_noise"]
    tile = next(item for item in blocks_of(page, "figures")[0]["items"] if item["symbol"] == "σ_read")
    assert noise["stderr"] == [tile["error"]] and noise["value"] == [tile["value"]]
    assert abs(noise["value"][0] - READ_DN / K) < 5 * noise["stderr"][0]
    shown = malus("model", "show", session / "m.h5").out
    value, error = next((v, e) for v, e in re.findall(r"([\d.]+)±([\d.]+)", shown) if abs(float(v) - noise["value"][0]) < 0.005)
    assert float(error) == pytest.approx(noise["stderr"][0], rel=0.35)  # one digit, two where it begins with 1
    assert len(value.split(".")[1]) == len(error.split(".")[1])
    table = shown.splitlines()[next(i for i, line in enumerate(shown.splitlines()) if "sigma_TL" in line):][:3]
    assert max(map(len, table)) <= 100 and "±" in table[2]
    few = malus("model", "show", "imx250myr-simulated", "--json").json["gains"][0]["read_noise"]
    assert few["stderr"] is None


def test_warnings_of_a_denoise_run_stand_in_its_page_and_in_its_record(malus, session, tmp_path):
    rng = np.random.default_rng(12)
    dn = rng.normal(600, 12, (96, 96))
    dn[:8, :40] = 2**16 - 1  # 3.5 % saturated; white is not told
    for name in ("a", "b"):
        np.save(tmp_path / f"{name}.npy", np.round(dn).astype(np.uint16))
    run = malus("denoise", tmp_path / "a.npy", tmp_path / "b.npy", "--layout", "mono", "--profile", "fast", "-o", tmp_path / "out",
                "--report", tmp_path / "now.html", "--json")
    records = [json.loads((tmp_path / f"out/{name}_denoised.json").read_text()) for name in ("a", "b")]
    for name, line, frame in zip(("a", "b"), records, run.json["frames"]):
        assert line["run"]["warnings"] == frame["warnings"]
        for words in ("black level not known", "white level not known", "are saturated", "a calibrated model (--model) is better"):
            assert sum(words in warning for warning in frame["warnings"]) == 1, (words, frame["warnings"])
        assert all(f"{name}.npy" in warning for warning in frame["warnings"])
    advice = [line for line in run.err.splitlines() if "a calibrated model (--model) is better" in line]
    assert len(advice) == 2 and advice[1].startswith("warning: also of 1 more file: ")
    now = page_data(tmp_path / "now.html")
    for i, frame in enumerate(run.json["frames"]):
        shown = [item["text"] for block in now["sections"][i]["blocks"] if block["kind"] == "notices" for item in block["items"]]
        assert shown == frame["warnings"]
    malus("report", tmp_path / "out/a_denoised.json", "-o", tmp_path / "later.html")
    assert warnings_of(page_data(tmp_path / "later.html")) == run.json["frames"][0]["warnings"]
    settings = next(b for b in blocks_of(page_data(tmp_path / "later.html"), "table") if b["title"] == "What was done")
    assert not any("warning" in row["name"] for row in settings["rows"])


def test_warnings_of_an_evaluation_stand_in_its_page(malus, tmp_path):
    clean = np.random.default_rng(13).uniform(100, 900, (32, 32)).astype(np.float32)
    np.save(tmp_path / "clean.npy", clean)
    np.save(tmp_path / "test.npy", clean + 5)
    run = malus("evaluate", "--reference", tmp_path / "clean.npy", "--test", tmp_path / "test.npy", "--layout", "mono", "--json",
                "--report", tmp_path / "now.html")
    assert "taken as the peak" in said(run)[0] and run.json["warnings"] == said(run)
    (tmp_path / "e.json").write_text(run.out)
    malus("report", tmp_path / "e.json", "-o", tmp_path / "later.html")
    for name in ("now", "later"):
        assert warnings_of(page_data(tmp_path / f"{name}.html")) == said(run)
    assert page_data(tmp_path / "now.html")["subtitle"].endswith("clean.npy")


def test_a_page_made_later_has_the_confidence_maps(malus, tmp_path):
    np.save(tmp_path / "a.npy", np.random.default_rng(3).normal(400, 9, (64, 64)).round().astype(np.uint16))
    malus("denoise", tmp_path / "a.npy", "--model", "imx250mzr-simulated", "--gain", 12, "--profile", "fast", "--uncertainty",
          "-o", tmp_path / "out", "--report", tmp_path / "now.html")
    later = ("report", tmp_path / "out/a_denoised.json", "--force", "-o", tmp_path / "later.html")
    malus(*later)
    layers = [[layer["name"] for block in blocks_of(page_data(tmp_path / f"{name}.html"), "pictures") for layer in block["layers"]]
              for name in ("now", "later")]
    assert layers[0] == layers[1] and len(layers[0]) == 2
    (tmp_path / "out/a_variance.exr").unlink()  # not needed for the rest
    malus(*later)


def test_a_folder_leaves_out_what_cannot_be_shown(malus, refused, session, tmp_path):
    folder = tmp_path / "runs"
    folder.mkdir()
    record(folder)
    broken = json.loads((folder / "record.json").read_text())
    broken["pictures"][0]["files"][0]["file"] = "gone.npy"
    (folder / "broken.json").write_text(json.dumps(broken))
    run = malus("report", folder, "-o", tmp_path / "page.html")
    assert len(said(run)) == 1 and "broken.json" in run.err and "gone.npy" in run.err
    page = page_data(tmp_path / "page.html")
    assert page["title"] == "Report of 1 file"
    assert [section["title"] for section in page["sections"]] == ["Training of a small network, record.json", "Left out"]
    assert "gone.npy" in warnings_of(page)[0]
    # Named, or with nothing beside it, it is an error.
    assert "gone.npy" in refused("report", folder / "broken.json", "-o", tmp_path / "page2.html")
    (folder / "record.json").unlink()
    assert "gone.npy" in refused("report", folder, "-o", tmp_path / "page2.html")


def test_the_folder_of_a_training_is_told_how_its_page_is_made(refused, tmp_path):
    (tmp_path / "weights.safetensors").write_bytes(b"")
    assert "malus train CONFIG --resume --report FILE" in refused("report", tmp_path, "-o", tmp_path / "page.html")


def test_an_experiment_says_its_title_once_and_its_conditions_in_words(malus, tmp_path):
    from PIL import Image

    rows, cols = np.mgrid[0:64, 0:64]
    for name in ("lake", "wood"):
        (tmp_path / name).mkdir()
        for k, angle in enumerate((0, 45, 90, 135)):
            light = 110 + 40 * np.sin(cols / 9) + 30 * np.cos(rows / 7 + k)
            Image.fromarray(np.repeat(light[..., None], 3, 2).astype(np.uint8)).save(tmp_path / name / f"I{angle}.png")
    run = malus("experiment", "denoise", tmp_path / "lake", f"{tmp_path}/wood/", "--methods", "bm3d/fast", "--cases", "12:10", "12:60",
                "24:1", "--crop", 32, "--report", tmp_path / "page.html")
    text = (tmp_path / "page.html").read_text(encoding="utf-8")
    page = page_data(tmp_path / "page.html")
    assert text.count("Experiment: denoising methods") == 1 and page["sections"][0]["title"] == "Results"
    table, *of_cases = blocks_of(page, "table")
    titles = " / ".join(block["title"] for block in of_cases)
    assert len(of_cases) == 3 and all(words in titles for words in ("12 dB at 1/10", "12 dB at 1/60", "24 dB at all of the light")), titles
    for words in ("12 dB at 1/10 and 1/60 of the light", "24 dB at all of the light", "lake, wood", "32 x 32"):
        assert words in table["note"], table["note"]
    assert "[" not in table["note"]
    seconds = [row["cells"][-1]["value"] for row in table["rows"]]
    assert seconds[0] is None and seconds[1] > 0
    assert re.search(r"\| noisy \|.*\| - \|$", run.out, re.M)


def test_names_of_figures_are_plain_and_say_the_gain_once(malus, tmp_path):
    malus("report", "imx250myr-simulated", "--figures", tmp_path / "figures")
    names = sorted(path.name for path in (tmp_path / "figures").iterdir())
    assert "correlation_Correlation_of_mu_between_channels_at_0_dB.svg" in names
    assert any("sigma_b" in name for name in names)
    assert not [name for name in names if not name.isascii() or name.count("_dB") > 1]
    assert len(names) == len(set(names))
    shutil.rmtree(tmp_path / "figures")
