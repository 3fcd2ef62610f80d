"""PyTorch checkpoints of plain Python networks, imported, give the same pictures in malus."""

import collections
import io
import json
import pickle
import re
import zipfile

import numpy as np
import pytest

from conftest import needs_networks

torch = pytest.importorskip("torch", reason="needs Python's torch")
from plain_networks import NAFNet, UNet  # noqa: E402
from plain_transformers import Restormer, Uformer  # noqa: E402

pytestmark = [pytest.mark.slow, needs_networks]

SIDE, BLACK, WHITE = 256, 100.0, 4095.0
NETWORKS = {
    "unet": (lambda: UNet(width=8), {"width": 8}),
    "nafnet": (lambda: NAFNet(width=8, middle=1, encoder=(1, 1), decoder=(1, 1)),
               {"width": 8, "middle_blk_num": 1, "enc_blk_nums": [1, 1], "dec_blk_nums": [1, 1]}),
}
TRANSFORMERS = {
    "uformer": (lambda: Uformer(dim=16, depths=(1,) * 9), {"embed_dim": 16, "depths": [1] * 9}),
    "restormer": (lambda: Restormer(blocks=(1, 1, 1, 1), refinement=1),
                  {"num_blocks": [1, 1, 1, 1], "num_refinement_blocks": 1}),
}


def made(name):
    torch.manual_seed(4)
    network = (NETWORKS | TRANSFORMERS)[name][0]()
    for key, value in network.named_parameters():
        if key.endswith(("beta", "gamma")):
            torch.nn.init.normal_(value, 0, 0.3)
    return network.eval()


def by_python(network, raw):
    """The linear domain of malus: light above black, amplified so that its mean is 0.18, packed by sites."""
    light = raw.astype(np.float64) - BLACK
    scale = light.clip(0).mean() / 0.18
    planes = np.stack([light[r::4, c::4] for r in range(4) for c in range(4)]) / scale
    with torch.no_grad():
        out = network(torch.tensor(planes, dtype=torch.float32)[None])[0].numpy() * scale
    mosaic = np.empty_like(light)
    for k in range(16):
        mosaic[k // 4::4, k % 4::4] = out[k]
    return mosaic


RAW = ["--black", str(BLACK), "--white", str(WHITE), "--layout", "polar-bayer-rggb"]


@pytest.mark.parametrize("name,wrapped", [("nafnet", "plain"), ("unet", "plain"), ("unet", "params"), ("unet", "module"),
                                          ("unet", "parameters")])
def test_outputs_equal_pythons(malus, tmp_path, name, wrapped):
    network, settings = made(name), NETWORKS[name][1]
    state = network.state_dict()
    content = {"plain": state, "params": {"params": state}, "parameters": dict(network.named_parameters()),
               "module": {"state_dict": collections.OrderedDict((f"module.{k}", v) for k, v in state.items()),
                          "epoch": 3, "optimizer": torch.optim.Adam(network.parameters()).state_dict()}}[wrapped]
    torch.save(content, tmp_path / "public.pth")
    imported = malus("model", "import-weights", tmp_path / "public.pth", "--architecture", name, "--settings",
                     json.dumps(settings), "-o", tmp_path / "w.safetensors", "--json").json
    assert imported["parameters"] == sum(p.numel() for p in network.parameters())
    rows, cols = np.mgrid[0:SIDE, 0:SIDE]
    raw = np.random.default_rng(1).normal(400 + 150 * np.sin(cols / 20) * np.cos(rows / 30), 30).round().astype(np.uint16)
    np.save(tmp_path / "raw.npy", raw)
    malus("denoise", tmp_path / "raw.npy", "--method", tmp_path / "w.safetensors", *RAW, "--format", "npy",
          "-o", tmp_path / "out")
    ours = np.load(tmp_path / "out" / "raw_denoised.npy")
    python = by_python(network, raw)
    # The noise estimated from the picture has no bias; what is left is rounding.
    assert np.abs(ours - python).max() < 1e-4 * (WHITE - BLACK)
    assert np.abs(python - (raw - BLACK)).max() > 10  # the network does something


@pytest.mark.parametrize("name", TRANSFORMERS)
def test_transformers_are_denoised_with_in_bfloat16(malus, tmp_path, name):
    torch.save(made(name).state_dict(), tmp_path / "public.pth")
    malus("model", "import-weights", tmp_path / "public.pth", "--architecture", name, "--settings",
          json.dumps(TRANSFORMERS[name][1]), "-o", tmp_path / "w.safetensors")
    rows, cols = np.mgrid[0:SIDE, 0:SIDE]
    raw = np.random.default_rng(2).normal(400 + 150 * np.sin(cols / 20) * np.cos(rows / 30), 30).round().astype(np.uint16)
    np.save(tmp_path / "raw.npy", raw)

    def denoised(precision):
        result = malus("denoise", tmp_path / "raw.npy", "--method", tmp_path / "w.safetensors", *RAW, "--format", "npy",
                       "--precision", precision, "--json", "-o", tmp_path / precision)
        return np.load(tmp_path / precision / "raw_denoised.npy"), result.json["network"]["precision"]

    exact, _ = denoised("float32")
    rough, precision = denoised("bfloat16")
    if precision == "float32":
        pytest.skip("this processor is no faster with bfloat16, so the run stays float32")
    assert 0 < np.sqrt(np.mean((rough - exact) ** 2)) < 0.02 * exact.std()


def negated(path):
    """The archive with its first tensor as a view of negated sign, as PyTorch 2 writes it: metadata at the end of its arguments."""
    out, done = io.BytesIO(), 0
    with zipfile.ZipFile(path) as old, zipfile.ZipFile(out, "w") as new:
        for name in old.namelist():
            content = old.read(name)
            if name.endswith("data.pkl"):
                content, done = re.subn(rb"(\)R(?:q.)?)t", lambda m: m[1] + b"}X\x03\0\0\0neg\x88st", content, count=1, flags=re.S)
            new.writestr(name, content)
    assert done == 1
    return out.getvalue()


def test_checkpoints_that_do_not_fit_are_refused(refused, misused, tmp_path):
    out = tmp_path / "w.safetensors"
    fitting = json.dumps(NETWORKS["unet"][1])

    def line(content, architecture="unet", settings=fitting, extra=()):
        if isinstance(content, bytes):
            (tmp_path / "bad.pth").write_bytes(content)
        else:
            torch.save(content, tmp_path / "bad.pth")
        text = refused("model", "import-weights", tmp_path / "bad.pth", "--architecture", architecture, "--settings",
                       settings, "-o", out, *extra)
        assert not out.exists()
        return text

    state = made("unet").state_dict()
    assert "bad.pth" in line({"a": 1})
    assert "bad.pth" in line(b"no archive")
    assert "bad.pth" in line(pickle.dumps({"conv1_1.weight": [1, 2]}))
    torch.save(state, tmp_path / "whole.pth")
    whole = (tmp_path / "whole.pth").read_bytes()
    assert "bad.pth" in line(whole[: len(whole) // 2])
    assert "conv3_1.bias" in line({k: v for k, v in state.items() if k != "conv3_1.bias"})
    assert "shape" in line({k: v[:1] if k == "conv2_1.bias" else v for k, v in state.items()})
    assert "negated" in line(negated(tmp_path / "whole.pth"))
    assert 'conv2_1.bias" holds values' in line({k: v * float("nan") if k == "conv2_1.bias" else v for k, v in state.items()})
    torch.save(state, tmp_path / "old.pth", _use_new_zipfile_serialization=False)
    assert "before 1.6" in line((tmp_path / "old.pth").read_bytes())
    assert "levels" in line(state, settings='{"levels": 100}')
    assert "values" in line(state, settings='{"levels": 8, "width": 8}')
    assert "--package" in line(state, extra=["--package", '{"domian": "linear"}'])
    (tmp_path / "own.safetensors").write_bytes(whole)
    run = ["model", "import-weights", tmp_path / "own.safetensors", "--architecture", "unet", "--force"]
    assert "is an input" in refused(*run, "-o", tmp_path / "own.safetensors")
    assert "end in .safetensors" in misused(*run, "-o", tmp_path / "w.pth")
    assert "--settings: [4] is no JSON object" in misused(*run, "-o", out, "--settings", "[4]")
    assert '--architecture: "unett" is none; did you mean unet? known: ' in misused(*run[:3], "--architecture", "unett", "-o", out)
    assert (tmp_path / "own.safetensors").read_bytes() == whole


def test_nothing_in_a_checkpoint_runs(refused, tmp_path):
    class Evil:
        def __reduce__(self):
            return (open, (str(tmp_path / "ran"), "w"))

    torch.save({"params": Evil()}, tmp_path / "evil.pth")
    refused("model", "import-weights", tmp_path / "evil.pth", "--architecture", "unet", "-o", tmp_path / "w.safetensors")
    assert not (tmp_path / "ran").exists()
