"""malus report of records: tables, curves and pictures land in the page; bad records are one line."""
import json
import re

import numpy as np
import pytest


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


@pytest.mark.parametrize("changes, words", [
    ({"tables": [{"title": "no columns"}]}, "does not hold what a page needs"),
    ({"pictures": [{"title": "x", "layout": "polar-mono", "white_dn": 4095, "files": [{"name": "a", "file": "none.npy"}]}]}, "none.npy"),
    ({"pictures": [{"title": "x", "layout": "polar-mini", "white_dn": 4095, "files": []}]}, "polar-mini"),
])
def test_bad_records_are_one_line_and_leave_nothing(refused, tmp_path, changes, words):
    error = refused("report", record(tmp_path, **changes), "-o", tmp_path / "page.html")
    assert words in error
    assert not (tmp_path / "page.html").exists()


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
