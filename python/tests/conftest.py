"""The module from the build folder ($MALUS_BUILD/python), unless an installed one is to be tested."""

import os
import pathlib
import sys

ROOT = pathlib.Path(__file__).resolve().parents[2]
if not os.environ.get("MALUS_TEST_INSTALLED"):
    sys.path.insert(0, str(pathlib.Path(os.environ.get("MALUS_BUILD", ROOT / "build/release")) / "python"))


def pytest_configure(config):
    config.addinivalue_line("markers", "slow: left out by ./test QUICK")
