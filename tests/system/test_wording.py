"""The library does not know the command line: it names settings through base/wording.h, and the program writes them as flags."""

import re

from conftest import ROOT
from test_architecture import SOURCES

STRING = r'"(?:\\.|[^"\\\n])*"'


def sources():
    for path in sorted(SOURCES.rglob("*")):
        if path.suffix in (".h", ".cpp", ".cu"):
            yield path, re.sub(r"//[^\n]*", "", path.read_text())


def test_no_message_of_the_library_has_a_flag():
    wrong = [f"{path.relative_to(ROOT)}: {text}" for path, code in sources() for text in re.findall(STRING, code)
             if re.search(r"(?<!<!)--[a-z]|(?<![\w-])-[a-z] [A-Z]{2}", text)]
    assert not wrong, "\n".join(wrong)


def test_settings_that_messages_name_are_flags_of_the_program():
    flags = set(re.findall(r"--(?:no-)?([a-z][a-z-]*)", (ROOT / "docs/commands.md").read_text())) | {"kinds"}
    named = {(name, path) for path, code in sources() for name in re.findall(r'\bsetting(?:_name)?\(\s*"(\w+)"', code)}
    assert len(named) > 30
    assert not [(name, path) for name, path in named if name.replace("_", "-") not in flags]


def test_the_program_writes_settings_as_flags(refused, misused, tmp_path):
    (tmp_path / "f.raw").write_bytes(bytes(64))
    line = misused("info", tmp_path / "f.raw", "--raw-format", "mono8")
    assert line.endswith("a headerless file needs its size; give --size (width and height)")
    line = refused("synthesize", tmp_path / "f.raw", "--model", "imx250myr-simulated", "--kind", "gaussian", "-o", tmp_path / "out")
    assert line.endswith("holds no gaussian model; calibrate with --kind gaussian, or use one of: physics")
    line = refused("model", "show", "builtin:imx250myr")
    assert line.endswith("did you mean builtin:imx250myr-simulated? `malus model list` shows all")
