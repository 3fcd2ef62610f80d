"""`malus bench`: what it reports and compares; no timing is judged."""

import pytest

from conftest import needs_networks

PEER = """import json, sys
print(json.dumps([{"name": "theirs", "value": 0.5, "unit": "Mpx/s", "note": " ".join(sys.argv[1:]), "compared": "physics"}]))
"""


def lines_of(result, benchmark):
    return {line["name"]: line for line in result.json[benchmark]}


def test_peers_run_beside_it_and_are_compared(malus, tmp_path):
    (tmp_path / "synthesize_theirs.py").write_text(PEER)
    (tmp_path / "bm3d_other.py").write_text("raise SystemExit(1)")  # of a benchmark that does not run
    lines = lines_of(malus("bench", "--only", "synthesize", "--quick", "--peers", tmp_path, "--json"), "synthesize")
    assert lines["theirs"]["note"] == "--quick"
    ours = [name for name in lines if name.startswith("physics") and lines[name]["unit"] == "Mpx/s"]
    assert ours
    for name in ours:
        assert lines[name]["value"] > 0
        assert lines[name + ", ratio"]["value"] == pytest.approx(lines[name]["value"] / 0.5)


def test_a_peer_that_fails_is_named(refused, tmp_path):
    (tmp_path / "bm3d_other.py").write_text("raise SystemExit(1)")
    assert "bm3d_other.py" in refused("bench", "--only", "bm3d", "--quick", "--peers", tmp_path, "-q")


@pytest.mark.parametrize("lines", ['[{"value": "fast"}]', '[{"name": 3}]', "[7]", '[{"note": []}]'])
def test_a_peer_whose_lines_are_no_results_is_named(refused, tmp_path, lines):
    (tmp_path / "bm3d_other.py").write_text(f"print({lines!r})")
    line = refused("bench", "--only", "bm3d", "--quick", "--peers", tmp_path, "-q")
    assert "bm3d_other.py" in line and "no lines of results" in line


def test_notes_tell_the_size_that_was_timed(malus):
    notes = [line["note"] for line in malus("bench", "--only", "bm3d", "--quick", "--json").json["bm3d"]]
    assert notes[-1] == "16 x 64x48, matched on three channels"


@needs_networks
def test_chosen_networks_alone_are_timed(malus, tmp_path):
    (tmp_path / "networks_theirs.py").write_text(PEER)
    lines = lines_of(malus("bench", "--only", "networks", "--network", "unet", "--quick", "--peers", tmp_path, "--json"), "networks")
    assert lines.pop("theirs")["note"] == "--quick --network unet"
    assert lines and all(name.startswith("unet, ") for name in lines)
    told = malus("bench", "--only", "networks", "--network", "unett", "--quick", "-q", code=2).err
    assert '--network: "unett" is no network of this benchmark; did you mean unet? known: ' in told and "nafnet-32" in told


def test_networks_and_devices_are_for_the_networks(misused):
    assert "--network" in misused("bench", "--only", "bm3d", "--network", "unet", "--quick", "-q")
    assert "--device cuda" in misused("bench", "--only", "bm3d", "--device", "cuda", "--quick", "-q")
