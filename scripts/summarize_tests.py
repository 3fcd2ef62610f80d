"""Adds up the JUnit files of a folder; last line "N passed, N failed, N skipped"; exit code 1 on any failure.

    summarize_tests.py RESULTS UNIT_RESULTS

ctest's file in RESULTS knows of processes only; each writes the file of its tests, of the same name, into UNIT_RESULTS. One
that ended badly and whose file shows no failure (it has crashed, or has no file) counts as one failure.
"""

import pathlib
import sys
import xml.etree.ElementTree


def failed(case):
    return case.find("failure") is not None or case.find("error") is not None or case.get("status") == "fail"


def cases(path):
    return list(xml.etree.ElementTree.parse(path).iter("testcase"))


def told_by_its_own_file(case, unit_results):
    own = unit_results / f"{case.get('name')}.xml"
    return own.exists() and (not failed(case) or any(map(failed, cases(own))))


def count(results, unit_results):
    passed, failures, skipped = 0, [], {}
    for path in sorted(results.glob("*.xml")) + sorted(unit_results.glob("*.xml")):
        for case in cases(path):
            if path.name == "ctest.xml" and told_by_its_own_file(case, unit_results):
                continue
            name = f"{path.stem}: {case.get('classname', '')} {case.get('name')}"
            if failed(case):
                failures.append(name)
            elif case.find("skipped") is not None or case.get("status") in ("notrun", "disabled"):
                reason = case.find("skipped")
                skipped[name] = (reason.get("message") or "") if reason is not None else ""
            else:
                passed += 1
    return passed, failures, skipped


def main():
    passed, failures, skipped = count(*map(pathlib.Path, sys.argv[1:]))
    for name, reason in skipped.items():
        print(f"skipped {name} {reason}".rstrip())
    for name in failures:
        print("FAILED", name)
    print(f"{passed} passed, {len(failures)} failed, {len(skipped)} skipped")
    sys.exit(1 if failures or passed == 0 else 0)


main()
