"""Networks that give pictures: `malus experiment table-s1` and `denoise-demosaic` with trainings of three steps, and `malus denoise`
with what they trained."""

import json
import shutil

import numpy as np
import pytest
from PIL import Image

from conftest import ROOT, needs_networks

pytestmark = [pytest.mark.slow, needs_networks]

SMALLER = (("width = 12", "width = 2"), ("levels = 3", "levels = 2"), ("example = 256", "example = 64"), ("patch = 64", "patch = 32"),
           ("pool = 8", "pool = 1"), ("steps = 1200", "steps = 3"))


@pytest.fixture
def experiments(tmp_path):
    """The repository's experiments with tiny networks, one picture to train on and two others."""
    rng = np.random.default_rng(1)
    for name in ("table-s1", "denoise-demosaic"):
        shutil.copytree(ROOT / "experiments" / name, tmp_path / name)
        shutil.copy(ROOT / "experiments" / f"{name}.toml", tmp_path)
        for config in (tmp_path / name).glob("*.toml"):
            text = config.read_text()
            for old, new in (("steps = 1500", "steps = 3"),) if config.name == "flow.toml" else SMALLER:
                assert old in text, (config, old)
                text = text.replace(old, new)
            config.write_text(text)
    (tmp_path / "pictures").mkdir()
    rows, cols = np.mgrid[0:96, 0:96]
    for k, name in enumerate(("pictures/a", "b", "c")):
        light = 120 + 60 * np.sin(cols / (7 + k)) + 40 * np.cos(rows / 11 + k)
        colors = light[..., None] * (1, 0.9, 0.7) + rng.normal(0, 4, (96, 96, 3))
        Image.fromarray(np.clip(colors, 0, 255).astype(np.uint8)).save(tmp_path / f"{name}.png")
    return tmp_path


def test_table_s1_has_the_papers_rows_and_columns(malus, refused, experiments):
    run = ["experiment", "table-s1", experiments / "table-s1.toml", "--pictures", experiments / "b.png",
           experiments / "c.png", "--test-pictures", experiments / "c.png", "-o", experiments / "out", "--crop", "64"]
    first = malus(*run, "--json", "--report", experiments / "page.html").json
    assert [(row["noise_model"], row["denoiser"], row["input"]) for row in first["rows"]] == [
        ("NP Noise-on-noise", "UNet", "ISO 1600"), ("NP Noise-on-noise", "BM3D", "ISO 1600"),
        ("NP Calibrated", "UNet", "Denoised ISO 1600"), ("HG Noise-on-noise", "UNet", "ISO 1600"),
        ("captured (upper bound)", "-", "ISO 3200")]
    for row in first["rows"][:4]:
        assert 0 <= row["jsd"] < 0.5 and row["sqrt_jsd"] ** 2 == pytest.approx(row["jsd"], rel=1e-6)
        assert row["sqrt_jsd_floor"] ** 2 == pytest.approx(row["jsd_floor"], rel=1e-6)
        assert row["jsd_floor"] < 127 / (8 * np.log(2)) * 2 / (2 * 64 * 64)  # of 128 bins that both captures fill together
    assert (experiments / "page.html").stat().st_size > 10000
    # Noise on noise of the right noise ends nearer to the camera's than noise on what a network of three steps left.
    assert first["rows"][0]["jsd"] < first["rows"][2]["jsd"]
    # A second run trains nothing and says the same; its captures serve as captured pairs.
    weights = experiments / "out/captured/isp/weights.safetensors"
    written = weights.read_bytes()
    text = malus(*run).out
    assert weights.read_bytes() == written
    assert text.splitlines()[0] == "| ISO 3200 noise model | denoiser | input image | neural ISP PSNR [dB] | SSIM | JSD | its floor |"
    assert "belongs to a run with other files of data.pairs" in refused(*run[:-1], "48", "-q")
    malus(*run, "-q")
    again = malus("experiment", "table-s1", experiments / "table-s1.toml", "--pairs", experiments / "out/captures/pairs.json",
                  "--test-pairs", experiments / "out/captures/test-pairs.json", "-o", experiments / "again", "--json").json
    assert [row["psnr_db"] for row in again["rows"]] == pytest.approx([row["psnr_db"] for row in first["rows"]], abs=1e-6)
    # A picture of another size than its pair.
    pairs = json.loads((experiments / "out/captures/test-pairs.json").read_text())
    np.save(experiments / "small.npy", np.ones((3, 8, 8), np.float32))
    pairs["pairs"][0]["picture"] = str(experiments / "small.npy")
    (experiments / "mixed.json").write_text(json.dumps(pairs))
    assert "small.npy: has another size than its reference" in refused(
        "experiment", "table-s1", experiments / "table-s1.toml", "--pairs", experiments / "out/captures/pairs.json",
        "--test-pairs", experiments / "mixed.json", "-o", experiments / "again", "-q")


def test_denoise_demosaic_and_the_pictures_of_its_networks(malus, refused, experiments):
    out = experiments / "out"
    run = ["experiment", "denoise-demosaic", experiments / "denoise-demosaic.toml", "--pictures", experiments / "b.png",
           experiments / "c.png", "-o", out, "--crop", "64"]
    rows = malus(*run, "--json", "--report", experiments / "page.html").json["rows"]
    assert [row["name"] for row in rows] == ["none: noisy, demosaicked", "none: bm3d, demosaicked", "heteroscedastic Gaussian",
                                             "Poisson-Gaussian", "physics", "non-parametric", "Noise Flow"]
    assert rows[1]["psnr_db"] > rows[0]["psnr_db"] + 3
    assert [gain["gain"] for gain in rows[0]["gains"]] == ["ISO 1600", "ISO 3200", "ISO 6400"]
    assert rows[0]["psnr_db"] == pytest.approx(np.mean([gain["psnr_db"] for gain in rows[0]["gains"]]))
    assert {"physics", "gaussian", "nonparametric"} <= set(malus("model", "show", out / "model.h5", "--json").json["kinds"])

    # The flow learns from four lights at each of the seven gains, and is not trained twice.
    captures = json.loads((out / "flow-captures/pairs.json").read_text())["pairs"]
    assert sorted({pair["iso"] for pair in captures}) == [100, 200, 400, 800, 1600, 3200, 6400] and len(captures) == 28
    weights = [out / name / "weights.safetensors" for name in ("flow", "noise_flow")]
    written = [path.read_bytes() for path in weights]
    # With --set, which is of the networks: they are others then, and the flow is not.
    assert "belongs to a run with another train.steps" in refused(*run, "--set", "train.steps=4", "-q")
    assert malus(*run, "--json").json["rows"] != [] and [path.read_bytes() for path in weights] == written
    few = out / "flow-captures/few.json"
    few.write_text(json.dumps({"pairs": captures[-2:]}))
    scored = ["experiment", "denoise-demosaic", run[2], "--pairs", few]
    line = refused(*scored, "-o", experiments / "real", "-q")
    assert '"Noise Flow" learns from captures' in line and "--flow-pairs" in line
    rows = malus(*scored, "--flow-pairs", out / "flow-captures/pairs.json", "-o", experiments / "real", "--json").json["rows"]
    assert rows[-1]["name"] == "Noise Flow" and (experiments / "real/flow/weights.safetensors").read_bytes() == written[0]

    # Of another camera they would be other trainings, and the finished ones are not taken for them.
    other = experiments / "canon.toml"
    other.write_text((experiments / "denoise-demosaic.toml").read_text().replace("nikon-d850", "canon-5d4"))
    assert "belongs to a run with other files of noise.models" in refused(*run[:2], other, *run[3:], "-q")

    frame = out / "captures/case0/0_b_4_short.tif"
    denoise = ["denoise", frame, "--model", "nikon-d850", "--method", out / "physics/weights.safetensors", "-o", experiments / "rgb"]
    record = malus(*denoise, "--format", "npy", "--json").json
    assert record["target"] == "rgb" and record["files"] == [str(experiments / "rgb/0_b_4_short_rgb.npy")]
    assert np.load(record["files"][0]).shape == (3, 64, 64)
    for flag in ("--planes", "--u16"):
        assert flag in refused(*denoise, flag)
    assert "png" in refused(*denoise, "--format", "png")
    # What the frame's pixels do not tell is said of pictures, too.
    spoiled = np.random.default_rng(1).normal(1000, 30, (64, 64)).astype(np.float32)
    spoiled[:16], spoiled[40, 40:43] = 16000, np.nan
    np.save(experiments / "spoiled.npy", spoiled)
    told = malus("denoise", experiments / "spoiled.npy", "--layout", "bayer-rggb", "--black", 0, "--white", 15000, "--iso", 1600,
                 *denoise[2:], "--format", "npy")
    assert "3 pixels are NaN, infinite, or beyond 100 times white; they are filled from their neighbours" in told.err
    assert "1024 pixels, 25 % of the frame, are saturated" in told.err
    assert np.isfinite(np.load(experiments / "rgb/spoiled_rgb.npy")).all()


@pytest.fixture
def namesakes(experiments):
    """Two pictures of one name, a camera at two gains, no network."""
    for folder, picture in (("p1", "b"), ("p2", "c")):
        (experiments / folder).mkdir()
        shutil.copy(experiments / f"{picture}.png", experiments / folder / "x.png")
    (experiments / "few.toml").write_text('model = "nikon-d850"\ngains = [1600]\ncases = ["1600:4", "3200:4"]\n'
                                          '[[rows]]\nname = "fast"\nmethod = "bm3d/fast"\n')
    return ["--pictures", experiments / "p1/x.png", experiments / "p2/x.png", "--crop", "64"]


def test_pictures_of_one_name_are_captured_apart(malus, experiments, namesakes):
    malus("experiment", "denoise-demosaic", experiments / "few.toml", *namesakes, "-o", experiments / "out", "-q")
    for case in ("case0", "case1"):
        references = [np.load(path) for path in sorted((experiments / "out/captures" / case).glob("*_reference.npy"))]
        assert len(references) == 2 and not np.array_equal(*references)


def pair(name, files, ratio, iso):
    return {"name": name, "short": f"{files}_short.tif", "reference": f"{files}_reference.npy", "picture": f"{files}_picture.npy",
            "ratio": ratio, "gain_db": None, "iso": iso}


def test_a_gain_is_one_line_wherever_its_pairs_stand(malus, experiments, namesakes):
    malus("experiment", "denoise-demosaic", experiments / "few.toml", *namesakes, "-o", experiments / "out", "-q")
    pairs = [pair(f"{k}_{case}", str(sorted((experiments / f"out/captures/case{case}").glob("*_short.tif"))[k])[:-10], 4, iso)
             for k in range(2) for case, iso in enumerate((1600, 3200))]
    (experiments / "pairs.json").write_text(json.dumps({"pairs": pairs}))
    rows = malus("experiment", "denoise-demosaic", experiments / "few.toml", "--pairs", experiments / "pairs.json", "-o",
                 experiments / "listed", "--json").json["rows"]
    for row in rows:
        assert [gain["gain"] for gain in row["gains"]] == ["ISO 1600", "ISO 3200"]
        assert row["psnr_db"] == pytest.approx(np.mean([gain["psnr_db"] for gain in row["gains"]]))


def test_frames_of_one_scene_stay_apart(malus, experiments):
    """Two of a scene at each gain, one at a fourth of the light."""
    pairs = []
    for exposure in ("1600:1", "1600:4", "3200:1", "3200:4"):
        iso, ratio = map(int, exposure.split(":"))
        (experiments / "one.toml").write_text(f'model = "nikon-d850"\ngains = [1600]\ncases = ["{exposure}"]\nexposure = 0.3\n'
                                              '[[rows]]\nname = "fast"\nmethod = "bm3d/fast"\n')
        out = experiments / f"shots{len(pairs)}"
        malus("experiment", "denoise-demosaic", experiments / "one.toml", "--pictures", experiments / "b.png", "-o", out, "--crop", "64", "-q")
        files = str(next((out / "captures/case0").glob("*_short.tif")))[:-10]
        pairs.append(pair(f"scene_{len(pairs):02}", files, ratio, iso))
    (experiments / "pairs.json").write_text(json.dumps({"pairs": pairs}))
    table = (experiments / "table-s1.toml").read_text()
    (experiments / "table-s1.toml").write_text(table[:table.index("[[rows]]")] + '[[rows]]\nnoise = "NP"\nscheme = "noise-on-noise"\n'
                                               'denoiser = "BM3D"\n')
    row = malus("experiment", "table-s1", experiments / "table-s1.toml", "--pairs", experiments / "pairs.json", "--test-pairs",
                experiments / "pairs.json", "-o", experiments / "out", "--json").json["rows"][0]
    listed = json.loads((experiments / "out/NP-noise-on-noise-BM3D/pairs.json").read_text())["pairs"]
    bright, dark = (np.asarray(Image.open(entry["short"]), dtype=float).mean() for entry in listed)
    assert bright > dark + 100  # black is 800
    # Each is compared with the captured frame of its light: noise at a fourth of it is another.
    assert row["sqrt_jsd"] < row["sqrt_jsd_floor"] + 0.1


def test_a_neural_isp_writes_sixteen_bit_pictures(malus, experiments):
    capture = experiments / "capture"
    malus("experiment", "denoise-demosaic", experiments / "denoise-demosaic.toml", "--pictures", experiments / "b.png", "-o", capture,
          "--crop", "64", "-q")
    config = (experiments / "denoise-demosaic/physics.toml").read_text().replace('target = "rgb"', 'target = "srgb"')
    (experiments / "denoise-demosaic/isp.toml").write_text(config)
    malus("train", experiments / "denoise-demosaic/isp.toml", "-o", experiments / "isp")
    files = {}
    for ending in ("npy", "tif", "png"):
        written = malus("denoise", capture / "captures/case1/0_b_4_short.tif", "--model", "nikon-d850", "--method",
                        experiments / "isp/weights.safetensors", "-o", experiments / f"shown-{ending}", "--format", ending, "--json").json["files"]
        files[ending] = experiments / f"shown-{ending}/0_b_4_short_srgb.{ending}"
        assert written == [str(files[ending])]
    assert tuple(files["png"].read_bytes()[24:26]) == (16, 2)  # 16 bits, red, green and blue
    shown = 255 * np.clip(np.load(files["npy"]).transpose(1, 2, 0), 0, 1)
    assert np.abs(np.asarray(Image.open(files["png"]), dtype=float) - shown).max() < 1.01  # read as 8 bit
    malus("simulate", files["tif"], "--tone", "linear", "--layout", "bayer-rggb", "--full-scale", 65535, "--format", "npy", "-o",
          experiments / "tif")
    red = np.load(experiments / "tif/0_b_4_short_srgb_clean.npy")[0::2, 0::2]
    assert np.abs(red - shown[0::2, 0::2, 0] * 257).max() < 0.51  # rounded to whole 65535ths


def test_bad_experiments_are_refused(malus, refused, experiments):
    tables = [["experiment", "table-s1", experiments / "table-s1.toml", "-o", experiments / "out"],
              ["experiment", "denoise-demosaic", experiments / "denoise-demosaic.toml", "-o", experiments / "out"]]
    assert "give --pictures and --test-pictures" in malus(*tables[0], "-q", code=2).err
    assert "one of --pictures and --pairs is required" in malus(*tables[1], "-q", code=2).err
    scenes = [["--pictures", experiments / "b.png", "--test-pictures", experiments / "c.png"], ["--pictures", experiments / "b.png"]]
    for run, pictures, changes in zip(tables, scenes, (
            (('scheme = "calibrated"', 'scheme = "guessed"', "scheme"), ('noise = "HG"', 'noise = "HH"', "noise"),
             ("isp =", "ips =", "ips")),
            (('method = "bm3d"', 'method = "bm3e"', "bm3d"), ("gains =", "gain =", "gain"), ("nikon-d850", "imx250myr-simulated", "Bayer")))):
        good = run[2].read_text()
        for old, new, word in changes:
            run[2].write_text(good.replace(old, new))
            assert word in refused(*run, *pictures, "-q")
        run[2].write_text(good)
    pairs = experiments / "pairs.json"
    pairs.write_text('{"pairs": []}')
    assert "no pairs" in refused(*tables[0], "--pairs", pairs, "--test-pairs", pairs, "-q")
    assert "no pairs" in refused(*tables[1], "--pairs", pairs, "--flow-pairs", pairs, "-q")
    pairs.write_text('{"pairs": [{"name": "a_00", "short": "a.tif", "reference": "a.npy", "ratio": 0, "gain_db": null, "iso": 1600}]}')
    assert "ratio is above 0" in refused(*tables[1], "--pairs", pairs, "--flow-pairs", pairs, "-q")
    # Said before anything is trained; other gains than the table's are not looked at.
    listed = [{"name": "a_00", "short": "gone.tif", "reference": "a.npy", "ratio": 1, "gain_db": None, "iso": iso} for iso in (1600, 3200)]
    pairs.write_text(json.dumps({"pairs": [{**listed[0], "short": "unseen.tif", "iso": 50}, *listed]}))
    assert "gone.tif" in refused(*tables[0], "--pairs", pairs, "--test-pairs", pairs, "-q")
    assert not (experiments / "out/denoiser").exists()
    pairs.write_text(json.dumps({"pairs": [{**listed[0], "iso": 50}]}))
    assert "has no pairs at ISO 1600" in refused(*tables[0], "--pairs", pairs, "--test-pairs", pairs, "-q")
