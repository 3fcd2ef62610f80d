"""`malus experiment table2`: rows trained for a few steps, scored alike, not trained again."""

import os

import numpy as np
import pytest
from PIL import Image

from conftest import ROOT, needs_networks
from weight_files import unet_package

pytestmark = [pytest.mark.slow, needs_networks]


@pytest.fixture
def experiment(tmp_path):
    rng = np.random.default_rng(1)
    (tmp_path / "pictures").mkdir()
    Image.fromarray(rng.integers(30, 220, (96, 96, 3), dtype=np.uint8)).save(tmp_path / "pictures/a.png")
    (tmp_path / "scene").mkdir()
    rows, cols = np.mgrid[0:64, 0:64]
    for k, angle in enumerate((0, 45, 90, 135)):
        light = 110 + 40 * np.sin(cols / 9) + 30 * np.cos(rows / 7 + k)
        Image.fromarray(np.repeat(light[..., None], 3, 2).astype(np.uint8)).save(tmp_path / f"scene/I{angle}.png")
    full = (ROOT / "experiments/table2/full.toml").read_text()
    for old, new in (("../pictures", "pictures"), ("width = 12", "width = 2"), ("levels = 4", "levels = 2"),
                     ("example = 256", "example = 64"), ("patch = 128", "patch = 32"), ("pool = 8", "pool = 1"),
                     ("steps = 250", "steps = 3")):
        assert old in full
        full = full.replace(old, new)
    (tmp_path / "full.toml").write_text(full)
    (tmp_path / "rows.toml").write_text('[[rows]]\nname = "classical"\nmethod = "bm3d/fast"\n'
                                        '[[rows]]\nname = "full"\nconfig = "full.toml"\n')
    return tmp_path


def test_rows_are_scored_and_not_trained_again(malus, experiment):
    run = ["experiment", "table2", experiment / "rows.toml", "--scenes", experiment / "scene", "-o", experiment / "out",
           "--cases", "12:10", "--json"]
    first = malus(*run, "--report", experiment / "page.html").json
    assert [row["name"] for row in first["rows"]] == ["noisy", "classical", "full"]
    assert first["rows"][1]["image_psnr_db"] > first["rows"][0]["image_psnr_db"] + 3
    assert (experiment / "page.html").stat().st_size > 10000
    weights = experiment / "out/full/weights.safetensors"
    written = weights.read_bytes()
    again = malus(*run).json
    assert weights.read_bytes() == written
    assert [row["image_psnr_db"] for row in again["rows"]] == [row["image_psnr_db"] for row in first["rows"]]


def test_a_network_that_amplifies_by_the_ratio_is_given_that_of_each_case(malus, experiment):
    weights = unet_package(experiment / "network.safetensors", amplification="ratio")
    (experiment / "rows.toml").write_text(f'[[rows]]\nname = "network"\nmethod = "{weights}"\n')
    shots = ["--cases", "12:10", "12:60", "--json"]
    rows = malus("experiment", "table2", experiment / "rows.toml", "--scenes", experiment / "scene", "-o", experiment / "out", *shots).json["rows"]
    methods = malus("experiment", "denoise", experiment / "scene", "--methods", weights, *shots).json["methods"]
    guided = unet_package(experiment / "guided.safetensors", amplification="ratio", guide="nl-ridge")
    checked = malus("experiment", "uncertainty", experiment / "scene", "--methods", guided, *shots).json["rows"]
    assert [row["method"] for row in checked] == [str(guided)] * 2
    # The network corrects nothing: the noisy frames come out, but for what is clipped on the way.
    for scored in (rows, methods):
        assert scored[1]["image_psnr_db"] == pytest.approx(scored[0]["image_psnr_db"], abs=0.5)


def test_the_light_cases_have_tables_of_their_own(malus, experiment):
    (experiment / "rows.toml").write_text('[[rows]]\nname = "classical"\nmethod = "bm3d/fast"\n')
    run = ["experiment", "table1", experiment / "rows.toml", "--scenes", experiment / "scene", "-o", experiment / "out"]
    text = malus(*run, "--report", experiment / "page.html").out
    mean, first, second = text.split("12 dB at 1/")
    assert first.startswith("10 of the light:\n") and second.startswith("60 of the light:\n")
    for table in (mean, first, second):
        assert "| method | image PSNR [dB] | image SSIM | DoLP PSNR [dB] | AoLP PSNR [dB] |" in table
        assert table.count("\n| noisy |") == table.count("\n| classical |") == 1
    page = (experiment / "page.html").read_text()
    assert "Means over scenes, 12 dB at 1/60 of the light" in page and "AoLP PSNR" in page


def test_one_process_trains_an_experiments_rows(refused, experiment):
    line = refused("experiment", "table2", experiment / "rows.toml", "--scenes", experiment / "scene", "-o", experiment / "out",
                   "-q", env={**os.environ, "RANK": "1", "WORLD_SIZE": "2"})
    assert "full.toml: " in line and "by one process" in line and not (experiment / "out").exists()


def test_bad_rows_are_refused(refused, experiment):
    run = ["experiment", "table2", experiment / "rows.toml", "--scenes", experiment / "scene", "-o", experiment / "out"]
    for text, word in (("", "rows"), ('[[rows]]\nname = "a"\n', "config"), ('[[rows]]\nnme = "a"\n', "name"),
                       ('[[rows]]\nname = "a"\nmethod = "bm3e"\n', "bm3d")):
        (experiment / "rows.toml").write_text(text)
        assert word in refused(*run, "-q")


def test_every_row_is_checked_before_the_first_is_trained(refused, experiment):
    text = (experiment / "full.toml").read_text()
    (experiment / "other.toml").write_text(text.replace('"unet"', '"malus"').replace("width = 2", "dim = 8").replace("levels = 2", ""))
    with (experiment / "rows.toml").open("a") as rows:
        rows.write('[[rows]]\nname = "other"\nconfig = "other.toml"\n')
    line = refused("experiment", "table2", experiment / "rows.toml", "--scenes", experiment / "scene", "-o", experiment / "out",
                   "-q", "--set", "network.width=3")
    assert 'unknown key "width"' in line and not (experiment / "out").exists()


def test_settings_reach_every_training(malus, refused, experiment):
    run = ["experiment", "table2", experiment / "rows.toml", "--scenes", experiment / "scene", "-o", experiment / "out",
           "--cases", "12:10", "-q"]
    malus(*run, "--set", "train.steps=2", "--set", "train.loss=l1")
    malus("train", experiment / "full.toml", "--set", "train.steps=2", "--set", "train.loss=l1", "-o", experiment / "alone")
    log = (experiment / "out/full/log.jsonl").read_text()
    assert '"step":2,' in log and '"step":3,' not in log
    assert (experiment / "alone/weights.safetensors").read_bytes() == (experiment / "out/full/weights.safetensors").read_bytes()
    # Another setting is another training, and the finished one is not taken for it.
    assert "belongs to a run with another train." in refused(*run, "--set", "train.steps=3")
    assert "--set train.stepz=3: unknown key" in refused(*run, "--set", "train.stepz=3")
