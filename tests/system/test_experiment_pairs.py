"""`malus experiment --test-pairs`: scores on captured frames against their references, and the same worked out in NumPy."""

import json
import shutil

import numpy as np
import pytest
from PIL import Image

from conftest import ROOT, needs_networks
from captured_session import BLACK, CAMERA, SIDE, WHITE, capture

RANGE = WHITE - BLACK
METHOD = "bm3d/fast"


@pytest.fixture(scope="module")
def session(malus, tmp_path_factory):
    folder = tmp_path_factory.mktemp("captured")
    file, scenes = capture(malus, folder / "session")
    malus("pairs", file, "--model", CAMERA, "-o", folder / "pairs", "-q")
    malus("pairs", file, "-o", folder / "biased", "-q")
    return folder, scenes


@pytest.fixture
def pairs(session, tmp_path):
    """A copy of the pairs that may be spoiled."""
    shutil.copytree(session[0] / "pairs", tmp_path / "pairs")
    return tmp_path / "pairs"


def biases(malus, gain):
    """Mean bias of the camera's channels at a gain, as a mosaic."""
    gains = malus("model", "show", CAMERA, "--json").json["gains"]
    (mu,) = [entry["mu"]["mean"] for entry in gains if entry["gain_db"] == gain]
    return np.tile(np.reshape(mu, (4, 4)), (SIDE // 4, SIDE // 4))


def decibel(squares):
    return -10 * np.log10(np.mean(squares[np.isfinite(squares)]))


def ssim(a, b, peak):
    """Wang et al. 2004 with their window; windows with a pixel that is no number are left out."""
    tap = np.exp(-np.arange(-5, 6) ** 2 / (2 * 1.5 ** 2))
    window = np.outer(tap, tap) / tap.sum() ** 2
    x, y = (np.lib.stride_tricks.sliding_window_view(v.astype(float), (11, 11)) for v in (a, b))
    mean = lambda v: (v * window).sum((2, 3))
    mx, my = mean(x), mean(y)
    vx, vy, cov = mean(x * x) - mx ** 2, mean(y * y) - my ** 2, mean(x * y) - mx * my
    c1, c2 = (0.01 * peak) ** 2, (0.03 * peak) ** 2
    index = (2 * mx * my + c1) * (2 * cov + c2) / ((mx ** 2 + my ** 2 + c1) * (vx + vy + c2))
    return np.nanmean(index)


def stokes(mosaic):
    """S0, S1, S2 of the four colours: 2x2 blocks of 90, 45; 135, 0 degrees."""
    i90, i45, i135, i0 = (mosaic[r::2, c::2] for r, c in ((0, 0), (0, 1), (1, 0), (1, 1)))
    return (i0 + i45 + i90 + i135) / 2, i0 - i90, i45 - i135


def scores(reference, test):
    """The metrics of `experiment denoise` of two mosaics."""
    (r0, r1, r2), (t0, t1, t2) = stokes(reference), stokes(test)
    known = np.isfinite(r0) & (r0 > 0)
    dolp = lambda s0, s1, s2: np.clip(np.hypot(s1, s2) / np.where(s0 > 0, s0, np.inf), 0, 1)
    aolp = lambda s1, s2: np.degrees(np.arctan2(s2, s1)) / 2
    weight = dolp(r0, r1, r2)[known]
    off = np.abs(aolp(t1, t2) - aolp(r1, r2))[known]
    off = np.minimum(off, 180 - off)
    planes = [(reference[r::4, c::4], test[r::4, c::4]) for r in range(4) for c in range(4)]
    return {"image_psnr_db": decibel(((reference - test) / RANGE) ** 2),
            "image_ssim": np.mean([ssim(a, b, RANGE) for a, b in planes]),
            "dolp_psnr_db": decibel(((dolp(t0, t1, t2) - dolp(r0, r1, r2))[known]) ** 2),
            "aolp_circular_deg": np.sqrt((weight * off ** 2).sum() / weight.sum())}


def read(path):
    return np.array(Image.open(path)).astype(float)


def expected(malus, folder, tmp_path, held_bias=0):
    """[(case, noisy, denoised)] of the list's pairs, from their files and what `malus denoise` makes of the short frames."""
    rows = []
    for pair in json.loads((folder / "pairs.json").read_text())["pairs"]:
        reference = read(folder / pair["reference"])
        reference[reference >= 0.98 * RANGE] = np.nan
        reference -= held_bias
        short, gain = folder / pair["short"], pair["gain_db"]
        (result,) = [name for name in malus("denoise", short, "--model", CAMERA, "--method", "bm3d", "--profile", "fast",
                                            "-o", tmp_path / "denoised", "--force", "--json").json["files"] if name.endswith("_denoised.tif")]
        noisy = read(short) - BLACK - biases(malus, gain)
        rows.append(("%g:%g" % (gain, float("%.3g" % pair["ratio"])),
                     scores(reference, noisy * pair["ratio"]), scores(reference, read(result) * pair["ratio"])))
    return rows


def test_scores_are_those_of_the_files(malus, session, tmp_path):
    folder, _ = session
    done = malus("experiment", "denoise", "--test-pairs", folder / "pairs/pairs.json", "--model", CAMERA, "--methods", METHOD, "--json",
                 "--report", tmp_path / "page.html")
    methods = done.json["methods"]
    rows = expected(malus, folder / "pairs", tmp_path)
    assert [case["case"] for case in methods[0]["by_case"]] == sorted({row[0] for row in rows}) == done.json["cases"]
    assert len(done.json["cases"]) == 2 and len(done.json["captures"]) == 4
    for method, place in zip(methods, (1, 2)):
        for case in (method, *method["by_case"]):
            of_case = [row[place] for row in rows if case.get("case", row[0]) == row[0]]
            for key in of_case[0]:
                assert case[key] == pytest.approx(np.mean([score[key] for score in of_case]), rel=2e-5), (key, case)
    assert methods[1]["image_psnr_db"] > methods[0]["image_psnr_db"] + 5
    # The lamp of scene 1 is at white in its references, and its edges; it is said, and in no score.
    unknown = [capture["unknown_share"] for capture in done.json["captures"]]
    lamp = np.mean(session[1][1] >= RANGE)
    assert sorted(unknown)[:2] == [0, 0] and sorted(unknown)[2:] == pytest.approx([lamp, lamp])
    assert "of its pixels do not tell the light" in done.err
    page = (tmp_path / "page.html").read_text()
    assert "4 captured frames against references" in page and "Means over frames, 24 dB at 1/" in page


def test_a_reference_that_holds_its_bias_is_freed_of_it(malus, session, tmp_path):
    """Lists of `malus pairs` without a model: the model of the experiment takes the bias off."""
    folder, _ = session
    assert not json.loads((folder / "biased/pairs.json").read_text())["pairs"][0]["bias_removed"]
    methods = malus("experiment", "denoise", "--test-pairs", folder / "biased/pairs.json", "--model", CAMERA, "--methods", METHOD,
                    "--json").json["methods"]
    rows = expected(malus, folder / "biased", tmp_path, held_bias=biases(malus, 0))
    for method, place in zip(methods, (1, 2)):
        for key in rows[0][1]:
            assert method[key] == pytest.approx(np.mean([row[place][key] for row in rows]), rel=2e-5), key


def test_the_score_is_near_that_against_the_truth(malus, session):
    """The reference's own noise is in the score: eight frames at ten times the light leave little of it."""
    folder, scenes = session
    (row,) = malus("experiment", "denoise", "--test-pairs", folder / "pairs/pairs.json", "--model", CAMERA, "--methods", METHOD,
                   "--json").json["methods"][1:]
    true = []
    for pair in json.loads((folder / "pairs/pairs.json").read_text())["pairs"]:
        clean = scenes[int(pair["name"][5:8])].astype(float)
        clean[clean >= RANGE] = np.nan
        (result,) = [name for name in malus("denoise", folder / "pairs" / pair["short"], "--model", CAMERA, "--method", "bm3d", "--profile",
                                            "fast", "-o", folder / "true", "--force", "--json").json["files"] if name.endswith("_denoised.tif")]
        true.append(decibel(((clean - read(result) * pair["ratio"]) / RANGE) ** 2))
    assert row["image_psnr_db"] == pytest.approx(np.mean(true), abs=0.5)


def test_cases_go_by_gain_and_ratio_however_lists_are_ordered(malus, session, tmp_path):
    folder, _ = session
    entries = json.loads((folder / "pairs/pairs.json").read_text())["pairs"]
    for entry in entries:
        entry["reference"], entry["short"] = str(folder / "pairs" / entry["reference"]), str(folder / "pairs" / entry["short"])
    entries[0]["ratio"] *= 1.0001  # an exposure that is rounded
    lists = []
    for name, part in (("a", entries[::-1][:1]), ("b", entries[::-1][1:])):
        lists.append(tmp_path / f"{name}.json")
        lists[-1].write_text(json.dumps({"pairs": part}))
    run = ["--model", CAMERA, "--methods", METHOD, "--crop", 64]
    both = malus("experiment", "denoise", "--test-pairs", *lists, *run, "--json").json
    assert [case.split(":")[0] for case in both["cases"]] == ["12", "24"]
    assert [capture["case"] for capture in both["captures"]] == [both["cases"][0]] * 2 + [both["cases"][1]] * 2
    assert both["methods"][1]["dolp_psnr_db"] == pytest.approx(np.mean([case["dolp_psnr_db"] for case in both["methods"][1]["by_case"]]))


def test_the_noise_can_be_estimated_from_the_frames(malus, session):
    folder, _ = session
    run = ["experiment", "denoise", "--methods", METHOD, "--estimate-noise", "--json", "--test-pairs"]
    known = malus(*run, folder / "pairs/pairs.json", "--model", CAMERA)
    assert known.json["methods"][1]["image_psnr_db"] > known.json["methods"][0]["image_psnr_db"] + 5
    alone = malus(*run, folder / "pairs/pairs.json")
    assert alone.json["model"] is None and "bias" not in alone.err
    assert alone.json["methods"] == [{**row, "seconds": now["seconds"], "by_case": now["by_case"]}
                                     for row, now in zip(known.json["methods"], alone.json["methods"])]
    assert "holds the sensor's bias" in malus(*run, folder / "biased/pairs.json").err


def test_short_frames_without_facts_are_read_by_the_model_and_its_noise_is_checked(malus, session, pairs):
    folder, _ = session
    run = ["experiment", "denoise", "--model", CAMERA, "--methods", METHOD, "--json", "--test-pairs"]
    told = malus(*run, pairs / "pairs.json")
    assert "model" not in told.err.replace(CAMERA, "")
    whole = json.loads((pairs / "pairs.json").read_text())
    for pair in whole["pairs"]:
        np.save(pairs / f"{pair['name']}.npy", read(pairs / pair["short"]).astype(np.uint16))
        pair["short"] = f"{pair['name']}.npy"
    (pairs / "plain.json").write_text(json.dumps(whole))
    plain = malus(*run, pairs / "plain.json").json
    for row, same in zip(told.json["methods"], plain["methods"]):
        assert [row[key] for key in ("image_psnr_db", "dolp_psnr_db")] == [same[key] for key in ("image_psnr_db", "dolp_psnr_db")]
    for pair in whole["pairs"]:
        pair["gain_db"] = 0
    (pairs / "plain.json").write_text(json.dumps(whole))
    assert "noise" in malus(*run, pairs / "plain.json").err


def test_what_cannot_be_scored_is_refused(malus, refused, pairs, tmp_path):
    run = ["experiment", "denoise", "--methods", METHOD, "-q", "--model", CAMERA, "--test-pairs"]
    whole = json.loads((pairs / "pairs.json").read_text())

    def refuses(change, word, model=CAMERA):
        spoiled = json.loads(json.dumps(whole))
        change(spoiled["pairs"])
        (pairs / "spoiled.json").write_text(json.dumps(spoiled))
        line = refused(*run[:6], model, "--test-pairs", pairs / "spoiled.json")
        assert word in line, line

    assert "no_such.json: " in refused(*run, tmp_path / "no_such.json")
    (tmp_path / "damaged.json").write_text((pairs / "pairs.json").read_text()[:-40])
    assert "damaged.json: is no list of pairs" in refused(*run, tmp_path / "damaged.json")
    refuses(lambda list_: list_.clear(), "spoiled.json: holds no pairs")
    refuses(lambda list_: list_[1].update(short="gone.tif"), "gone.tif: ")
    refuses(lambda list_: list_[1].update(reference="gone.tif"), "gone.tif: ")
    refuses(lambda list_: list_[1].update(ratio=-1), "ratio is above 0")
    refuses(lambda list_: list_[1].update(gain_db=99), "scene000_01 at 99 dB: ")
    refuses(lambda list_: list_[1].update(gain_db=6), "was taken at 24 dB, its list of pairs says 6 dB")
    refuses(lambda list_: None, "has the layout polar-bayer-rggb, the noise model polar-mono", "imx250mzr-simulated")
    np.save(pairs / "small.npy", np.ones((8, 8), np.float32))
    refuses(lambda list_: list_[1].update(reference="small.npy"), "has another size than its reference")
    np.save(pairs / "lamp.npy", np.full((SIDE, SIDE), RANGE, np.float32))
    refuses(lambda list_: list_[1].update(reference="lamp.npy"), "lamp.npy: tells no light")


def test_flags_that_do_not_go_together_are_refused(malus, pairs, tmp_path):
    run = ["experiment", "denoise"]
    lists = ["--methods", METHOD, "--test-pairs", pairs / "pairs.json"]
    for arguments, words in (([], ("SCENE", "--test-pairs")), ([*lists], ("--model",)),
                             ([tmp_path, *lists, "--model", CAMERA], ("SCENE", "--test-pairs")),
                             ([*lists, "--model", CAMERA, "--cases", "12:10"], ("--cases", "--test-pairs")),
                             ([*lists, "--model", CAMERA, "--row-noise", "1"], ("--row-noise", "--test-pairs"))):
        line = malus(*run, *arguments, code=2).err
        assert all(word in line for word in words), line


# rows that are trained on captured pairs

SMALL = [word for setting in ("train.steps=2", "train.batch=1", "data.example=64", "data.patch=64", "data.pool=1")
         for word in ("--set", setting)]
NETWORK = ["--set", "network.width=2", "--set", "network.levels=2"]


@pytest.fixture
def picture(tmp_path):
    rng = np.random.default_rng(1)
    Image.fromarray(rng.integers(30, 220, (96, 96, 3), dtype=np.uint8)).save(tmp_path / "picture.png")
    return ["--set", f"data.pictures={tmp_path}/picture.png"]


@pytest.fixture
def lists(session, tmp_path):
    """Scene 0 to train on, scene 1 to score on."""
    folder, _ = session
    entries = json.loads((folder / "pairs/pairs.json").read_text())["pairs"]
    paths = []
    for name, scene_name in (("train", "scene000"), ("test", "scene001")):
        part = [{**entry, "reference": str(folder / "pairs" / entry["reference"]), "short": str(folder / "pairs" / entry["short"])}
                for entry in entries if entry["name"].startswith(scene_name)]
        paths.append(tmp_path / f"{name}.json")
        paths[-1].write_text(json.dumps({"pairs": part}))
    return paths


@pytest.mark.slow
@needs_networks
def test_rows_of_table2_are_trained_on_pairs_and_scored_on_captures(malus, lists, picture, tmp_path):
    train, test = lists
    run = ["experiment", "table2", ROOT / "experiments/table2.toml", "--model", CAMERA, "--test-pairs", test, "-o", tmp_path / "out",
           *SMALL, *NETWORK, *picture]
    without = malus(*run, "--json")
    assert without.json["left_out"] == ["(a) paired, global bias left in", "(b) paired"]
    assert "left out without --pairs" in without.err and "(b) paired" in without.err
    done = malus(*run, "--pairs", train, "--json", "--report", tmp_path / "page.html").json
    assert "left_out" not in done and done["test_pairs"] == [str(test)]
    rows = {row["name"]: row for row in done["rows"]}
    assert list(rows)[:3] == ["noisy", "(a) paired, global bias left in", "(b) paired"]
    assert [row for row in rows.values() if "paired" not in row["name"]] == pytest.approx([
        {**row, "seconds": rows[row["name"]]["seconds"], "by_case": rows[row["name"]]["by_case"]} for row in without.json["rows"]])
    assert len(rows["noisy"]["by_case"]) == 2 and "captured frames against references" in (tmp_path / "page.html").read_text()
    # They are the trainings that `malus train` makes of the configuration with these data, and are not made again.
    config = (ROOT / "experiments/table2/full.toml").read_text()
    assert 'pictures = ["../pictures/*"]' in config
    (tmp_path / "full.toml").write_text(config.replace('pictures = ["../pictures/*"]', f'pairs = ["{train}"]'))
    malus("train", tmp_path / "full.toml", *SMALL, *NETWORK, "-o", tmp_path / "alone", "-q")
    weights = tmp_path / "out/full-pairs/weights.safetensors"
    written = weights.read_bytes()
    assert written == (tmp_path / "alone/weights.safetensors").read_bytes()
    assert written != (tmp_path / "out/full/weights.safetensors").read_bytes()
    scored = malus("experiment", "denoise", "--test-pairs", test, "--model", CAMERA, "--methods", weights, "--json").json["methods"]
    for key in ("image_psnr_db", "image_ssim", "dolp_psnr_db", "aolp_circular_deg"):
        assert scored[1][key] == rows["(b) paired"][key] and scored[0][key] == rows["noisy"][key]
    malus(*run, "--pairs", train, "-q")
    assert weights.read_bytes() == written


@pytest.mark.slow
@needs_networks
def test_table1_has_the_papers_real_rows(malus, lists, picture, tmp_path):
    train, test = lists
    done = malus("experiment", "table1", ROOT / "experiments/table1.toml", "--model", CAMERA, "--pairs", train, "--test-pairs", test,
                 "--crop", 64, "-o", tmp_path / "out", *SMALL, *picture, "--json").json
    networks = [row["name"] for row in done["rows"]][4:]
    assert networks == ["U-Net", "Uformer", "Restormer", "malus", "U-Net*", "Uformer*", "Restormer*", "malus*"]
    assert (tmp_path / "out/malus-pairs/weights.safetensors").exists() and (tmp_path / "out/malus/weights.safetensors").exists()


@needs_networks
def test_tables_refuse_pairs_that_no_row_can_use(malus, refused, lists, tmp_path):
    train, test = lists
    rows = tmp_path / "rows.toml"
    rows.write_text('[[rows]]\nname = "classical"\nmethod = "bm3d/fast"\n')
    run = ["experiment", "table1", rows, "-o", tmp_path / "out", "-q"]
    scored = [*run, "--model", CAMERA, "--test-pairs", test]
    assert "has no row with trained_on" in refused(*scored, "--pairs", train)
    assert "--model" in malus(*run, "--test-pairs", test, code=2).err
    assert "--model" in malus(*run, "--scenes", tmp_path, "--pairs", train, code=2).err
    assert "--scenes" in malus(*run, code=2).err
    for marked, word in (('method = "bm3d"\ntrained_on = "pairs"', "the row is a method"),
                         ('config = "full.toml"\ntrained_on = "captures"', 'write trained_on = "pairs"')):
        rows.write_text(f'[[rows]]\nname = "a"\n{marked}\n')
        assert word in refused(*scored, "--pairs", train)
    config = (ROOT / "experiments/table2/full.toml").read_text()
    (tmp_path / "full.toml").write_text(config)
    rows.write_text('[[rows]]\nname = "a"\nconfig = "full.toml"\ntrained_on = "pairs"\n')
    assert "no_such.json" in refused(*scored, "--pairs", tmp_path / "no_such.json")
    (tmp_path / "empty.json").write_text('{"pairs": []}')
    assert "empty.json: holds no pairs" in refused(*scored, "--pairs", train, tmp_path / "empty.json")
    assert not (tmp_path / "out").exists()
    # What is scored on what it was trained on is said.
    said = malus(*scored, "--pairs", train, test, *SMALL, *NETWORK)
    assert "scene001_00, scene001_01 of --test-pairs are among --pairs, too" in said.err
