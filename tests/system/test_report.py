"""malus report of records: tables, curves and pictures land in the page; bad records are one line."""
import json
import pathlib
import re
import shutil
import subprocess

import h5py
import numpy as np
import pytest

from conftest import PROGRAM


def page_data(html):
    text = html.read_text(encoding="utf-8")
    return json.loads(re.search(r'id="malus-report">(.*?)</script>', text, re.S).group(1))


def record(folder, **changes):
    clean = np.linspace(100, 900, 32 * 48, dtype=np.float32).reshape(32, 48)
    np.save(folder / "clean.npy", clean)
    np.save(folder / "noisy.npy", clean + np.random.default_rng(1).normal(0, 20, clean.shape).astype(np.float32))
    made = {
        "title": "Training of a small network", "notes": ["stopped early"],
        "tables": [{"title": "Table 1", "head": "method", "columns": [{"name": "image PSNR", "unit": "dB"}],
                    "rows": [{"name": "noisy", "cells": [24.5]}, {"name": "network", "cells": [{"value": 31.0, "stderr": 0.1}]}]}],
        "charts": [{"title": "Loss", "x": {"name": "step"}, "y": {"name": "loss", "log": True},
                    "series": [{"name": "training", "x": [1, 2, 3], "y": [0.5, 0.4, 0.3]}]}],
        "pictures": [{"title": "held out", "layout": "polar-mono", "white_dn": 4095,
                      "files": [{"name": "noisy", "file": "noisy.npy"}, {"name": "clean", "file": "clean.npy"}]}],
    }
    made.update(changes)
    path = folder / "record.json"
    path.write_text(json.dumps(made))
    return path


def test_a_record_becomes_a_page(malus, tmp_path):
    malus("report", record(tmp_path), "-o", tmp_path / "page.html")
    blocks = page_data(tmp_path / "page.html")["sections"][0]["blocks"]
    assert [b["kind"] for b in blocks] == ["notices", "table", "charts", "pictures"]
    assert blocks[1]["rows"][1]["cells"][0] == {"value": 31.0, "error": 0.1}
    assert blocks[2]["charts"][0]["chart"]["series"][0]["y"] == [0.5, 0.4, 0.3]
    assert [p["name"] for p in blocks[3]["pictures"]] == ["noisy", "clean"]
    assert (blocks[3]["rows"], blocks[3]["cols"]) == (32, 48)


def test_a_denoised_headerless_frame_becomes_a_page(malus, tmp_path):
    """Nothing but the record knows its format and size."""
    dn = np.random.default_rng(2).normal(500, 10, (48, 64)).astype("<u2")
    (tmp_path / "frame.raw").write_bytes(dn.tobytes())
    malus("denoise", tmp_path / "frame.raw", "--raw-format", "mono16", "--size", "64x48", "--layout", "polar-mono", "--black", 80,
          "--white", 4095, "--model", "imx250mzr-simulated", "--gain", 12, "-o", tmp_path / "out")
    malus("report", tmp_path / "out/frame_denoised.json", "-o", tmp_path / "page.html")
    assert page_data(tmp_path / "page.html")


@pytest.mark.parametrize("changes, words", [
    ({"tables": [{"title": "no columns"}]}, "does not hold what a page needs"),
    ({"pictures": [{"title": "x", "layout": "polar-mono", "white_dn": 4095, "files": [{"name": "a", "file": "none.npy"}]}]}, "none.npy"),
    ({"pictures": [{"title": "x", "layout": "polar-mini", "white_dn": 4095, "files": []}]}, "polar-mini"),
    # What is no whole number is stored in parts of the white level.
    *[({"pictures": [{"title": "x", "layout": "polar-mono", "white_dn": white, "files": [{"name": "a", "file": "noisy.npy"}]}]},
       f"pictures \"x\": white_dn is {white:g}; give") for white in (0, -4095, 1e-200, 1e300)],
])
def test_bad_records_are_one_line_and_leave_nothing(refused, tmp_path, changes, words):
    error = refused("report", record(tmp_path, **changes), "-o", tmp_path / "page.html")
    assert words in error
    assert not (tmp_path / "page.html").exists()


@pytest.mark.parametrize("made", [
    {"kind": 5},
    {"kind": "denoise"},
    {"image": {"psnr": 30}, "warnings": [3]},
    {"results": [{"image": {"psnr": 30}}], "warnings": {"a": 1}},
    {"image": {"psnr": "30 dB"}},
    {"image": {"psnr": 30}, "dolp": [20]},
    {"title": 5, "charts": []},
    {"charts": [{"x": {"log": 3}, "y": {}, "series": []}]},
])
def test_json_that_malus_did_not_write_is_one_line(refused, tmp_path, made):
    (tmp_path / "made.json").write_text(json.dumps(made))
    assert "made.json" in refused("report", tmp_path / "made.json", "-o", tmp_path / "page.html")


def test_what_a_report_takes_is_said_of_a_file_that_is_none_of_it(refused, tmp_path):
    """A frame is refused as a noise model, which is only one of the things that were asked for."""
    for name in ("frame.tif", "camera.h5"):
        (tmp_path / name).write_text("no model")
        line = refused("report", tmp_path / name, "-o", tmp_path / "page.html")
        assert f"{name}: is not an HDF5 file" in line and ("evaluate's JSON" in line) == (name == "frame.tif"), line


def test_curves_that_differ_by_rounding_alone_become_figures(malus, tmp_path):
    charts = [{"title": "Loss", "x": {"name": "step"}, "y": {"name": "loss"},
               "series": [{"name": "a", "x": [1, 2, 3], "y": [0.30000000000000004, 0.3, 0.3]}]}]
    malus("report", record(tmp_path, charts=charts), "--figures", tmp_path / "figures", timeout=60)
    (svg,) = (tmp_path / "figures").iterdir()
    assert svg.stat().st_size < 10_000


def test_a_folder_of_figures_that_is_refused_leaves_no_page(malus, refused, tmp_path):
    malus("report", "imx250myr-simulated", "--figures", tmp_path / "figures")
    page = tmp_path / "page.html"
    assert "exists" in refused("report", "imx250myr-simulated", "-o", page, "--figures", tmp_path / "figures")
    assert not page.exists()


@pytest.mark.parametrize("changes, words", [
    ({"run": 5}, "run is no object"),
    ({"run": {"warnings": [{}]}}, "type must be string"),
    ({"sites": []}, "sites: has 0 rows"),
    ({"noise_line": []}, "noise_line does not fit the layout"),
    ({"reference_file": "frame.npy", "reference_ratio": 0}, "reference_ratio is not above 0"),
    # Turned into int or float before, which is not defined beyond their range.
    ({"row_group": 1e300}, "row_group is 1e+300, not a whole number"),
    ({"row_group": 1.5}, "row_group is 1.5, not a whole number"),
    ({"raw_format": "mono16", "rows": 2**33, "cols": 48}, "rows is 8.58993e+09, not a whole number"),
    ({"black_dn": [80, 80, 80, -1e300]}, "black_dn is -1e+300"),
    ({"white_dn": 1e300}, "white_dn is 1e+300"),
    ({"gain_db": 240}, "gain_db: is 240 dB, beyond any camera's"),
    ({"gain_db": "12"}, "type must be number"),
    ({"noise_line": [{"slope_dn": 1e300, "offset_dn2": 1, "gain_dn_per_e": 1}] * 4}, "slope_dn is 1e+300"),
    ({"reference_file": "frame.npy", "reference_ratio": 1e39}, "reference_ratio is 1e+39"),
])
def test_damaged_records_of_runs_are_one_line_that_names_them(malus, refused, tmp_path, changes, words):
    np.save(tmp_path / "frame.npy", np.full((32, 48), 500, np.uint16))
    malus("denoise", tmp_path / "frame.npy", "--layout", "polar-mono", "--black", 80, "--white", 4095, "--model", "imx250mzr-simulated",
          "--gain", 12, "-o", tmp_path)
    path = tmp_path / "frame_denoised.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | changes))
    error = refused("report", path, "-o", tmp_path / "page.html")
    assert "frame_denoised.json" in error and words in error


def test_what_a_page_is_made_of_is_never_replaced(malus, refused, tmp_path):
    np.save(tmp_path / "frame.npy", np.full((32, 48), 500, np.uint16))
    np.save(tmp_path / "ideal.npy", np.full((32, 48), 420, np.float32))
    malus("denoise", tmp_path / "frame.npy", "--layout", "polar-mono", "--black", 80, "--white", 4095, "--model", "imx250mzr-simulated",
          "--gain", 12, "--reference", tmp_path / "ideal.npy", "-o", tmp_path / "out")
    for made, read in ((tmp_path / "out/frame_denoised.json", ["out/frame_denoised.json", "out/frame_denoised.tif", "frame.npy", "ideal.npy"]),
                       (record(tmp_path), ["record.json", "clean.npy", "noisy.npy"])):
        for path in (tmp_path / name for name in read):
            before = path.read_bytes()
            assert f"--output {path}: is an input and would be replaced" in refused("report", made, "-o", path, "--force")
            assert path.read_bytes() == before
        malus("report", made, "-o", tmp_path / "page.html", "--force")


def test_a_number_that_is_no_double_is_one_line(refused, tmp_path):
    (tmp_path / "made.json").write_text('{"kind": "denoise", "white_dn": 1e999}')
    assert "made.json: is not JSON: " in refused("report", tmp_path / "made.json", "-o", tmp_path / "page.html")


@pytest.mark.parametrize("layout, columns", [("bayer-rggb", 2), ("mono", 2), ("polar-mono", 5)])
@pytest.mark.parametrize("tests", [1, 2])
def test_evaluations_without_polarization_say_nothing_of_it(malus, tmp_path, layout, columns, tests):
    rng = np.random.default_rng(3)
    clean = rng.uniform(200, 900, (64, 64)).astype(np.float32)
    np.save(tmp_path / "clean.npy", clean)
    for n in range(tests):
        np.save(tmp_path / f"noisy{n}.npy", clean + rng.normal(0, 20, clean.shape).astype(np.float32))
    malus("evaluate", "--reference", tmp_path / "clean.npy", "--test", *[tmp_path / f"noisy{n}.npy" for n in range(tests)],
          "--layout", layout, "--white", 1000, "--report", tmp_path / "page.html")
    blocks = page_data(tmp_path / "page.html")["sections"][0]["blocks"]
    assert [len(blocks[0]["columns"])] + [len(row["cells"]) for row in blocks[0]["rows"]] == [columns] * (1 + tests)
    polarized = columns == 5
    assert ("AoLP" in json.dumps(blocks, ensure_ascii=False)) == polarized
    assert len(blocks) == 1 + (columns if tests > 1 else 0)


def test_equal_pictures_have_an_infinite_psnr_on_the_page_too(malus, tmp_path):
    light = np.random.default_rng(5).uniform(200, 900, (64, 64)).astype(np.float32)
    for name, noise in (("clean", 0), ("equal", 0), ("other", 20)):
        np.save(tmp_path / f"{name}.npy", light + np.float32(noise))
    run = malus("evaluate", "--reference", tmp_path / "clean.npy", "--test", tmp_path / "equal.npy", tmp_path / "other.npy", "--layout",
                "polar-mono", "--white", 1000, "--json", "--report", tmp_path / "page.html")
    for parameter in ("image", "dolp", "aolp"):
        assert run.json["results"][0][parameter]["psnr"] is None and run.json["results"][0][parameter]["equal"] is True
        assert "equal" not in run.json["results"][1][parameter]
    equal, other = page_data(tmp_path / "page.html")["sections"][0]["blocks"][0]["rows"]
    assert [cell if cell == "infinite" else cell["value"] for cell in equal["cells"]] == ["infinite", 1, "infinite", "infinite", 0]
    assert all(cell["value"] is not None for cell in other["cells"])


def test_pictures_of_one_name_are_told_apart_by_their_folders(malus, tmp_path):
    rng, tests = np.random.default_rng(4), []
    clean = rng.uniform(200, 900, (32, 32)).astype(np.float32)
    np.save(tmp_path / "clean.npy", clean)
    for name in ("a/x/noisy.npy", "b/x/noisy.npy", "other.npy"):
        tests.append(tmp_path / name)
        tests[-1].parent.mkdir(parents=True, exist_ok=True)
        np.save(tests[-1], clean + rng.normal(0, 20, clean.shape).astype(np.float32))
    malus("evaluate", "--reference", tmp_path / "clean.npy", "--test", *tests, tests[0], "--layout", "mono", "--white", 1000,
          "--report", tmp_path / "page.html")
    rows = page_data(tmp_path / "page.html")["sections"][0]["blocks"][0]["rows"]
    assert [row["name"] for row in rows] == ["a/x/noisy.npy", "b/x/noisy.npy", "other.npy", "a/x/noisy.npy"]


FULL_MODEL = pathlib.Path(__file__).resolve().parents[2] / "fuzz/corpus/model/good_full.h5"


def changed_model(folder, name, values):
    """A model of all kinds with one data set changed; None takes it out."""
    path = folder / "model.h5"
    shutil.copy(FULL_MODEL, path)
    with h5py.File(path, "r+", libver="latest") as file:
        kept = np.asarray(file[name][()])
        attributes = dict(file[name].attrs)
        del file[name]
        if values is not None:
            file.create_dataset(name, data=np.broadcast_to(np.asarray(values, kept.dtype), kept.shape)).attrs.update(attributes)
    return path


@pytest.mark.parametrize("name, value, words", [
    ("physics/000/dark_shading_dn", np.nan, "dark_shading holds a value that is not finite"),
    ("physics/000/photon_transfer/mean_dn", np.nan, "photon transfer holds a value that is not finite"),
    ("physics/000/residual_cell_dn", 0, "residual cells are 0 DN wide"),
    ("defects/row", 1048000, "a defect pixel lies outside, in row 1048000"),
])
def test_models_that_no_page_can_be_made_of_are_refused(refused, tmp_path, name, value, words):
    assert words in refused("report", changed_model(tmp_path, name, value), "-o", tmp_path / "page.html", timeout=60)


def test_the_text_and_the_page_give_a_mean_one_error(malus, tmp_path):
    """Pixels of other channels are others: their PRNU's errors are independent, and that of the mean is smaller than theirs."""
    model = changed_model(tmp_path, "physics/000/prnu", [0.01, 0.02])
    with h5py.File(model, "r+", libver="latest") as file:
        group = file["physics/000"]
        for name, error in (("prnu", [0.002, 0.001]), ("dsnu", [0.02, 0.03])):
            old = group["prnu" if name == "prnu" else "dsnu_dn"]
            made = group.create_dataset("prnu_stderr" if name == "prnu" else "dsnu_stderr_dn", data=error)
            made.attrs.update(dict(old.attrs))
    text = malus("model", "show", model).out
    assert re.search(r"PRNU 1\.50±0\.11 %", text) and re.search(r"DSNU 0\.\d\d±0\.0[23] DN", text), text
    malus("report", model, "-o", tmp_path / "page.html")
    tables = [b for s in page_data(tmp_path / "page.html")["sections"] for b in s["blocks"] if b["kind"] == "table" and b["title"] == "Data sheet"]
    (prnu,) = [row for row in tables[0]["rows"] if "PRNU" in row["name"]]
    assert prnu["cells"][0]["error"] == pytest.approx(100 * np.hypot(0.002, 0.001) / 2)


@pytest.mark.parametrize("row_noise, scale", [([0.08, 0.1], "log"), ([0.08, 0], "linear")])
def test_a_value_of_zero_has_its_place_among_those_over_gain(malus, tmp_path, row_noise, scale):
    malus("report", changed_model(tmp_path, "physics/000/sigma_row/mean", row_noise), "-o", tmp_path / "page.html")
    charts = [entry["chart"] for s in page_data(tmp_path / "page.html")["sections"] for b in s["blocks"] if b["kind"] == "charts" for entry in b["charts"]]
    assert [chart["y"]["scale"] for chart in charts if chart["title"] == "Row noise σ_b over gain"] == [scale]


def test_levels_without_counts_are_drawn_whole(malus, tmp_path):
    model = changed_model(tmp_path, "nonparametric/000/channels/000/samples", None)
    malus("report", model, "-o", tmp_path / "page.html")
    assert "Noise per level" in (tmp_path / "page.html").read_text(encoding="utf-8")


def test_a_level_below_black_has_an_error_without_a_sign(malus, tmp_path):
    malus("report", changed_model(tmp_path, "physics/000/photon_transfer/mean_dn", -0.5), "-o", tmp_path / "page.html")
    charts = [entry["chart"] for s in page_data(tmp_path / "page.html")["sections"] for b in s["blocks"] if b["kind"] == "charts" for entry in b["charts"]]
    series = [one for c in charts if c["title"].startswith("Signal to noise") for one in c["series"] if one["error"]]
    assert any(y is not None and y < 0 for one in series for y in one["y"])
    assert all(error >= 0 for one in series for error in one["error"])


@pytest.mark.slow
@pytest.mark.parametrize("value", [None, 0, 1e-300, np.nan])
def test_any_one_damage_is_one_line_or_a_page(tmp_path, value):
    names = []
    with h5py.File(FULL_MODEL) as file:
        file.visititems(lambda name, item: names.append(name) if isinstance(item, h5py.Dataset) else None)
        names = [name for name in names if "/001" not in name and (value is None or file[name].dtype.kind == "f")]
    for name in names:
        done = subprocess.run([PROGRAM, "report", changed_model(tmp_path, name, value), "-o", tmp_path / "page.html", "--force", "-q"],
                              capture_output=True, text=True, timeout=60)
        assert done.returncode in (0, 1), (name, done.stderr)
        if done.returncode == 1:
            assert done.stderr.startswith("malus: ") and done.stderr.count("\n") == 1, (name, done.stderr)


def test_full_disk_leaves_no_page(malus, small_disk, tmp_path):
    """In one line; what was there before stays as it was."""
    np.save(tmp_path / "f.npy", np.random.default_rng(1).integers(20, 200, (128, 128), dtype=np.uint8))
    denoise = ["denoise", tmp_path / "f.npy", "--layout", "polar-mono", "--black", 0, "--white", 255, "-o", tmp_path, "-q"]
    malus(*denoise)
    page = small_disk / "page.html"
    for old in ([], ["page.html"]):
        for command in (["report", tmp_path / "f_denoised.json", "-o", page, "--figures", small_disk / "figures"],
                        [*denoise, "--report", page]):
            (line,) = (line for line in malus(*command, "--force", code=1).err.splitlines() if "warning: " not in line)
            assert line == f"malus: {page}: cannot be written: the disk is full; free some space or choose another output"
            assert [path.name for path in small_disk.iterdir()] == old
        page.write_text("old")
    assert page.read_text() == "old"
