"""The module from the build folder ($MALUS_BUILD/python), unless an installed one is to be tested."""

import os
import pathlib
import sys

import pytest

ROOT = pathlib.Path(__file__).resolve().parents[2]
if not os.environ.get("MALUS_TEST_INSTALLED"):
    sys.path.insert(0, str(pathlib.Path(os.environ.get("MALUS_BUILD", ROOT / "build/release")) / "python"))


def pytest_configure(config):
    config.addinivalue_line("markers", "slow: left out by ./test QUICK")


@pytest.fixture(scope="module")
def model(request):
    """The one that the tests' file names, MODEL."""
    import malus
    return malus.Model(request.module.MODEL)


@pytest.fixture(scope="module")
def black(model):
    return model.as_dict()["black"]["value"]
