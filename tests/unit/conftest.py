"""What every test of this lane keeps to: it starts no process, connects to nothing, opens no
database and does not sleep.
"""

import sys
from collections.abc import Generator

import pytest

FORBIDDEN = frozenset(
    {
        "subprocess.Popen",
        "os.fork",
        "os.posix_spawn",
        "socket.connect",
        "socket.bind",
        "sqlite3.connect",
        "time.sleep",
    }
)
_running: list[str] = []


class NotAUnitTestError(AssertionError):
    """It belongs into tests/integration, or into tests/timing when real time is what it tests."""


def _refuse(event: str, arguments: tuple[object, ...]) -> None:
    if event in FORBIDDEN and _running:
        raise NotAUnitTestError(f"{_running[-1]}: {event} {arguments}")


# it cannot be taken off again, so that it asks whether a test of this lane runs
sys.addaudithook(_refuse)


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup(item: pytest.Item) -> None:
    """Hold the test to the rules of its lane."""
    _running.append(item.nodeid)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_teardown() -> Generator[None, object, object]:
    try:
        return (yield)
    finally:
        _running.pop()
