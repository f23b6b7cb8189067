"""The wheel of this checkout, built once for all tests of a process."""

import sys

import pytest

from tests.support.paths import ROOT
from tests.support.programs.finished import run


@pytest.fixture(scope="session")
def wheel(tmp_path_factory):
    folder = tmp_path_factory.mktemp("wheel")
    words = ("-m", "hatchling", "build", "-t", "wheel", "-d", folder)
    run(sys.executable, *words, cwd=ROOT, check=True)
    (built,) = folder.glob("*.whl")
    return built
