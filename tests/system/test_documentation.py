"""What the documentation shows as files to write is taken by the program as it stands there."""

import re
import subprocess

import numpy as np
import pytest
from PIL import Image

from conftest import PROGRAM, ROOT, needs_networks
from test_camera_files import write_dng


def toml_blocks(name):
    return re.findall(r"```toml\n(.*?)```", (ROOT / "docs" / name).read_text(), re.DOTALL)


def tracked(*patterns):
    names = subprocess.run(["git", "ls-files", *patterns], cwd=ROOT, capture_output=True, text=True, check=True).stdout.split()
    return {name: (ROOT / name).read_text(errors="replace") for name in names}


def anchors_of(text):
    """Headings as GitHub names them, and names that are written as such."""
    prose = re.sub(r"```.*?```", "", text, flags=re.DOTALL)
    headings = [re.sub(r"[^\w\- ]", "", line.lower()).replace(" ", "-") for line in re.findall(r"^#+ +(.*?) *$", prose, re.MULTILINE)]
    return set(headings) | set(re.findall(r'<a name="([^"]+)"', prose))


def test_links_between_documents_lead_somewhere():
    documents = tracked("*.md")
    broken = []
    for name, text in documents.items():
        for file, anchor in re.findall(r"\]\((?!\w+:)([^)#\s]*)#?([^)\s]*)\)", text):
            target = ((ROOT / name).parent / file).resolve() if file else ROOT / name
            if not target.exists() or anchor and anchor not in anchors_of(target.read_text()):
                broken.append(f"{name}: {file}#{anchor}")
    assert not broken


def test_sources_name_documents_and_sections_that_exist():
    broken = []
    for name, text in tracked("src", "apps", "python", "tests", "fuzz", "bench", "web/src", "cmake", "scripts").items():
        flat = re.sub(r"\n\s*(///?|#)?\s*", " ", text)
        for document, section in re.findall(r'\bdocs/([\w-]+\.md)(?:, "([^"]+)")?', flat):
            file = ROOT / "docs" / document
            if not file.exists() or section and not re.search(rf"^#+ {re.escape(section)}|\*\*{re.escape(section)}",
                                                              file.read_text().replace("`", ""), re.MULTILINE):
                broken.append(f"{name}: docs/{document} {section}")
    assert not broken


def test_sessions_are_calibrated(malus, tmp_path):
    """Frames are named by their folder's light; the first session tells what files do not, the second nothing."""
    industrial, stills = toml_blocks("session.md")
    rng = np.random.default_rng(1)
    light = {"bias": 0, "1ms": 400, "2ms": 800, "4ms": 1600, "flat_60th": 2000, "flat_30th": 4000, "flat_15th": 8000}
    seconds = {"bias": 0.001, "flat_60th": 1 / 60, "flat_30th": 1 / 30, "flat_15th": 1 / 15}
    for name, text in (("industrial", industrial), ("stills", stills)):
        for folder in re.findall(r'paths = \["(.*)/\*', text):
            (tmp_path / folder).mkdir(parents=True)
            last = folder.split("/")[-1]
            for n in range(4):
                black = 82 if name == "industrial" else 512
                dn = np.round(black + rng.poisson(light[last], (64, 64)) + rng.normal(0, 4, (64, 64)))
                if name == "industrial":
                    Image.fromarray(dn.astype(np.uint16)).save(tmp_path / folder / f"f{n}.tif")
                else:
                    write_dng(tmp_path / folder / f"f{n}.dng", dn, exposure=seconds[last])
        (tmp_path / f"{name}.toml").write_text(text)
        shown = malus("calibrate", tmp_path / f"{name}.toml", "-o", tmp_path / f"{name}.h5", "--json").json
        assert np.mean(shown["gains"][0]["K"]["value"]) == pytest.approx(1, rel=0.05)
        assert shown["gains"][0].get("iso") == (400 if name == "stills" else None)


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


@pytest.mark.slow
@needs_networks
def test_experiment_on_captured_frames_runs(malus, tmp_path):
    """The example as it stands, with small pictures and trainings of one step."""
    block, = re.findall(r"```bash\n(camera=.*?)```", (ROOT / "docs/experiments.md").read_text(), re.DOTALL)
    rng = np.random.default_rng(1)
    for folder in ("pictures", "others"):
        (tmp_path / folder).mkdir()
        Image.fromarray(rng.integers(30, 220, (160, 160, 3), dtype=np.uint8)).save(tmp_path / folder / f"{folder}.png")
    (tmp_path / "experiments").symlink_to(ROOT / "experiments")
    small = " ".join(f"--set {setting}" for setting in ("train.steps=1", "network.width=2", "data.example=64", "data.patch=64", "data.pool=1"))
    assert "-o out --report" in block
    script = f'malus() {{ "{PROGRAM}" "$@"; }}\nset -e\n' + block.replace("-o out --report", f"{small} -o out --report")
    done = subprocess.run(["bash", "-c", script], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert "12 dB at 1/9.98 of the light" in done.stdout and "12 dB at 1/60 of the light" in done.stdout
    assert done.stdout.count("| (b) paired |") == 3 and (tmp_path / "table2.html").exists()
    light = re.findall(r"scene001_0\d: ratio ([\d.]+), 3 candidates, light ([+-][\d.]+) %", done.stdout)
    assert len(light) == 4 and all(abs(float(off)) < 3 for _, off in light), light
