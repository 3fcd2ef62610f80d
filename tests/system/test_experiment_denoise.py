"""`malus experiment denoise`: methods scored on the same noisy frames of scenes taken behind a polarizer."""

import numpy as np
import pytest
from PIL import Image

from conftest import ROOT, needs_networks


@pytest.fixture
def scene(tmp_path):
    folder = tmp_path / "scene"
    folder.mkdir()
    rows, cols = np.mgrid[0:64, 0:64]
    for k, angle in enumerate((0, 45, 90, 135)):
        light = 110 + 40 * np.sin(cols / 9) + 30 * np.cos(rows / 7 + k)
        Image.fromarray(np.repeat(light[..., None], 3, 2).astype(np.uint8)).save(folder / f"I{angle}.png")
    return folder


def test_methods_are_scored_against_the_clean_scene(malus, scene):
    scored = malus("experiment", "denoise", scene, "--methods", "bm3d/fast", "--cases", "12:10", "--json").json["methods"]
    assert [row["name"] for row in scored] == ["noisy", "bm3d/fast"]
    assert scored[1]["image_psnr_db"] > scored[0]["image_psnr_db"] + 3


def test_every_metric_of_the_papers_table_is_told_case_by_case(malus, scene):
    run = ["experiment", "denoise", scene, "--methods", "bm3d/fast", "--json", "--cases"]
    both = malus(*run, "12:10", "12:60").json["methods"]
    for row in both:
        assert [case["case"] for case in row["by_case"]] == ["12:10", "12:60"]
        for key in ("image_psnr_db", "image_ssim", "dolp_psnr_db", "aolp_psnr_db", "aolp_circular_deg"):
            assert row[key] == pytest.approx(np.mean([case[key] for case in row["by_case"]]))
    first = malus(*run, "12:10").json["methods"]  # the seeds count up from the first case
    assert [row["by_case"][0]["image_ssim"] for row in both] == [row["image_ssim"] for row in first]
    assert first[0]["image_ssim"] < first[1]["image_ssim"] < 1 and first[0]["aolp_psnr_db"] < first[1]["aolp_psnr_db"]
    for row in first:  # no column is another's
        assert len({row[key] for key in ("image_psnr_db", "image_ssim", "dolp_psnr_db", "aolp_psnr_db", "aolp_circular_deg")}) == 5


@pytest.mark.parametrize("ending", ["png", "jpg"])
def test_a_camera_without_polarizers_takes_pictures(malus, refused, scene, tmp_path, ending):
    rows, cols = np.mgrid[0:64, 0:96]
    light = np.stack([120 + 60 * np.sin(cols / 9 + k) + 30 * np.cos(rows / 7) for k in range(3)], 2)
    Image.fromarray(light.astype(np.uint8)).save(tmp_path / f"picture.{ending}")
    run = ["experiment", "denoise", scene, tmp_path / f"picture.{ending}", "--methods", "bm3d/fast", "--cases", "1600:10"]
    done = malus(*run, "--model", "sony-a7s2", "--json", "--report", tmp_path / "page.html").json["methods"]
    assert done[1]["image_psnr_db"] > done[0]["image_psnr_db"] + 2
    assert done[1]["dolp_psnr_db"] is None and done[1]["aolp_circular_deg"] is None
    assert "one picture" in refused("experiment", "denoise", tmp_path / f"picture.{ending}", "--methods", "bm3d/fast")


def test_unpolarized_light_has_no_error_of_aolp(malus, scene, tmp_path):
    plain = tmp_path / "plain"
    plain.mkdir()
    grey = Image.fromarray(np.full((64, 64, 3), 110, np.uint8))
    for angle in (0, 45, 90, 135):
        grey.save(plain / f"I{angle}.png")
    errors, shown = [], []
    for scenes in ([scene], [plain], [scene, plain]):
        run = ["experiment", "denoise", *scenes, "--methods", "bm3d/fast", "--cases", "12:10"]
        errors.append([row["aolp_circular_deg"] for row in malus(*run, "--json").json["methods"]])
        head, _, *rows = [[cell.strip() for cell in line.split("|")] for line in malus(*run).out.splitlines()]
        shown.append(rows[-1][head.index("AoLP circular RMS [deg]")])
    assert errors[1] == [None, None] and shown[1] == "-"
    assert errors[2] == errors[0] and shown[2] == shown[0]  # the seeds count up from the first scene


def test_light_above_white_is_white(malus, tmp_path):
    """A linear picture may be brighter than the sensor's white: the truth ends there, or no result could reach it."""
    rows, cols = np.mgrid[0:64, 0:96]
    light = np.stack([0.4 + 0.2 * np.sin(cols / 9 + k) for k in range(3)], 2)
    scores = []
    for name, lamp in (("dim", 1.0), ("lamp", 9.0)):
        lit = np.where(((rows - 30) ** 2 + (cols - 40) ** 2 < 100)[..., None], lamp, light)
        np.save(tmp_path / f"{name}.npy", lit.astype(np.float32))
        scored = malus("experiment", "denoise", tmp_path / f"{name}.npy", "--model", "sony-a7s2", "--methods", "bm3d/fast", "--cases", "1600:1", "--json").json
        scores.append([row["image_psnr_db"] for row in scored["methods"]])
    assert scores[0] == scores[1]


@pytest.mark.parametrize("method", ["bm3d/fast/no-row-nois", "bm3d/fast/no-row-noise/twice", "bm3d/fast/", "bm3d/fast//"])
def test_a_part_of_a_method_that_says_nothing_is_refused(malus, scene, method):
    assert "METHOD/PROFILE/no-row-noise" in malus("experiment", "denoise", scene, "--methods", method, "--cases", "12:10", code=2).err


def test_a_gain_outside_the_model_names_no_flag_that_is_not_there(refused, scene):
    line = refused("experiment", "denoise", scene, "--methods", "bm3d/fast", "--cases", "99:10")
    assert "--cases 99:10: " in line and "outside the calibrated range" in line and "extrapolat" not in line


def test_row_noise_can_be_set(malus, scene):
    run = ["experiment", "denoise", scene, "--methods", "bm3d/fast", "--cases", "12:10"]
    psnr = [[row["image_psnr_db"] for row in malus(*run, "--row-noise", noise, "--json").json["methods"]] for noise in (0, 2)]
    # Offsets of twice the read noise add four times its variance to the noisy frame; the filter knows of them.
    assert psnr[1][0] < psnr[0][0] - 1
    assert psnr[1][1] - psnr[1][0] > psnr[0][1] - psnr[0][0] - 4


def test_stated_errors_are_compared_with_the_true_ones(malus, scene):
    run = ["experiment", "uncertainty", scene, "--cases", "12:10", "24:10"]
    rows = malus(*run, "--json").json["rows"]
    assert [row["case"] for row in rows] == ["12:10", "24:10"]
    for row in rows:
        # A small smooth picture is the hardest case there is: docs/uncertainty.md.
        assert 0.2 < row["error_over_stated"]["pixel"] < 10
        assert set(row["coverage"]) == {"pixel", "s0", "s1", "s2", "dolp", "aolp"}
        assert all(0.3 < share <= 1 for share in row["coverage"].values())
    shown = malus(*run).out
    assert "| scene | gain : ratio | method |" in shown and shown.startswith("Cells: squared error over the stated variance")
    both = malus(*run, "--methods", "bm3d", "nl-ridge", "--json").json["rows"]
    assert [(row["case"], row["method"]) for row in both] == [
        (case, method) for case in ("12:10", "24:10") for method in ("bm3d", "nl-ridge")]
    assert both[1::2] == rows  # the default
    assert 0.2 < both[1]["error_over_stated"]["pixel"] < 10
    assert "vst-bm3d gives none" in malus(*run, "--methods", "vst-bm3d", code=2).err
    assert "--profile: \"fine\" is not known; known: fast, normal, high" in malus(*run, "--profile", "fine", code=2).err


@pytest.mark.parametrize("damage, said", [
    (lambda folder: Image.new("RGB", (32, 64)).save(folder / "I45.png"), "another size"),
    (lambda folder: Image.new("L", (64, 64)).save(folder / "I45.png"), "other channels"),
    (lambda folder: (folder / "I45.png").unlink(), "holds no picture I45"),
])
def test_pictures_that_are_no_scene_are_refused(refused, scene, damage, said):
    damage(scene)
    assert said in refused("experiment", "denoise", scene, "--methods", "bm3d/fast", "--cases", "12:10")


@pytest.mark.slow
@needs_networks
@pytest.mark.parametrize("weights, camera, case", [("polar-bayer", "imx250myr-simulated", "12:10"), ("bayer", "sony-a7s2", "6400:10")])
def test_shipped_weights_do_no_harm(malus, scene, weights, camera, case):
    """On a scene unlike their training: as good as the classical default that they correct, within a tenth of a dB."""
    done = malus("experiment", "denoise", scene, "--model", camera, "--cases", case, "--json",
                 "--methods", "nl-ridge", ROOT / f"models/{weights}.safetensors").json["methods"]
    noisy, classical, network = (row["image_psnr_db"] for row in done)
    assert network > noisy + 3 and network > classical - 0.1


@pytest.mark.slow
@needs_networks
def test_a_shipped_network_knows_its_error(malus, scene):
    """As the classical default that it corrects: two stated deviations hold the truth as often, within 2 of 100 pixels."""
    rows = malus("experiment", "uncertainty", scene, "--cases", "12:10", "12:60", "--json",
                 "--methods", "nl-ridge", ROOT / "models/polar-bayer.safetensors").json["rows"]
    for classical, network in zip(rows[::2], rows[1::2]):
        for quantity in ("pixel", "s0", "dolp"):
            assert network["coverage"][quantity] > classical["coverage"][quantity] - 0.02, (quantity, network, classical)
