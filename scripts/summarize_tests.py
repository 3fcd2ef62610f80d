"""Adds up the JUnit files of a folder; last line "N passed, N failed, N skipped"; exit code 1 on any failure."""

import pathlib
import sys
import xml.etree.ElementTree


def count(folder):
    passed, failed, skipped = 0, [], {}
    for path in sorted(pathlib.Path(folder).glob("*.xml")):
        for case in xml.etree.ElementTree.parse(path).iter("testcase"):
            name = f"{path.stem}: {case.get('classname', '')} {case.get('name')}"
            if case.find("failure") is not None or case.find("error") is not None or case.get("status") == "fail":
                failed.append(name)
            elif case.find("skipped") is not None or case.get("status") in ("notrun", "disabled"):
                reason = case.find("skipped")
                skipped[name] = (reason.get("message") or "") if reason is not None else ""
            else:
                passed += 1
    return passed, failed, skipped


def main():
    passed, failed, skipped = count(sys.argv[1])
    for name, reason in skipped.items():
        print(f"skipped {name} {reason}".rstrip())
    for name in failed:
        print("FAILED", name)
    print(f"{passed} passed, {len(failed)} failed, {len(skipped)} skipped")
    sys.exit(1 if failed or passed == 0 else 0)


main()
