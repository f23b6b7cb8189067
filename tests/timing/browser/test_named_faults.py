"""How soon the drive page says which part fails, whether it is killed or stopped."""

import contextlib
import signal
import sqlite3
import time

import psutil
import pytest

from tests.support.sessions.site import DATABASE, wait_for

pytestmark = [pytest.mark.browser, pytest.mark.nightly]
SOON = 2.0  # s
ALERTS = {
    "web": ("alert.server_only",),
    "broker": ("fault.broker.",),
    "session-manager": ("fault.session_manager.",),
    "giraff": ("fault.robot.", "alert.robot_offline"),
}


@pytest.fixture
def driver(site, visitor):
    if "giraff" not in site.processes:
        site.start_robot("giraff", "--start", "corridor-centre")
    driver = visitor("anna").drive()
    driver.wait_for("link", "live")
    wait_for(lambda: alert(driver) == "", 30, "a page without alerts")
    return driver


def alert(driver):
    return driver.page.locator("#alert").get_attribute("data-word") or ""


def tree(site, part):
    parent = psutil.Process(site.processes[part].pid)
    return [parent, *parent.children(recursive=True)]


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP], ids=["killed", "stopped"])
@pytest.mark.parametrize("part", ALERTS)
def test_the_page_says_within_two_seconds_what_fails(site, driver, part, number):
    stopped = tree(site, part)
    began = time.monotonic()
    if number == signal.SIGKILL:
        site.send(part, number)
    else:
        for process in stopped:
            process.suspend()
    try:
        wait_for(lambda: alert(driver).startswith(ALERTS[part]), 10, f"an alert about {part}")
        assert time.monotonic() - began <= SOON, alert(driver)
    finally:
        if number == signal.SIGKILL:
            site.processes.pop(part).wait()
            site.start(part)
        else:
            for process in stopped:
                process.resume()
    recovered = lambda: alert(driver) == "" and driver.page_data("link") == "live"
    wait_for(recovered, 40, "the end of the fault")


def test_the_page_says_within_two_seconds_that_the_database_is_locked(site, driver):
    database = sqlite3.connect(site.var / DATABASE, timeout=20, isolation_level=None)
    with contextlib.closing(database) as other:
        for pause in (0.0, 0.35, 0.7, 1.0):  # moments between two heartbeats of the session manager
            time.sleep(pause)
            other.execute("BEGIN IMMEDIATE")
            began = time.monotonic()
            wait_for(lambda: alert(driver).startswith("fault.database."), 10, "an alert")
            took = time.monotonic() - began
            other.execute("ROLLBACK")
            assert took <= SOON
            wait_for(lambda: alert(driver) == "", 40, "the end of the fault")
