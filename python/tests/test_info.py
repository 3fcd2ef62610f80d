"""malus.info: what the program prints, of files, Frames and arrays."""

import json
import os
import pathlib
import subprocess

import numpy as np
import pytest

malus = pytest.importorskip("malus", reason="the Python module is not built (pybind11 is missing)")

ROOT = pathlib.Path(__file__).resolve().parents[2]
PROGRAM = pathlib.Path(os.environ.get("MALUS_PROGRAM", pathlib.Path(malus.__file__).parents[2] / "malus"))
PICTURE = ROOT / "examples/imx250mzr/fruits.png"


@pytest.mark.skipif(not PROGRAM.exists(), reason="needs the program")
def test_info_of_a_file_is_the_programs():
    done = subprocess.run([PROGRAM, "info", PICTURE, "--layout", "polar-mono", "--black", "82", "--json"], check=True, capture_output=True, text=True)
    told, printed = malus.info(PICTURE, "polar-mono", 82), json.loads(done.stdout)
    printed.pop("version", None)
    assert {name: told[name] for name in told if name != "warnings"} == {name: printed[name] for name in told if name != "warnings"}
    assert told["layout_check"]["declared"] == told["layout_check"]["winner"] == "diagonal" and told["rows"] == 2048
    frame = malus.info(malus.load_frame(PICTURE, "polar-mono", 82))
    files = {"format", "sample", "camera", "file"}
    assert {name: frame[name] for name in frame if name not in files} == {name: told[name] for name in told if name not in files}


def test_numbers_of_any_type_are_described_as_in_a_file(tmp_path):
    """Signed types have a bit less, bool one in all, and wide ones no more than float holds."""
    for kind, bits in (("u1", 8), ("u2", 16), ("u4", 24), ("u8", 24), ("i1", 7), ("i2", 15), ("i4", 24), ("i8", 24), ("?", 1), ("f4", 0), ("f8", 0)):
        codes = (np.random.default_rng(1).integers(0, 8, (64, 64)) * 16).astype(kind)
        np.save(tmp_path / "codes.npy", codes)
        of_array, of_file = malus.info(codes, "mono", 0), malus.info(tmp_path / "codes.npy", "mono", 0)
        assert of_array["bits"] == of_file["bits"] == bits, kind
        if 0 < bits <= 16:  # wider ones no camera fills: an array's white is its largest pixel
            assert of_array["white"] == of_file["white"] == 2**bits - 1 and of_array["warnings"] == of_file["warnings"], kind


def test_info_of_an_array_counts():
    mosaic = np.random.default_rng(1).normal(300, 8, (128, 128)).astype(np.float32)
    mosaic[0, :5], mosaic[1, :3], mosaic[2, 0] = 5000, 10, np.nan
    told = malus.info(mosaic, "mono", 50, 4000)
    assert told["channels"] == ["mono"] and told["nonfinite_pixels"] == 1 and told["warnings"] == ["1 pixel is NaN or infinite"]
    assert told["saturated_share"]["value"][0] == pytest.approx(5 / (128 * 128), rel=0.01)
    assert told["below_black_share"]["value"][0] == pytest.approx(3 / (128 * 128), rel=0.01)
    assert told["noise_sd"] == {"value": [pytest.approx(8, rel=0.1)], "unit": "DN"}
    assert told["noise_sd_at"] == {"value": [pytest.approx(300, abs=2)], "unit": "DN"}
    assert told["black_known"] and told["white_known"] and told["layout_known"] and told["gain_db"] is None
    assert not malus.info(mosaic)["black_known"]


def test_warnings_name_keywords():
    scaled = (np.random.default_rng(1).integers(0, 256, (64, 64)) * 16).astype(np.uint16)
    said = malus.info(scaled)["warnings"]
    assert any("all values are multiples of 16" in line for line in said)
    assert any(line.endswith("give white=4080") for line in said) and not any("--" in line for line in said)
    with pytest.raises(malus.InputError, match="^size: is of a headerless file"):
        malus.info(scaled, size=(64, 64))
