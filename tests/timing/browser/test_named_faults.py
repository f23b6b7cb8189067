"""How soon the page that somebody drives on says what fails, whichever part it is, and however it
fails.
"""

import contextlib
import signal
import sqlite3
import time

import psutil
import pytest

from tests.support.sessions.site import DATABASE, wait_for

pytestmark = [pytest.mark.browser, pytest.mark.nightly]
SOON = 2.0  # s
TOLD = {
    "web": ("alert.server_only",),
    "broker": ("fault.broker.",),
    "session-manager": ("fault.session_manager.",),
    "giraff": ("fault.robot.", "alert.robot_offline"),
}


@pytest.fixture
def driver(site, visitor):
    """Somebody who drives, with the robot's picture and its data channel."""
    if "giraff" not in site.processes:
        site.start_robot("giraff", "--start", "corridor-centre")
    someone = visitor("anna").drive()
    someone.wait_for("link", "live")
    wait_for(lambda: word(someone) == "", 30, "a page on which all is well")
    return someone


def word(someone):
    return someone.page.locator("#alert").get_attribute("data-word") or ""


def tree(site, part):
    parent = psutil.Process(site.processes[part].pid)
    return [parent, *parent.children(recursive=True)]


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP], ids=["killed", "stopped"])
@pytest.mark.parametrize("part", TOLD)
def test_the_page_says_within_two_seconds_what_fails(site, driver, part, number):
    stopped = tree(site, part)
    began = time.monotonic()
    if number == signal.SIGKILL:
        site.send(part, number)
    else:
        for process in stopped:
            process.suspend()
    try:
        told = wait_for(
            lambda: (found := word(driver)).startswith(TOLD[part]) and found,
            10,
            f"the word that {part} fails",
        )
        took = time.monotonic() - began
        assert took <= SOON, told
    finally:
        if number == signal.SIGKILL:
            site.processes.pop(part).wait()
            site.start(part)
        else:
            for process in stopped:
                process.resume()
    wait_for(lambda: word(driver) == "" and driver.page_data("link") == "live", 40, "the end of it")


def test_the_page_says_within_two_seconds_that_nobody_can_write_into_the_database(site, driver):
    with contextlib.closing(
        sqlite3.connect(site.var / DATABASE, timeout=20, isolation_level=None)
    ) as other:
        for pause in (0.0, 0.35, 0.7, 1.0):  # moments between two heartbeats of the session manager
            time.sleep(pause)
            other.execute("BEGIN IMMEDIATE")
            began = time.monotonic()
            wait_for(
                lambda: word(driver).startswith("fault.database."),
                10,
                "the word that the database fails",
            )
            took = time.monotonic() - began
            other.execute("ROLLBACK")
            assert took <= SOON
            wait_for(lambda: word(driver) == "", 40, "the end of it")
