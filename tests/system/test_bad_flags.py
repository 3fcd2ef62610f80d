"""Flags and their values that no file could make right: one line, nothing written; exit code 2."""

import re
import subprocess

import numpy as np
import pytest
from conftest import PROGRAM, ROOT


@pytest.mark.parametrize("command,flag,words", [
    ("info", "--layout polar-mona", "did you mean polar-mono"), ("info", "--size 9by9", "is not WIDTHxHEIGHT"),
    ("denoise -o out", "--profile fats", '"fats" is not known; did you mean fast? known: fast, normal, high'),
    ("denoise -o out", "--format tiff2", "did you mean tif? known: tif, png, exr, npy, fits"),
    ("stokes -o out --full", "--demosaick bilinaer", "did you mean bilinear? known: "),
    ("simulate -o out", "--layout polar-mona", "did you mean polar-mono? known: "),
    ("info", "--raw-format mono9", "did you mean mono8"), ("denoise -o out", "--method bm3e", "did you mean bm3d"),
    ("experiment denoise", "--methods bm3e", "did you mean bm3d"), ("experiment denoise", "--methods bm3d/fats", "did you mean fast? known: "),
    ("experiment uncertainty", "--methods nl-rigde", "did you mean nl-ridge"), ("experiment denoise", "--cases 12", "is not GAIN:RATIO"),
    ("train -o out", "--set train.steps", "write SECTION.KEY=VALUE"),
    ("simulate -o out", "--white-balance 2 1 ", "3"), ("simulate -o out", "--color-matrix 1 0 0 ", "9"),
    ("evaluate --noise --reference f.npy --model imx250myr-simulated", "--kind gausian", "gaussian")])
def test_a_value_that_no_file_could_make_right_is_wrong_usage(malus, tmp_path, command, flag, words):
    """Exit code 2, as of a number out of range, before any file is looked for."""
    file = () if "f.npy" in command else ("f.npy",)
    told = malus(*command.split(), *file, *flag.split(), code=2, cwd=tmp_path).err
    assert flag.split()[0] + ": " in told and words in told
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("arguments,words", [
    (["denoise", "f.npy", "-o", "out", "--methd", "bm3d"], "--methd: is no flag of denoise; did you mean --method? "),
    (["evaluate", "--nosie"], "--nosie: is no flag of evaluate; did you mean --noise? "),  # before what is missing
    (["info", "f.npy", "--layuot=mono"], "--layuot: is no flag of info; did you mean --layout? "),
    (["model", "list", "--verbose"], "--verbose: is no flag of model list; `malus model list --help`"),
    (["info", "f.npy", "--gain"], "--gain: has no value; give one after it"),
    (["train", "c.toml", "--seed", "1", "--seed", "2"], "--seed: is given 2 times; give it once"),
    (["info", "f.npy", "--verbose"], "--verbose: is no flag of info; `malus info --help`"),
    (["model", "show", "imx250myr"], "did you mean imx250myr-simulated? "), (["model", "show", "none.h5"], "does not exist; check"),
    (["model", "sho"], "did you mean show? "), (["wat"], "wat: is no command; there are info, ")])
def test_a_word_that_is_not_known_brings_up_the_one_meant_or_none(malus, tmp_path, arguments, words):
    told = malus(*arguments, code=1 if "show" in arguments else 2, cwd=tmp_path).err
    assert words in told and told.count("did you mean") == words.count("did you mean")


@pytest.mark.parametrize("command", ["info f.npy", "bench", "model list", "model show m", "model check m", "calibrate s.toml -o m.h5",
                                     "denoise f.npy -o out", "stokes f.npy -o out", "normals f.npy -o out", "pairs s.toml -o out",
                                     "report m -o r.html", "manual -o out"])
def test_a_seed_is_refused_where_nothing_is_drawn(malus, tmp_path, command):
    """And --force where nothing is written: whoever sets it expects something of it."""
    flags = ["--seed=3"] + ["--force"] * (" -o " not in command)
    for flag in flags:
        line = malus(*command.split(), flag, code=2, cwd=tmp_path).err.splitlines()[0]
        name, words = flag.split("=")[0], " ".join(command.split()[:2 if command.startswith("model") else 1])
        assert line == f"malus: {name}: is no flag of {words}; `malus {words} --help` shows all"
    assert not list(tmp_path.iterdir())


def test_a_training_s_folder_for_a_method_points_at_its_weights(malus, tmp_path):
    (tmp_path / "run").mkdir()
    told = [malus("denoise", "f.npy", "-o", "out", "--method", "run", code=2, cwd=tmp_path).err]
    assert "is a folder; give a network's weight file" in told[0]
    (tmp_path / "run/weights.safetensors").touch()
    told.append(malus("denoise", "f.npy", "-o", "out", "--method", "run", code=2, cwd=tmp_path).err)
    assert "is a folder; give the weights in it: run/weights.safetensors" in told[1]
    (tmp_path / "bm3d").mkdir()  # a method's name is the method's
    assert "f.npy" in malus("denoise", "f.npy", "-o", "out", "--method", "bm3d", code=1, cwd=tmp_path).err


@pytest.mark.parametrize("words", [
    "calibrate --kind physics s.toml -o m.h5", "calibrate --kind physics gaussian s.toml -o m.h5", "calibrate --kind physics,gaussian s.toml -o m.h5",
    "calibrate --kind=physics s.toml -o m.h5", "calibrate --kind physics -- s.toml -o m.h5", "calibrate -o m.h5 --kind physics s.toml",
    "experiment denoise --cases 12:10 12:60 --methods bm3d nl-ridge/fast s.toml --crop 64",
    "experiment uncertainty --methods bm3d s.toml", "experiment denoise --methods bm3d --cases 12:10 s.toml -q"])
def test_a_list_of_words_ends_where_they_do(refused, tmp_path, words):
    """What follows is the positional; all of these ask for s.toml, which is not there."""
    assert refused(*words.split(), cwd=tmp_path).startswith("malus: s.toml: ")


def test_a_list_of_files_that_took_the_positional_is_told(malus, tmp_path):
    told = malus("denoise", "--dark", "d.npy", "f.npy", "-o", "out", code=2, cwd=tmp_path).err
    assert told.startswith("malus: RAW is required; --dark took d.npy, f.npy: write -- behind the last of its own\n")
    assert "d.npy: does not exist" in malus("denoise", "--dark", "d.npy", "--", "f.npy", "-o", "out", code=1, cwd=tmp_path).err
    assert "took" not in malus("denoise", "--dark", "d.npy", "-o", "out", code=2, cwd=tmp_path).err


@pytest.mark.parametrize("command,words", [
    ("simulate p.png -o out --color-matrix 1 0 0 1 0 0 0 0 1", "--color-matrix: cannot be inverted"),
    ("denoise f.npy -o out --format png", "--format png: holds no float values"),
    ("denoise f.npy -o out --reference r.npy --reference-black nan", "--reference-black: must be a finite number, not nan"),
    ("synthesize f.npy -m m -o out --gain 1600", "--gain: is 1600 dB, beyond any camera's"),
    ("model show imx250mzr-simulated --gain 1600", "--gain: is 1600 dB, beyond any camera's"),
    ("info f.npy --gain 101", "--gain: is 101 dB, beyond any camera's"),
    ("info f.npy --layout mono --black 1,2", "--black: 2 black levels for the 1 channel of mono"),
    ("stokes f.npy -o out --layout mono", '--layout: "mono" has no four polarizer angles; choose one of polar-mono, '),
    ("normals f.npy -o out --layout bayer-rggb", '--layout: "bayer-rggb" has no four polarizer angles; choose one of polar-mono, '),
    ("info f.npy --white 1e300", "--white: 1e+300 DN is beyond all that cameras count"),
    ("denoise f.npy -o out --black=-1e30", "--black: -1e+30 DN is beyond all that cameras count"),
    ("average f.npy g.npy -o mean.png", "mean.png: PNG holds no floating-point values"),
    ("average f.npy g.npy -o mean.jpg", 'mean.jpg: the ending ".jpg" cannot be written')])
def test_flags_that_are_wrong_by_themselves_are_wrong_usage(misused, tmp_path, command, words):
    assert words in misused(*command.split(), cwd=tmp_path)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("arguments", [["denois"], ["denoise"], ["info", "--wat"], ["synthesize", "--gain", "x"], []])
def test_wrong_usage_exits_2(malus, arguments):
    malus(*arguments, code=2)


@pytest.mark.parametrize("arguments", [
    ["stokes", "f.npy", "-o", "out", "--variance", "a.exr", "b.exr"],
    ["denoise", "f.npy", "-o", "out", "--reference", "a.npy", "b.npy"],
    *(["denoise", "f.npy", "-o", "out", "--method", method, "--uncertainty"]
      for method in ("vst-bm3d", "paper-mbm3d")),
    ["denoise", "f.npy", "-o", "out", "--extrapolate-gain"],
    ["model", "show", "m", "--extrapolate-gain"],
    ["simulate", "p.png", "-o", "out", "--gloss", "0.1"],
    ["denoise", "f.npy", "-o", "out", "--reference-ratio", "2"],
    *(["evaluate", "--reference", "f.npy", "--test", "f.npy", "--noise", *flags]
      for flags in (["--ratio", "2"], ["--peak", "9"], ["--report", "r.html"], ["--kind", "gaussian"], ["--frames", "3"])),
    *(["evaluate", "--reference", "f.npy", "--test", "f.npy", *flags]
      for flags in (["--clean", "c.npy"], ["--frames", "3"], ["--kind", "gaussian"], ["--bins", "64"], ["--levels", "8"],
                    ["--no-remove-fixed-pattern"], ["--model", "m"], ["--seed", "3"])),
    ["renoise", "f.npy", "-m", "m", "--from", "1", "--to", "2", "-o", "out", "--guide", "a.npy", "b.npy"],
    ["synthesize", "f.npy", "-m", "m", "-o", "out", "--gain", "loud"]])
def test_flags_that_do_not_go_together_exit_2(malus, tmp_path, arguments):
    malus(*arguments, code=2, cwd=tmp_path)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("command,flag,words", [
    ("pairs s.toml -o out", "--ratio nan", "finite number above 0"),
    ("synthesize f.npy -m m -o out", "--ratio nan", "between 1e-06 and 1000000000"),
    ("synthesize f.npy -m m -o out", "--iso nan", "finite number above 0"),
    ("synthesize f.npy -m m -o out", "--white inf", "finite number"),
    ("synthesize f.npy -m m -o out", "--frames 1.5", "whole number between 1 and 1000000"),
    ("synthesize f.npy -m m -o out", "--origin 0,nan", "whole number"),
    ("synthesize f.npy -m m -o out", "--origin 4", "row,column"),
    ("simulate p.png -o out", "--exposure nan", "between 1e-06 and 1000000"),
    ("simulate p.png -o out", "--white-balance nan 1 1", "between 0.01 and 100"),
    ("simulate p.png -o out", "--color-matrix 1 0 0 0 1 0 0 0 nan", "finite number"),
    ("denoise f.npy -o out", "--exposure 0", "finite number above 0, not 0"),
    ("denoise f.npy -o out", "--black 1,nan", "finite number"),
    ("denoise f.npy -o out", "--strength nan", "between 0.1 and 4"),
    ("info f.npy", "--threads -1", "whole number between 0 and 1024 in plain digits, not -1"),
    ("train c.toml", "--seed -1", "whole number"),
    ("train c.toml", "--seed 18446744073709551616", "between 0 and 18446744073709551615"),
    ("train c.toml", "--seed 0x10", "whole number"),
    ("train c.toml", "--seed 010", "in plain digits, not 010"),
    ("synthesize f.npy -m m -o out", "--frames 010", "in plain digits, not 010"),
    ("train c.toml", "--seed 1e3", "whole number"),
    ("synthesize f.npy -m m -o out", "--gain 0x10", "give a number in dB"),
    ("info f.npy", "--gain 0x10", "finite number"),
    ("denoise f.npy -o out", "--black 1,0x10", "finite number"),
    ("denoise f.npy -o out", "--strength 0x1", "between 0.1 and 4"),
    ("denoise f.npy -o out", "--exposure 0x1p-3", "finite number above 0"),
])
def test_numbers_of_flags_are_checked(malus, command, flag, words):
    line = malus(*command.split(), *flag.split(), code=2).err.splitlines()[0]
    assert flag.split()[0] in line and words in line and len(line) < 150


def test_no_whole_number_is_read_as_octal(malus, tmp_path):
    """010 was 8 of the flags that settings are made of; 1e1 had a line without a remedy."""
    seen, built = set(), malus("--help").out
    for command in re.findall(r"^## malus (\S.*)$", (ROOT / "docs/commands.md").read_text(), re.M):
        if f"  {command.split()[0]} " not in built:
            continue  # capture, where its library is missing
        for flag in re.findall(r"^ +(?:-\w,)?(--[\w-]+) U?INT\b", malus(*command.split(), "--help").out, re.M):
            for text in ("010", "1e1", "08", "+8"):
                line = malus(*command.split(), f"{flag}={text}", code=2, cwd=tmp_path).err.splitlines()[0]
                assert line.startswith(f"malus: {flag}: must be a whole number between ") and line.endswith(f"in plain digits, not {text}"), (command, line)
            seen.add(flag)
    assert {"--threads", "--frames", "--bumps", "--bins", "--level-samples", "--dark-frames"} <= seen


@pytest.mark.parametrize("command,flag", [
    ("stokes f.npy", "-o"), ("denoise f.npy", "-o"), ("calibrate s.toml", "-o"), ("report f.json", "-o"),
    ("normals f.npy", "-o"), ("synthesize f.npy -m imx250mzr-simulated", "-o"), ("train c.toml", "-o"),
    ("experiment table1 t.toml --scenes s", "-o"), ("model from-dng f.dng", "-o"), ("manual", "-o"),
    ("denoise f.npy -o out", "--model"), ("denoise f.npy -o out", "--report"), ("evaluate --test f.npy", "--reference"),
])
def test_an_empty_value_is_refused_before_anything_is_done(misused, tmp_path, command, flag):
    """As of a shell's variable that is not set: the current folder is no place for results."""
    np.save(tmp_path / "f.npy", np.full((16, 16), 300, np.uint16))
    words = [tmp_path / word if word == "f.npy" else word for word in command.split()]
    line = misused(*words, flag, "", cwd=tmp_path)
    assert line == f"malus: {'--output' if flag == '-o' else flag}: is given without a value, an empty text; name one, or leave it out"
    assert [path.name for path in tmp_path.iterdir()] == ["f.npy"]


def test_a_file_whose_name_begins_like_a_flag(tmp_path):
    np.save(tmp_path / "-dash.npy", np.full((64, 64), 300, np.float32))

    def info(*words):
        return subprocess.run([PROGRAM, "info", *words], cwd=tmp_path, capture_output=True, text=True)
    assert "-dash.npy: is taken for a flag; write ./-dash.npy to name the file" in info("-dash.npy").stderr
    assert info("./-dash.npy").returncode == info("--", "-dash.npy").returncode == 0
    assert "-dish.npy: is no flag of info" in info("-dish.npy").stderr
