"""What the documentation shows as files to write is taken by the program as it stands there."""

import re

import numpy as np
import pytest

from conftest import ROOT, needs_networks


def toml_blocks(name):
    return re.findall(r"```toml\n(.*?)```", (ROOT / "docs" / name).read_text(), re.DOTALL)


def test_data_set_of_synthesis_is_drawn(malus, tmp_path):
    text, = toml_blocks("synthesis.md")
    (tmp_path / "scenes").mkdir()
    np.save(tmp_path / "scenes/one_clean.npy", np.full((300, 300), 500, np.float32))
    (tmp_path / "plan.toml").write_text(text.replace("1000000", "4").replace("_clean.tif", "_clean.npy"))
    assert malus("dataset", tmp_path / "plan.toml", "-o", tmp_path / "shards", "--json").json["made"] == 1


@pytest.mark.slow
@needs_networks
def test_first_training_runs(malus, tmp_path):
    pairs, network = toml_blocks("training.md")[:2]
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    (tmp_path / "pairs.toml").write_text(pairs.replace("samples = 200", "samples = 8"))
    (tmp_path / "network.toml").write_text(re.sub("steps = .*", "steps = 2", network))
    malus("dataset", tmp_path / "pairs.toml", "-o", tmp_path / "shards")
    malus("train", tmp_path / "network.toml", "-o", tmp_path / "run")
    assert (tmp_path / "run/weights.safetensors").stat().st_size > 10_000
