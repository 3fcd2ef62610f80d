"""What an earlier run left in another format is no result of this one: refused as the same file is, removed with --force."""

import numpy as np
import pytest
from PIL import Image

LAYOUT = ["--layout", "polar-mono", "--black", "0", "--white", "4095"]
MODEL = ["--model", "imx250mzr-simulated"]


@pytest.fixture
def raw(tmp_path):
    np.save(tmp_path / "f.npy", np.random.default_rng(3).normal(400, 20, (48, 64)).clip(0).astype(np.uint16))
    np.save(tmp_path / "clean.npy", np.full((16, 16), 300, np.float32))
    Image.fromarray(np.random.default_rng(4).integers(9, 200, (16, 16, 3), dtype=np.uint8)).save(tmp_path / "p.png")
    return tmp_path / "f.npy"


def names(folder):
    return {path.name for path in folder.iterdir()}


@pytest.mark.parametrize("command,old,others,new", [
    (["denoise", "f.npy", *LAYOUT, *MODEL, "--gain", 12, "--profile", "fast"], "f_denoised.tif", {"f_denoised.json"}, "npy"),
    (["stokes", "f.npy", *LAYOUT, "--no-pictures"], "f_s0.exr", {f"f_{name}.exr" for name in ("s1", "s2", "dolp", "aolp")}, "fits"),
    (["synthesize", "clean.npy", *MODEL, "--gain", 12], "clean_000.tif", set(), "png"),
    (["renoise", "f.npy", *LAYOUT, *MODEL, "--from", 12, "--to", 24], "f_renoised.tif", set(), "fits"),
    (["simulate", "p.png"], "p_clean.tif", set(), "exr")])
def test_a_result_in_another_format_is_replaced_with_force_alone(malus, refused, raw, tmp_path, command, old, others, new):
    out = tmp_path / "out"
    malus(*command, "-o", out, cwd=tmp_path)
    assert names(out) == {old} | others
    (out / "f_denoised.json").unlink(missing_ok=True)  # which is refused first
    (out / "mine.npy").touch()
    line = refused(*command, "-o", out, "--format", new, cwd=tmp_path)
    assert f"{old}: exists already, the same result as {old.rsplit('.')[0]}.{new} in another format; use --force" in line
    assert old in names(out)
    malus(*command, "-o", out, "--format", new, "--force", cwd=tmp_path)
    assert names(out) == {name if name.endswith("json") else f"{name.rsplit('.')[0]}.{new}" for name in {old} | others} | {"mine.npy"}


def test_what_is_read_is_no_earlier_result(malus, raw, tmp_path):
    raw.rename(tmp_path / "f_denoised.npy")
    np.save(raw, np.load(tmp_path / "f_denoised.npy"))
    run = ["denoise", raw, *LAYOUT, *MODEL, "--gain", 12, "--profile", "fast", "--reference", tmp_path / "f_denoised.npy", "-o", tmp_path]
    malus(*run)
    malus(*run, "--force")
    assert {"f_denoised.npy", "f_denoised.tif"} <= names(tmp_path)


def test_the_truth_of_another_scene_goes_with_its_mosaic(malus, raw, tmp_path):
    out = tmp_path / "out"
    out.mkdir()
    (out / "p_s0.exr").touch()  # of malus stokes p.tif: not of a scene
    malus("simulate", tmp_path / "p.png", "-o", out, "--force")
    assert names(out) == {"p_s0.exr", "p_clean.tif"}
    malus("simulate", tmp_path / "p.png", "-o", out, "--force", "--truth", "--polarized")
    assert len(names(out)) == 7
    malus("simulate", tmp_path / "p.png", "-o", out, "--force", "--truth", "--format", "npy")
    assert "p_normals.exr" not in names(out) and len(names(out)) == 6
    malus("simulate", tmp_path / "p.png", "-o", out, "--force")
    assert names(out) == {"p_clean.tif"}
