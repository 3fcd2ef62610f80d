"""What a run that fails leaves behind: nothing that stops the next one, nothing half-written."""

import json

import numpy as np
import pytest

MODEL = "imx250mzr-simulated"
PHASES = {"reference": 1.0, "short": 0.1}


def write_session(folder, scenes):
    lines = ['[sensor]\nlayout = "mono"\nblack = 60\nwhite = 4095\n']
    for number, light in enumerate(scenes):
        for kind, share in PHASES.items():
            name = f"{kind}{number}.npy"
            dn = np.random.default_rng(number).normal(60 + light * share, 2, (32, 32))
            np.save(folder / name, np.round(dn).clip(0, 4095).astype(np.uint16))
            lines.append(f'[[frames]]\nkind = "{kind}"\nlevel = {number}\nexposure_s = {share}\npaths = ["{name}"]\n')
    (folder / "s.toml").write_text("\n".join(lines))
    return folder / "s.toml"


def test_pairs_that_fail_at_a_later_scene_leave_nothing(malus, refused, tmp_path):
    session = write_session(tmp_path, [1000, 1000])
    np.save(tmp_path / "reference1.npy", np.full((32, 32), 4095, np.uint16))  # all saturated: tells no light
    line = refused("pairs", session, "-o", tmp_path / "pairs")
    assert "short1.npy" in line and "reference" in line
    assert not list((tmp_path / "pairs").glob("*"))
    malus("pairs", write_session(tmp_path, [1000, 1000]), "-o", tmp_path / "pairs")
    assert len(json.loads((tmp_path / "pairs/pairs.json").read_text())["pairs"]) == 2


def test_flicker_of_frames_without_light_is_not_told(malus, tmp_path):
    session = write_session(tmp_path, [1000])
    np.save(tmp_path / "short0.npy", np.full((32, 32), 60, np.uint16))
    run = malus("pairs", session, "-o", tmp_path / "pairs", "--json")
    assert run.json["pairs"][0]["flicker"] is None
    again = malus("pairs", session, "-o", tmp_path / "pairs", "--force")
    assert "flicker unknown" in again.out


def test_a_data_set_that_failed_before_its_first_shard_is_made_after_mending(malus, refused, tmp_path):
    scene = np.full((64, 64), 500, np.float32)
    np.save(tmp_path / "clean.npy", np.where(np.arange(64) == 3, np.nan, scene).astype(np.float32))
    plan = tmp_path / "plan.toml"
    plan.write_text(f'model = "{MODEL}"\nclean = ["clean.npy"]\n[dataset]\nsamples = 4\nshard_size = 4\npatch = 32\n')
    assert "clean.npy" in refused("dataset", plan, "-o", tmp_path / "out")
    np.save(tmp_path / "clean.npy", scene)
    assert malus("dataset", plan, "-o", tmp_path / "out", "--json").json["made"] == 1
    plan.write_text(plan.read_text().replace("samples = 4", "samples = 8"))
    assert "dataset.json" in refused("dataset", plan, "-o", tmp_path / "out")  # of samples that were made


@pytest.mark.parametrize("command", [["synthesize", "clean.npy", "--gain", "6", "-o", "out"],
                                     ["renoise", "clean.npy", "--black", "0", "--white", "4095", "--from", "0", "--to", "6", "-o", "out"]])
def test_a_model_without_the_kind_is_named_by_its_file(malus, refused, tmp_path, command):
    np.save(tmp_path / "clean.npy", np.full((32, 32), 500, np.float32))
    line = refused(*command, "--model", MODEL, "--kind", "nonparametric", cwd=tmp_path)
    assert line.startswith(f"malus: {MODEL}: ") and line.endswith("or use one of: physics")


def test_a_gain_beyond_the_model_is_told_of_the_file(refused):
    assert refused("model", "show", MODEL, "--gain", "99").startswith(f"malus: {MODEL}: 99 dB: ")


def test_noise_of_frames_smaller_than_a_cell_is_not_compared(refused, tmp_path):
    for name in "abcd":
        np.save(tmp_path / f"{name}.npy", np.random.default_rng(ord(name)).normal(500, 5, (2, 4)).astype(np.float32))
    files = {name: tmp_path / f"{name}.npy" for name in "abcd"}
    line = refused("evaluate", "--noise", "--layout", "polar-bayer-rggb", "--reference", files["a"], files["b"], "--test", files["c"], files["d"])
    assert "a.npy: 4 x 2 pixels, smaller than one cell" in line


def test_a_white_that_nobody_told_is_not_judged_where_no_pixel_is_above_black(malus, tmp_path):
    np.save(tmp_path / "dark.npy", np.random.default_rng(1).normal(60, 1, (32, 32)).astype(np.float32))
    np.save(tmp_path / "zero.npy", np.zeros((32, 32), np.uint32))
    for name in ("dark", "zero"):
        run = malus("info", tmp_path / f"{name}.npy", "--layout", "mono", "--black", "64", "--json")
        assert run.json["saturated_share"]["value"] == [0]
        assert "above the white" not in run.err + run.out and "far below" not in run.err + run.out
