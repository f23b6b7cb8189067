"""The wheel, installed by pip on this computer and on a bare Debian 12: the agent and a site whose
robot moves. The times are printed.
"""

import os
import re
import shutil
import time

import pytest
from playwright.sync_api import expect

from telepresence import __version__
from tests.support.browsers.running_demo import LINK
from tests.support.patience import patient
from tests.support.programs import wheels
from tests.support.sessions.site import free_port, wait_for

pytestmark = [pytest.mark.browser, pytest.mark.nightly, pytest.mark.long, pytest.mark.timeout(900)]
ALLOWED = {"agent": 30.0, "site": 60.0}  # seconds from nothing installed to a robot that moves

# it leaves its dock
MOVES = ("data-word", re.compile(r"task\.(done\.)?undock"))


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    return wheels.build(tmp_path_factory.mktemp("wheel"))


@pytest.fixture(scope="module", params=["this computer", "a bare Debian 12"])
def computer(request, wheel, tmp_path_factory):
    folder = tmp_path_factory.mktemp("computer")
    if request.param == "this computer":
        yield wheels.this_computer(wheel, folder)
    elif os.geteuid() != 0 or shutil.which("mmdebstrap") is None:
        pytest.skip("only root can make a Debian, with mmdebstrap")
    else:
        yield wheels.bare_debian(wheel, folder / "root")
    shutil.rmtree(folder, ignore_errors=True)  # a gigabyte


def test_agent_is_installed_and_moves_a_robot(computer):
    installing = computer.install("agent", "navigation")
    assert computer.run("agent/bin/telepresence", "--version") == f"{__version__}\n"
    started = time.monotonic()
    robot = ("run_robot", "giraff", "--adapter", "simulator", "--check", "--yes")
    assert computer.run("agent/bin/telepresence", *robot).endswith("All is well.\n")
    checking = time.monotonic() - started
    print(f"agent: installed in {installing:.1f} s, checked in {checking:.1f} s")
    assert installing + checking < patient(ALLOWED["agent"])


def test_site_is_installed_and_a_visitor_moves_its_robot(computer, browser):
    installing = computer.install("site", "site")
    started, port = time.monotonic(), str(free_port())
    with computer.running("site/bin/telepresence", "demo", "--port", port) as output:
        link = wait_for(lambda: re.search(LINK, output.read_text()), 90, "a link", output.read_text)
        page = browser.new_page()
        page.goto(link.group(1))
        expect(page.locator("#offer")).to_have_attribute(*MOVES, timeout=patient(40) * 1000)
        moving = time.monotonic() - started
        page.goto(f"http://127.0.0.1:{port}/")
        expect(page.locator(".foot__version")).to_have_text(f"Telepresence {__version__}")
        page.close()
    print(f"site: installed in {installing:.1f} s, a robot moved after {moving:.1f} s")
    assert (computer.home / ".local/share/telepresence/telepresence.sqlite3").exists()
    assert installing + moving < patient(ALLOWED["site"])
