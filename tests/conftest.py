"""Fixtures of every test."""

import collections
import contextlib
import gc
import os
import shutil
import sqlite3
import sys
import time
from collections.abc import Callable, Generator
from pathlib import Path

import pytest
from django.core.cache import cache
from django.db import connection
from django.test import TransactionTestCase
from django.utils import translation
from hypothesis import HealthCheck, settings

from telepresence_site.ops import fresh_site
from tests.support.collected import collected_files
from tests.support.sessions.site import empty_database

LONGEST_FILE_S = 20.0
LOCKED_SECONDS = 30.0

pytest.register_assert_rewrite(
    "tests.support.architectures.adapter_conformance", "tests.support.architectures.rca_conformance"
)

# A busy computer is slow at everything: an example that takes long is no finding. The same examples
# every time, so that a change is judged by what it changes; `pytest --hypothesis-profile=search`
# looks for others, and for more of them, and `quick` for a few, as `make check` does.
settings.register_profile(
    "search",
    deadline=None,
    max_examples=1000,
    suppress_health_check=[HealthCheck.too_slow],
)
settings.register_profile(
    "same", settings.get_profile("search"), derandomize=True, max_examples=100
)
settings.register_profile("quick", settings.get_profile("same"), max_examples=20)
settings.load_profile("same")


def pytest_sessionstart() -> None:
    """Collect the static files once, before the first test needs them."""
    collected_files()


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    """Let no garbage collection look through what lasts until the end: modules and tests are half
    a million objects, and a test that makes many would have them all looked through again.
    """
    gc.disable()
    try:
        return (yield)
    finally:
        gc.collect()
        gc.freeze()
        gc.enable()


@pytest.fixture(scope="session")
def django_db_keepdb(django_db_modify_db_settings: None) -> bool:
    """Tests of SQLite begin with a copy of the tables, made once for all processes: what all
    migrations make one after another takes each process five seconds.
    """
    if connection.vendor != "sqlite":
        return False
    path = Path(connection.creation._get_test_db_name())
    for leftover in path.parent.glob(f"{path.name}*"):  # with what was not written back to it
        leftover.unlink()
    shutil.copyfile(empty_database(), path)
    return True


@pytest.fixture(scope="session", autouse=True)
def site_that_is_set_up() -> None:
    """The first page does not ask for an administrator, whatever accounts a test creates, or an
    earlier test of the same process created. The tests of the first run undo this.
    """
    fresh_site._SetUp.is_set_up = True


@pytest.fixture(scope="session", autouse=True)
def emptied_by_a_copy() -> Generator[None, None, None]:
    """Empty SQLite after a test with transactions of its own by copying the empty tables over it:
    Django's way, which deletes row by row and makes all permissions anew, takes twenty times as
    long.
    """
    flush = TransactionTestCase._fixture_teardown

    def copy_empty(case: TransactionTestCase) -> None:
        if connection.vendor != "sqlite":
            flush(case)
            return
        with contextlib.closing(sqlite3.connect(empty_database())) as empty:
            connection.ensure_connection()
            empty.backup(connection.connection, progress=within(LOCKED_SECONDS))

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(TransactionTestCase, "_fixture_teardown", copy_empty)
        yield


def within(seconds: float) -> Callable[[int, int, int], None]:
    """Return what ends a copy that waits for longer than this for somebody's lock: without it,
    `Connection.backup` waits for ever.
    """
    deadline = time.monotonic() + seconds

    def look(status: int, remaining: int, total: int) -> None:
        if status in (sqlite3.SQLITE_BUSY, sqlite3.SQLITE_LOCKED) and time.monotonic() > deadline:
            raise TimeoutError("a connection that the test left open locks the database")

    return look


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup() -> None:
    """How often an address has tried something stands in the process's cache, and all tests of a
    process come from one address.
    """
    cache.clear()


@pytest.hookimpl(wrapper=True)
def pytest_runtest_teardown() -> Generator[None, object, object]:
    """A request in another language leaves it behind in its thread, which is the tests' own."""
    try:
        return (yield)
    finally:
        translation.deactivate()


@pytest.hookimpl(trylast=True)
def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    """Say at once what failed: a run that somebody ends would otherwise keep it to itself. Of
    several processes, the one that collects says it.
    """
    if report.failed and "PYTEST_XDIST_WORKER" not in os.environ:
        sys.stderr.write(
            f"\n{report.nodeid} ({report.when}) failed:\n{report.longreprtext[-2000:]}\n"
        )
        sys.stderr.flush()


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Begin with the files that are marked `long`, so that no core waits for another at the end."""
    items.sort(key=lambda item: item.get_closest_marker("long") is None)


def pytest_terminal_summary(terminalreporter) -> None:
    """Name the files whose tests took long together: each is to be made quicker, or is a matter of
    endurance.
    """
    seconds = collections.Counter()
    for reports in terminalreporter.stats.values():
        for report in reports:
            if isinstance(report, pytest.TestReport):
                seconds[report.location[0]] += report.duration
    for path, took in seconds.most_common():
        if took > LONGEST_FILE_S:
            terminalreporter.line(f"{took:6.1f} s  {path}: longer than {LONGEST_FILE_S:.0f} s")
