"""`malus experiment denoise`: methods scored on the same noisy frames of scenes taken behind a polarizer."""

import numpy as np
import pytest
from PIL import Image


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


@pytest.mark.parametrize("damage, said", [
    (lambda folder: Image.new("RGB", (32, 64)).save(folder / "I45.png"), "another size"),
    (lambda folder: Image.new("L", (64, 64)).save(folder / "I45.png"), "other channels"),
    (lambda folder: (folder / "I45.png").unlink(), "holds no picture I45"),
])
def test_pictures_that_are_no_scene_are_refused(refused, scene, damage, said):
    damage(scene)
    assert said in refused("experiment", "denoise", scene, "--methods", "bm3d/fast", "--cases", "12:10")
