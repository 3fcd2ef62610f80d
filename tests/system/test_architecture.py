"""The house rules that a compiler does not check: arrows between modules, heavy libraries at the rim, sizes."""

import ast
import pathlib
import re
import shutil
import subprocess

import pytest
from conftest import BUILD, ROOT

SOURCES = ROOT / "src" / "malus"
HEAVY_IN_HEADERS = ("torch/", "c10/", "cuda", "OpenEXR/", "turbojpeg", "libraw/", "hdf5", "H5", "arv", "toml++")
LONGEST_FILE = 400
LONGEST_FUNCTION = 59
CODE = (".h", ".cpp", ".cu", ".py", ".ts", ".mjs", ".css", ".sh", ".cmake")


def modules():
    declared = {}
    for line in (BUILD / "modules.txt").read_text().splitlines():
        name, _, depends = line.partition(":")
        declared[name] = depends.replace(";", " ").split()
    return declared


def reachable(name, declared):
    seen, todo = set(), [name]
    while todo:
        module = todo.pop()
        if module not in seen:
            seen.add(module)
            todo += declared[module]
    return seen


def tracked():
    return subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=True).stdout.split()


def own_files(*suffixes):
    """All but what is built from others: web/built."""
    return [ROOT / name for name in tracked()
            if name.endswith(suffixes) and not name.startswith("web/built/") and (ROOT / name).exists()]


def test_every_include_follows_a_declared_arrow():
    declared, wrong = modules(), []
    for path in SOURCES.rglob("*"):
        # malus.h, the one include of users, stands above the modules.
        if path.suffix not in (".h", ".cpp", ".cu") or path.parent == SOURCES:
            continue
        module = path.relative_to(SOURCES).parts[0]
        for target in re.findall(r'#include "malus/(\w+)/', path.read_text()):
            if target not in reachable(module, declared):
                wrong.append(f"{path.relative_to(ROOT)} includes {target}")
    assert not wrong, "\n".join(wrong)


def test_every_module_folder_is_declared():
    folders = {path.parent.name for path in SOURCES.glob("*/sources.cmake")}
    assert set(modules()) <= folders


def test_modules_form_no_cycle():
    declared = modules()
    for name, depends in declared.items():
        for dependency in depends:
            assert name not in reachable(dependency, declared), f"{name} <-> {dependency}"


def test_heavy_libraries_stay_out_of_headers():
    wrong = []
    for path in own_files(".h"):
        # neural is libtorch's rim; cuda's internal header is for its own kernels and is not installed.
        if SOURCES not in path.parents or "neural" in path.parts or path.parts[-3:-1] == ("cuda", "internal"):
            continue
        for target in re.findall(r'#include [<"]([^>"]+)[>"]', path.read_text()):
            if target.startswith(HEAVY_IN_HEADERS):
                wrong.append(f"{path.relative_to(ROOT)} includes {target}")
    assert not wrong, "\n".join(wrong)


def test_installed_headers_include_none_that_is_not():
    """Those in folders named internal are not (cmake/MalusInstall.cmake)."""
    wrong = []
    for path in SOURCES.rglob("*.h"):
        if "internal" not in path.parts:
            wrong += [f"{path.relative_to(ROOT)} includes {target}"
                      for target in re.findall(r'#include [<"]([^>"]+)[>"]', path.read_text()) if "internal/" in target]
    assert not wrong, "\n".join(wrong)


# What a program of one's own may want although none here includes it: metrics, networks by name, their losses, pictures' legends.
OF_USE_ALONE = {"evaluate/noise_structure.h", "evaluate/polarization_metrics.h", "neural/loss.h", "neural/networks.h", "neural/noise_flow.h",
                "noise/column_noise.h", "polar/legend.h"}


def test_headers_that_only_their_module_reaches_are_internal():
    headers = {path.relative_to(SOURCES).as_posix(): path for path in SOURCES.glob("*/*.h")}
    includers = {name: set() for name in headers}
    for path in own_files(".h", ".cpp", ".cu", ".cuh"):
        outside = SOURCES not in path.parents
        if outside and path.relative_to(ROOT).parts[0] in ("tests", "bench", "fuzz"):
            continue
        for name in re.findall(r'#include "malus/([^"]+)"', path.read_text()):
            if name in headers:
                includers[name].add("" if outside else path.relative_to(SOURCES).as_posix())
    reached = {name for name, users in includers.items()
               if name in OF_USE_ALONE or any(user.split("/")[0] != name.split("/")[0] for user in users)}
    while more := {name for name, users in includers.items() if name not in reached and users & reached}:
        reached |= more
    assert set(headers) - reached == set()


def test_modules_of_the_documentation_are_those_of_the_build():
    rows = re.findall(r"^\| `(\w+)` \| ([\w, ]*?) *\|", (ROOT / "ARCHITECTURE.md").read_text(), re.MULTILINE)
    told = {name: set(depends.replace(",", " ").split()) for name, depends in rows}
    built = {name: set(depends) for name, depends in modules().items()}
    assert {name: told.get(name) for name in built} == built
    assert set(told) - set(built) <= {"capture", "neural", "cuda"}  # optional


def test_nothing_outside_neural_includes_torch():
    wrong = [str(path) for path in own_files(".h", ".cpp") if "neural" not in str(path)
             and re.search(r'#include [<"](torch|c10|ATen)/', path.read_text())]
    assert not wrong, wrong


def test_library_code_never_prints_or_exits():
    wrong = []
    for path in own_files(".h", ".cpp"):
        if SOURCES in path.parents:
            code = re.sub(r"//.*", "", path.read_text())
            if re.search(r"std::(cout|cerr|exit|abort)\b|\b(f?printf|fmt::print|puts)\s*\(", code):
                wrong.append(str(path.relative_to(ROOT)))
    assert not wrong, wrong


def test_numbers_are_read_with_a_decimal_point_in_any_locale():
    """The C library's functions stop at the point where the locale of the program around sets a comma."""
    wrong = []
    for path in own_files(".h", ".cpp", ".cu"):
        if path.relative_to(ROOT).parts[0] in ("src", "apps", "python"):
            code = re.sub(r"//.*", "", path.read_text())
            if re.search(r"\b(?:sto(?:f|d|ld)|strto(?:f|d|ld)|atof|sscanf)\s*\(", code):
                wrong.append(str(path.relative_to(ROOT)))
    assert not wrong, wrong


def test_random_numbers_have_one_home():
    """A number typed in place may be taken already: two things would then be drawn of the same words."""
    for path in own_files(".h", ".cpp", ".cu"):
        text = path.read_text()
        if path.is_relative_to(ROOT / "src"):
            assert not re.search(r"Draw::k(?:Scene|Parameters), *\d|Draw::kScene\)|static_cast<Draw>|Draw::kUser", text), path
    for name in ("ParameterStream", "SceneStream"):
        home = (SOURCES / "base/parameter_stream.h").read_text()
        numbers = re.findall(r"= (\d+),", re.search(rf"enum {name}.*?\}};", home, re.S)[0])
        assert numbers and len(numbers) == len(set(numbers)), name
    purposes = re.findall(r"= (\d+),", re.search(r"enum class Draw.*?\};", (SOURCES / "base/random.h").read_text(), re.S)[0])
    assert len(purposes) == len(set(purposes)) and int(purposes[-1]) == max(map(int, purposes))


def test_files_stay_short():
    long = [f"{path.relative_to(ROOT)}: {lines}" for path in own_files(*CODE)
            if (lines := path.read_text().count("\n")) > LONGEST_FILE]
    assert not long, "\n".join(long)


# Comments and strings: of C++, then of TypeScript, which has regular expressions and `templates` too.
LITERALS = r"""//[^\n]*|/\*.*?\*/|R"\(.*?\)"|"(?:\\.|[^"\\\n])*"|'(?:\\.|[^'\\\n])*'"""
SCRIPT_LITERALS = LITERALS + r"""|`(?:\\.|[^`\\])*`|/(?:\\.|\[[^\]\n]*\]|[^\s/\\])(?:\\.|\[[^\]\n]*\]|[^\n/\\])*/"""


def bodies_in_braces(text, literals):
    """(first line, lines, what stands before it) of every {block} but namespaces, types and lists of values."""
    for left_out in (literals, r"^[ \t]*#(?:.*\\\n)*.*", r"\b(?:public|private|protected):"):
        text = re.sub(left_out, lambda found: "\n" * found[0].count("\n"), text,
                      flags=re.DOTALL if left_out is literals else re.MULTILINE)
    opened, head_at = [], 0
    for found in re.finditer("[{};]", text):
        line = text.count("\n", 0, found.start()) + 1
        if found[0] == "{":
            head = text[head_at:found.start()].strip()
            opened.append((line - head.count("\n"), head))
        elif found[0] == "}":
            first, head = opened.pop()
            if not re.search(r"\b(namespace|struct|class|interface|enum|union)\b[^()]*$|=$", head):
                yield first, line - first + 1, " ".join(head.split())
        head_at = found.end()
    assert not opened


def functions_of(path):
    if path.suffix != ".py":
        return bodies_in_braces(path.read_text(), SCRIPT_LITERALS if path.suffix == ".ts" else LITERALS)
    return [(node.lineno, node.end_lineno - node.lineno + 1, node.name) for node in ast.walk(ast.parse(path.read_text()))
            if isinstance(node, ast.FunctionDef)]


def test_code_is_formatted():
    """By .clang-format, as the version reads it that all of it was formatted with: others break lines elsewhere."""
    program = shutil.which("clang-format-14") or shutil.which("clang-format")
    if not program or " 14." not in subprocess.run([program, "--version"], capture_output=True, text=True).stdout:
        pytest.skip("clang-format 14 is not installed (scripts/packages.sh develop, on Debian 12)")
    done = subprocess.run([program, "--dry-run", "-Werror", *own_files(".h", ".cpp", ".cu")], capture_output=True, text=True)
    assert not done.returncode, done.stderr[:2000]


def test_functions_stay_short():
    """Of tests one may be a long story."""
    long = [f"{path.relative_to(ROOT)}:{line}: {lines} lines: {head[:80]}" for path in own_files(".h", ".cpp", ".cu", ".ts", ".py")
            if "tests" not in path.relative_to(ROOT).parts
            for line, lines, head in functions_of(path) if lines > LONGEST_FUNCTION]
    assert not long, "\n".join(long)


def test_files_that_are_named_exist():
    """In comments and docs: a reader who follows a name finds the file."""
    listed = tracked()
    names = {pathlib.Path(name).name for name in listed}
    docs = [ROOT / name for name in listed if name.endswith(".md") and "/" not in name.removeprefix("docs/")]
    missing = []
    for path in [*own_files(".h", ".cpp", ".cu"), *docs]:
        for number, line in enumerate(path.read_text().splitlines(), 1):
            text = line if path.suffix == ".md" else line.partition("//")[2]
            for name in re.findall(r"[\w-]+\.(?:h|cpp|cu|md)\b", text):
                if name.lstrip("-") not in names:
                    missing.append(f"{path.relative_to(ROOT)}:{number} names {name}")
    assert not missing, "\n".join(missing)


def test_places_of_formulas_exist():
    """Where ARCHITECTURE.md says a formula lives; a name without a module is beside the one before it."""
    missing = []
    for row in re.findall(r"^\|.*\|$", (ROOT / "ARCHITECTURE.md").read_text(), re.MULTILINE):
        module = SOURCES
        for name in re.findall(r"`([\w/-]+\.(?:h|cpp))`", row):
            if (SOURCES / name).exists() and "/" in name:
                module = SOURCES / pathlib.Path(name).parts[0]
            elif not (module / name).exists() and not (ROOT / name).exists():
                missing.append(f"{name}: {row[:60]}")
    assert not missing, "\n".join(missing)


def test_type_names_are_unique_in_their_namespace():
    """Two types of one name in one namespace are undefined behaviour in a program that links both."""
    seen, twice = {}, []
    for path in SOURCES.rglob("*.h"):
        namespace = ""
        for line in path.read_text().splitlines():
            if match := re.match(r"namespace ([\w:]+) \{", line):
                namespace = match[1]
            elif match := re.match(r"(?:struct|class) (\w+)(?: final)?(?: :| \{)", line):
                name = f"{namespace}::{match[1]}"
                if seen.setdefault(name, path) != path:
                    twice.append(f"{name} in {seen[name].relative_to(ROOT)} and {path.relative_to(ROOT)}")
    assert not twice, "\n".join(twice)
