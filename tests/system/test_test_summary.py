"""scripts/summarize_tests.py: what ./test says last."""

import pathlib
import subprocess
import sys

SCRIPT = pathlib.Path(__file__).resolve().parents[2] / "scripts/summarize_tests.py"
PASSED, FAILED, SKIPPED = "", "<failure/>", '<skipped message="needs a camera"/>'


def write(path, **outcome_of):
    path.parent.mkdir(exist_ok=True)
    cases = "".join(f'<testcase name="{name}" classname="C">{outcome}</testcase>' for name, outcome in outcome_of.items())
    path.write_text(f"<testsuite>{cases}</testsuite>")


def summary(folder):
    run = subprocess.run([sys.executable, SCRIPT, folder / "results", folder / "unit"], capture_output=True, text=True)
    return run.stdout.splitlines(), run.returncode


def test_parts_are_counted_by_their_tests(tmp_path):
    write(tmp_path / "results/ctest.xml", part1=PASSED, part2=PASSED, fuzz=PASSED)
    write(tmp_path / "results/system.xml", a=PASSED, b=SKIPPED)
    write(tmp_path / "unit/part1.xml", x=PASSED, y=PASSED)
    write(tmp_path / "unit/part2.xml", z=SKIPPED)
    lines, code = summary(tmp_path)
    assert lines[-1] == "4 passed, 0 failed, 2 skipped" and code == 0
    assert "skipped system: C b needs a camera" in lines and "skipped part2: C z needs a camera" in lines


def test_failed_tests_are_named_once(tmp_path):
    write(tmp_path / "results/ctest.xml", part1=FAILED)
    write(tmp_path / "unit/part1.xml", x=PASSED, y=FAILED)
    lines, code = summary(tmp_path)
    assert lines == ["FAILED part1: C y", "1 passed, 1 failed, 0 skipped"] and code == 1


def test_a_part_that_ends_before_its_file_counts(tmp_path):
    write(tmp_path / "results/ctest.xml", crashed=FAILED, crashed_at_its_end=FAILED, other=PASSED)
    write(tmp_path / "unit/other.xml", x=PASSED)
    write(tmp_path / "unit/crashed_at_its_end.xml", y=PASSED)
    lines, code = summary(tmp_path)
    assert lines[-1] == "2 passed, 2 failed, 0 skipped" and code == 1


def test_nothing_that_ran_is_no_success(tmp_path):
    write(tmp_path / "results/ctest.xml")
    (tmp_path / "unit").mkdir()
    assert summary(tmp_path) == (["0 passed, 0 failed, 0 skipped"], 1)
