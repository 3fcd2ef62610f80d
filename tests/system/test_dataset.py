"""Data sets of tar shards, as many workers, killed runs and numpy see them."""

import io
import json
import os
import signal
import subprocess
import tarfile
import time

import numpy as np
import pytest

from conftest import PROGRAM

pytestmark = [pytest.mark.slow, pytest.mark.alone]

MODEL = "imx250myr-simulated"


def smooth_scene(rows, cols, low=200, high=1500):
    y, x = np.mgrid[:rows, :cols]
    return (low + (high - low) * (0.5 + 0.25 * np.sin(x / 9) + 0.25 * np.cos(y / 7))).astype(np.float32)


def write_plan(folder, samples=40, shard_size=8, extra=""):
    np.save(folder / "a_clean.npy", smooth_scene(160, 192))
    np.save(folder / "b_clean.npy", smooth_scene(128, 128, 20, 300))
    plan = folder / "plan.toml"
    plan.write_text(f'model = "{MODEL}"\nclean = ["*_clean.npy"]\n[dataset]\nsamples = {samples}\nshard_size = {shard_size}\n'
                    f'patch = 64\nratios = [4, 20]\n{extra}')
    return plan


def shards(folder):
    return {path.name: path.read_bytes() for path in sorted(folder.glob("shard-*.tar"))}


def test_dataset_holds_pairs_that_numpy_reads(malus, tmp_path):
    plan = write_plan(tmp_path)
    result = malus("dataset", plan, "-o", tmp_path / "out", "--seed", 9, "--json").json
    assert result["shards"] == result["made"] == 5
    sources = {name: np.load(tmp_path / name) for name in ("a_clean.npy", "b_clean.npy")}
    seen, residual = 0, []
    for content in shards(tmp_path / "out").values():
        with tarfile.open(fileobj=io.BytesIO(content)) as tar:
            files = {member.name: tar.extractfile(member).read() for member in tar}
        for name in (n for n in files if n.endswith(".json")):
            facts = json.loads(files[name])
            clean, noisy = (np.load(io.BytesIO(files[name.replace("json", f"{what}.npy")])) for what in ("clean", "noisy"))
            assert clean.shape == noisy.shape == (16, 16, 16) and clean.dtype == np.float32
            assert facts["ratio"] in (4, 20) and 0 <= facts["gain_db"] <= 30
            source = sources[facts["source"]]
            assert source.min() - 1e-3 <= clean.min() and clean.max() <= source.max() + 1e-3
            if facts["symmetry"] == "identity":
                patch = source[facts["row"]:facts["row"] + 64, facts["col"]:facts["col"] + 64]
                packed = patch.reshape(16, 4, 16, 4).transpose(1, 3, 0, 2).reshape(16, 16, 16)
                assert np.array_equal(clean, packed)
            residual.append(((noisy - clean).mean(), (noisy - clean).std()))
            seen += 1
    assert seen == 40
    mean, spread = np.array(residual).T
    assert abs(mean.mean()) < 5 * spread.max() / np.sqrt(40) and (spread > 1).all()
    assert len({round(s, 3) for s in spread}) == 40  # every sample has noise of its own


def test_dataset_is_the_same_for_any_number_of_workers(malus, tmp_path):
    plan = write_plan(tmp_path)
    malus("dataset", plan, "-o", tmp_path / "one", "--threads", 1)
    for rank, names in ((0, ("RANK", "WORLD_SIZE")), (1, ("SLURM_PROCID", "SLURM_NTASKS"))):
        environment = {**os.environ, names[0]: str(rank), names[1]: "2"}
        malus("dataset", plan, "-o", tmp_path / "two", env=environment)
    for rank in range(3):
        malus("dataset", plan, "-o", tmp_path / "three", "--rank", rank, "--world", 3)
    assert shards(tmp_path / "one") == shards(tmp_path / "two") == shards(tmp_path / "three")


def test_killed_dataset_goes_on_to_the_same_bytes(malus, tmp_path):
    plan = write_plan(tmp_path, samples=800, shard_size=8)
    out = tmp_path / "killed"
    process = subprocess.Popen([PROGRAM, "dataset", str(plan), "-o", str(out), "--threads", "1", "-q"],
                               stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    deadline = time.monotonic() + 60
    while len(shards(out) if out.is_dir() else {}) < 3 and time.monotonic() < deadline:
        time.sleep(0.005)
    process.send_signal(signal.SIGKILL)
    process.wait()
    done = shards(out)
    assert 3 <= len(done) < 100
    for content in done.values():  # whatever has its name is whole
        assert len(tarfile.open(fileobj=io.BytesIO(content)).getmembers()) == 24
    result = malus("dataset", plan, "-o", out, "--json").json
    assert result["kept"] == len(done) and result["made"] == 100 - len(done)
    malus("dataset", plan, "-o", tmp_path / "whole")
    assert shards(out) == shards(tmp_path / "whole")
    assert not list(out.glob(".*"))  # what the killed run had begun is gone


def test_dataset_refuses_bad_plans(malus, refused, tmp_path):
    plan = write_plan(tmp_path)
    malus("dataset", plan, "-o", tmp_path / "out")
    assert "other settings" in refused("dataset", plan, "-o", tmp_path / "out", "--seed", 1)
    for alone in (["--rank", 0], ["--world", 2]):
        assert "requires" in malus("dataset", plan, "-o", tmp_path / "new", *alone, code=2).err
    for many in (["--rank", 5, "--world", 2147483647], ["--rank", "010", "--world", 99], ["--rank", -1, "--world", 2]):
        assert "must be a whole number" in malus("dataset", plan, "-o", tmp_path / "new", *many, code=2).err
    assert "does not exist" in refused("dataset", plan, "-o", tmp_path / "new", "--rank", 2, "--world", 2)
    for name, value in (("RANK", "first"), ("WORLD_SIZE", "0"), ("WORLD_SIZE", "2x")):
        refused("dataset", plan, "-o", tmp_path / "new", env={**os.environ, name: value})
    text = plan.read_text()
    for old, new, words in (("patch = 64", "patch = 66", "whole cells"), ("patch = 64", "patch = 4000", "holds no patch"),
                            ("*_clean", "*_none", "matches no file"), ("ratios", "ratio", "ratios"),
                            (f'"{MODEL}"', '"nothing"', "nothing"), ("ratios = [4, 20]", "ratios = []", "empty")):
        plan.write_text(text.replace(old, new))
        assert words in refused("dataset", plan, "-o", tmp_path / "new")
    for old, new, words in (("patch = 64", "patch = 63", "plan.toml:6: patch in [dataset] = 63 is not made of whole cells of 4 x 4"),
                            (f'"{MODEL}"', '"nothing"', "plan.toml:1: model in the data-set configuration: nothing: "),
                            (f'model = "{MODEL}"\n', "", "plan.toml:1: model in the data-set configuration is missing; "),
                            ("patch = 64", "patch = 64\ngains = [90]", "plan.toml:7: gains in [dataset]: ")):
        plan.write_text(text.replace(old, new))
        assert words in refused("dataset", plan, "-o", tmp_path / "new")
    np.save(tmp_path / "integers.npy", np.full((128, 128), 500, np.uint16))
    plan.write_text(text.replace("*_clean", "integers"))
    assert "black level is not known" in refused("dataset", plan, "-o", tmp_path / "new")
    assert not (tmp_path / "new").exists() or not list((tmp_path / "new").glob("*.tar"))


def begin_and_kill(plan, out, *flags, after):
    """Starts a data set and kills the run once `after()` holds."""
    process = subprocess.Popen([PROGRAM, "dataset", str(plan), "-o", str(out), "--threads", "1", "-q", *flags],
                               stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    deadline = time.monotonic() + 60
    while not after() and process.poll() is None and time.monotonic() < deadline:
        time.sleep(0.002)
    process.kill()
    process.wait()


def test_a_killed_replacement_never_mixes_two_sets(malus, refused, tmp_path):
    plan, out = write_plan(tmp_path, samples=240), tmp_path / "out"
    for seed in (3, 4):
        malus("dataset", plan, "-o", tmp_path / f"whole{seed}", "--seed", seed)
    old, new = shards(tmp_path / "whole3"), shards(tmp_path / "whole4")

    def seed_of_folder():
        try:
            return json.loads((out / "dataset.json").read_text())["seed"]
        except FileNotFoundError:
            return None

    moments = {"old shards go": lambda: seed_of_folder() != 3,
               "new shards come": lambda: seed_of_folder() == 4 and len(list(out.glob("shard-*.tar"))) > 3}
    for moment, reached in moments.items():
        malus("dataset", plan, "-o", out, "--seed", 3, "--force")
        assert shards(out) == old and not list(out.glob(".*"))
        begin_and_kill(plan, out, "--seed", "4", "--force", after=reached)
        left = shards(out)
        if any(new[name] != content for name, content in left.items()):
            assert moment == "old shards go" and seed_of_folder() is None
            assert "another data set" in refused("dataset", plan, "-o", out, "--seed", 4)
            assert shards(out) == left
        else:
            malus("dataset", plan, "-o", out, "--seed", 4)
            assert shards(out) == new


def test_shards_without_their_description_tell_whose_they_are(malus, refused, tmp_path):
    plan, out = write_plan(tmp_path), tmp_path / "out"
    malus("dataset", plan, "-o", out, "--seed", 3)
    whole = shards(out)
    (out / "dataset.json").unlink()
    (out / "shard-000000.tar").unlink()
    assert "another data set" in refused("dataset", plan, "-o", out, "--seed", 4)
    assert not (out / "dataset.json").exists()
    assert malus("dataset", plan, "-o", out, "--seed", 3, "--json").json["made"] == 1
    assert shards(out) == whole


def test_a_smaller_set_leaves_nothing_of_the_larger(malus, tmp_path):
    malus("dataset", write_plan(tmp_path), "-o", tmp_path / "out")
    (tmp_path / "out/shard-notes.tar").write_bytes(b"not ours")
    malus("dataset", write_plan(tmp_path, samples=16), "-o", tmp_path / "out", "--force")
    assert list(shards(tmp_path / "out")) == ["shard-000000.tar", "shard-000001.tar", "shard-notes.tar"]


def test_workers_that_replace_a_set_at_once_agree(malus, tmp_path):
    plan, out = write_plan(tmp_path, samples=80), tmp_path / "out"
    malus("dataset", plan, "-o", tmp_path / "whole", "--seed", 6)
    for old in (5, 6):  # 6: the same set again
        malus("dataset", plan, "-o", out, "--seed", old, "--force")
        workers = [subprocess.Popen([PROGRAM, "dataset", str(plan), "-o", str(out), "--seed", "6", "--force", "-q",
                                     "--rank", str(rank), "--world", "4"], stdout=subprocess.DEVNULL) for rank in range(4)]
        assert [worker.wait(timeout=120) for worker in workers] == [0] * 4
        assert shards(out) == shards(tmp_path / "whole")
    for rank in (1, 0):  # one after the other: the second leaves the first one's
        malus("dataset", plan, "-o", out, "--seed", 7, "--force", "--rank", rank, "--world", 2)
    malus("dataset", plan, "-o", tmp_path / "seven", "--seed", 7)
    assert shards(out) == shards(tmp_path / "seven")


def test_a_set_goes_on_with_the_same_inputs_alone(malus, refused, tmp_path):
    (tmp_path / "a").mkdir()
    np.save(tmp_path / "a/integers.npy", np.full((128, 128), 500, np.uint16))
    plan, out = tmp_path / "a/plan.toml", tmp_path / "out"
    text = f'model = "{MODEL}"\nclean = ["integers.npy"]\nblack = 0\n[dataset]\nsamples = 16\nshard_size = 8\npatch = 64\n'
    plan.write_text(text)
    malus("dataset", plan, "-o", out)
    whole = shards(out)
    (out / "shard-000001.tar").unlink()
    plan.write_text(text.replace("black = 0", "black = 500"))
    assert "other settings or inputs (black: [0.0], now [500.0])" in refused("dataset", plan, "-o", out)
    plan.write_text(text)
    np.save(tmp_path / "a/integers.npy", np.full((128, 128), 501, np.uint16))  # as many bytes
    assert "other settings or inputs" in refused("dataset", plan, "-o", out)
    np.save(tmp_path / "a/integers.npy", np.full((128, 128), 500, np.uint16))
    (tmp_path / "a").rename(tmp_path / "moved")
    assert malus("dataset", tmp_path / "moved/plan.toml", "-o", out, "--json").json["made"] == 1
    assert shards(out) == whole
    (out / "shard-000001.tar").write_bytes(whole["shard-000001.tar"][:3000])
    assert "shard-000001.tar" in refused("dataset", tmp_path / "moved/plan.toml", "-o", out)
    (tmp_path / "moved/plan.toml").write_text(text.replace("black = 0", "black = nan"))
    assert "black" in refused("dataset", tmp_path / "moved/plan.toml", "-o", tmp_path / "new")


def test_a_gain_that_the_model_lacks_is_named_before_anything_is_written(refused, malus, tmp_path):
    plan = write_plan(tmp_path, samples=8, extra="gains = [0, 99]\n")
    line = refused("dataset", plan, "-o", tmp_path / "out")
    assert str(plan) in line and "gains in [dataset]: 99 dB" in line
    assert not (tmp_path / "out").exists()
    plan.write_text(plan.read_text().replace("99", "9"))
    malus("dataset", plan, "-o", tmp_path / "out")


def test_pictures_of_another_scale_are_said(malus, tmp_path):
    """Of 0 to 1, or of 16 bits for a camera of 12: noise was drawn of them, and data sets made, without a word."""
    scene = smooth_scene(128, 128)
    said = {"unit_clean.npy": "no pixel is brighter than 1 DN", "wide_clean.npy": "brighter than white, 4013 DN"}
    np.save(tmp_path / "unit_clean.npy", scene / 4000)
    np.save(tmp_path / "wide_clean.npy", scene * 16)
    np.save(tmp_path / "right.npy", scene)
    for name, words in said.items():
        (tmp_path / "plan.toml").write_text(f'model = "{MODEL}"\nclean = ["{name}"]\n[dataset]\nsamples = 2\npatch = 64\n')
        for run in (["dataset", tmp_path / "plan.toml", "-o", tmp_path / f"set_{name}"],
                    ["synthesize", tmp_path / name, tmp_path / name.replace("clean", "copy"), "-m", MODEL, "--gain", 12, "-o", tmp_path / "out"]):
            np.save(tmp_path / name.replace("clean", "copy"), np.load(tmp_path / name))
            lines = [line for line in malus(*run).err.splitlines() if line.startswith("warning")]
            assert len(lines) == 1 and name in lines[0] and words in lines[0], lines
    assert "warning" not in malus("synthesize", tmp_path / "right.npy", "-m", MODEL, "--gain", 12, "-o", tmp_path / "out").err
