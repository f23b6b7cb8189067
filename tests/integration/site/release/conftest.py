"""The wheel of this checkout, built once for all tests of a process."""

import pytest

from tests.support.programs import wheels


@pytest.fixture(scope="session")
def wheel(tmp_path_factory):
    return wheels.build(tmp_path_factory.mktemp("wheel"))
