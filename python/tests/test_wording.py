"""Messages of the library name settings as Python's keyword arguments, never as flags of the program."""

import ast
import pathlib
import re
import warnings

import numpy as np
import pytest

malus = pytest.importorskip("malus", reason="the Python module is not built (pybind11 is missing)")

ROOT = pathlib.Path(__file__).resolve().parents[2]
SOURCES = ROOT / "src" / "malus"
LAYOUT = "polar-mono"
ONLY_OF_THE_PROGRAM = {"set"}  # configurations of trainings and data sets
RNG = np.random.default_rng(1)


@pytest.fixture(scope="module")
def model():
    return malus.Model("imx250mzr-simulated")


@pytest.fixture
def files(tmp_path):
    np.save(tmp_path / "codes.npy", RNG.poisson(200, (64, 64)).astype(np.uint16))
    np.save(tmp_path / "stack.npy", np.zeros((2, 64, 64), np.uint16))
    (tmp_path / "pixels.raw").write_bytes(bytes(200))
    (tmp_path / "text.tif").write_text("no picture")
    return tmp_path


def codes(mean=300, rows=64, cols=64, seed=0):
    return np.random.default_rng(seed).poisson(mean, (rows, cols)).astype(np.uint16)


def keywords():
    """Of all functions, and of the models' methods."""
    stubs = ast.parse((pathlib.Path(malus.__file__).parent / "_malus.pyi").read_text())
    return {argument.arg for node in ast.walk(stubs) if isinstance(node, ast.FunctionDef)
            for argument in node.args.args + node.args.kwonlyargs}


def test_settings_that_messages_name_are_keywords():
    """Of every module that this one is made of."""
    bound = [folder for folder in SOURCES.iterdir() if folder.name in
             {"base", "image", "polar", "noise", "io", "calibrate", "synthesize", "denoise", "evaluate"}]
    named = {(name, str(path.relative_to(SOURCES))) for folder in bound for path in folder.rglob("*.cpp")
             for name in re.findall(r'\bsetting(?:_name)?\(\s*"(\w+)"', path.read_text())}
    assert len({name for name, _ in named}) > 15
    known = keywords()
    assert not [(name, path) for name, path in named - {(n, p) for n, p in named if n in ONLY_OF_THE_PROGRAM}
                if malus._malus._keywords.get(name, name) not in known]
    assert set(malus._malus._keywords.values()) <= known


def sets(gains=(0,), frames=4, level=200):
    made = []
    for gain in gains:
        make = lambda mean, seed: np.stack([codes(mean, seed=1000 * gain + seed + n) for n in range(frames)])
        made.append(malus.FrameSet("bias", make(60, 1), gain_db=gain))
        made += [malus.FrameSet("flat", make(60 + level * k, 100 * k), gain_db=gain, exposure_s=0.001 * k) for k in (1, 2, 3)]
    return made


ERRORS = [
    (lambda m, f: m.synthesize(np.zeros((8, 8)), gain=99),
     r"allow extrapolation with extrapolate_gain=True \(in configurations extrapolate_gain\)$"),
    (lambda m, f: m.synthesize(np.zeros((8, 8)), gain=12, kind="gaussian"),
     r'holds no gaussian model; calibrate with kinds="gaussian", or use one of: physics$'),
    (lambda m, f: m.synthesize(np.zeros((8, 8)), gain=12, kind="poisson-gaussian", exact=True),
     r'^exact=True: is not defined for kind="poisson-gaussian"; use it with kind="physics"$'),
    (lambda m, f: m.at_gain(None, kind="gaussian", shot=False), r'calibrate with kinds="gaussian", or use one of: physics$'),
    (lambda m, f: m.save(f / "codes.npy"), r"codes.npy: exists already; use force=True to replace it$"),
    (lambda m, f: malus.denoise(codes(), model=m), r"the gain is not known and the model holds .*; give gain=$"),
    (lambda m, f: malus.denoise(codes(), model=m, gain=99), r"allow extrapolation with extrapolate_gain=True"),
    (lambda m, f: malus.denoise(codes(), model=m, gain=12, method="bm3"), r'^method="bm3": is no method; did you mean bm3d\?'),
    (lambda m, f: malus.denoise(codes(), model=m, gain=12, method="vst-bm3d", variance=True),
     r'^method="vst-bm3d": gives no uncertainty; use nl-ridge or bm3d$'),
    (lambda m, f: malus.denoise(codes(), layout="mono", model=m, gain=12),
     r"or declare the right layout with layout= or in a session's \[sensor\]$"),
    (lambda m, f: malus.denoise(codes(rows=512, cols=512), model=m, gain=12, memory=1), r"^memory: 1 (MiB is too little|is outside)"),
    (lambda m, f: malus.denoise(codes(), layout=LAYOUT, black=300, white=200),
     r"black 300 DN is not below white 200 DN; check black= and white=, or the session file$"),
    (lambda m, f: malus.denoise(codes()), r"give layout= and white= \(and black=\), a model= that tells them, or a Frame$"),
    (lambda m, f: malus.denoise(codes(4000), layout=LAYOUT, white=100),
     r"are at white or above it: is white= right\?; give model=$"),
    (lambda m, f: malus.load_frame(f / "codes.npy", black=-1), r"its uint16 codes begin at 0; check black=, or the session file$"),
    (lambda m, f: malus.load_frame(f / "codes.npy", black=99, white=98), r"check black= and white=, or the session file$"),
    (lambda m, f: malus.load_frame(f / "pixels.raw", raw_format="mono8"), r"needs its size; give size= \(width and height\)$"),
    (lambda m, f: malus.load_frame(f / "pixels.raw", raw_format="mono8", size=(20, 20)), r"check size= and raw_format=, or the session file$"),
    (lambda m, f: malus.load_frame(f / "codes.npy", size=(20, 20)), r"or the size in the session file or size=$"),
    (lambda m, f: malus.load_frame(f / "text.tif"), r"headerless files with raw_format= and size=$"),
    (lambda m, f: malus.Model("builtin:imx250"), r"; did you mean builtin:.*\? malus.models\(\) shows all$"),
    (lambda m, f: malus.Model(f / "no.h5"), r"check the path, or see malus.models\(\) for built-in models$"),
    (lambda m, f: malus.stokes(np.zeros((8, 8)), "bayer-rggb"),
     r'name a polarization layout, such as layout="polar-mono" or layout="polar-bayer-rggb"$'),
    (lambda m, f: malus.normals(np.zeros((8, 8)), "mono"), r'such as layout="polar-mono"'),
    (lambda m, f: malus.compare_noise(np.zeros((1, 8, 8)), np.zeros((1, 8, 8)), "mono", remove_fixed_pattern=True),
     r"give two frames or more, or leave out remove_fixed_pattern=$"),
    (lambda m, f: malus.calibrate(sets(), kinds="fysics", layout="mono"), r"^kinds: fysics is not a kind of model; choose of physics"),
    (lambda m, f: malus.calibrate(sets(), kinds=["gaussian", "nonparametric"], layout="mono", black=50, white=4095, level_step=1e-6),
     r"^level_step: 1e-06 DN makes .*; raise it to .* DN or more$"),
]


@pytest.mark.parametrize("call, words", ERRORS)
def test_errors_name_keywords(model, files, call, words):
    with pytest.raises(malus.InputError) as raised:
        call(model, files)
    assert re.search(words, str(raised.value)), str(raised.value)
    assert not re.search(r"--[a-z]|malus (model|info|capture)", str(raised.value))


def warnings_of(call):
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        call()
    return [str(warning.message) for warning in said]


def test_warnings_name_keywords(model):
    light = model.synthesize(np.full((64, 64), 300, np.float32), gain=12, seed=1)
    raw = light + model.as_dict()["black"]["value"][0]
    given = dict(model=model, white=4095)
    cases = [(lambda: malus.denoise(light, model=model, gain=12), r"give black=82 if they hold the camera's$"),
             (lambda: malus.denoise(raw, black=600, gain=12, **given), r"another camera, black level or gain\? check gain=, black= and model=$"),
             (lambda: malus.denoise(raw, black=82, gain=33, extrapolate_gain=True, **given),
              r"^Sony IMX250MZR \(simulated\): extrapolated to 33 dB from the calibrated range")]
    for call, words in cases:
        said = warnings_of(call)
        assert any(re.search(words, line) for line in said), said
        assert not any("--" in line for line in said), said


def test_what_a_model_file_keeps_is_in_plain_words(tmp_path):
    """It may be read by the program, by Python or by a person."""
    saturated = [malus.FrameSet("bias", np.stack([codes(60, seed=n) for n in range(4)]))]
    saturated += [malus.FrameSet("flat", np.stack([np.minimum(codes(60 + 250 * k, seed=10 * k + n), 700) for n in range(4)]), exposure_s=0.001 * k)
                  for k in range(1, 9)]
    said = warnings_of(lambda: malus.calibrate(saturated, layout="mono", black=50, white=4095).save(tmp_path / "m.h5"))
    kept = str(malus.Model(tmp_path / "m.h5").as_dict())
    assert "the sensor saturates" in kept and "saturation limit of" in kept, kept
    assert not re.search(r"--[a-z]|\w=\W", "\n".join(said)) and "--" not in kept
