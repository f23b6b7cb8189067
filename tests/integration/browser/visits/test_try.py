"""A visitor without an account tries a simulated robot twice, from the demo's first page to the
invitation to sign up.
"""

import re

import pytest
from playwright.sync_api import expect

from telepresence_site.practice.pool import LINGER
from tests.support.browsers.running_demo import demo
from tests.support.browsers.visitor import Visitor
from tests.support.patience import patient
from tests.support.sessions.site import Site, free_port, wait_for

pytestmark = [pytest.mark.browser, pytest.mark.nightly]
STARTED = 60_000  # ms until a practice robot runs on a busy computer
TURN = 15.0  # s; the default is a minute


def test_stranger_tries_a_robot_twice_and_is_invited_to_sign_up(tmp_path, browser):
    port, settings = free_port(), {"PRACTICE_ROBOTS": "1", "TRIAL_SECONDS": str(TURN)}
    with demo(tmp_path / "var", "--port", str(port), **settings) as running:
        running.link()
        stranger = Visitor(browser, Site(tmp_path / "var", web_port=port))
        page = stranger.page
        for attempt in range(2):
            page.goto("/")
            page.get_by_role("button", name="Try a simulated robot now").click()
            expect(page).to_have_url(re.compile("/practice/practice-1/"), timeout=STARTED)
            stranger.wait_for_picture()
            stranger.wait_for("link", "live")
            driven = page.locator("#dial-distance")
            expect(driven).not_to_have_text(re.compile(r"^(–|0\.0)$"), timeout=STARTED)
            if attempt:
                stranger.leave()
            card = page.get_by_role("heading", name="That was a simulated robot")
            expect(card).to_be_visible(timeout=1000 * patient(TURN))
        page.get_by_role("button", name="Sign up and drive").click()
        expect(page).to_have_url(re.compile("/accounts/signup/"))


def test_user_tries_a_robot_again_after_the_simulated_one_has_ended(tmp_path, browser):
    port = free_port()
    with demo(tmp_path / "var", "--port", str(port), PRACTICE_ROBOTS="1") as running:
        running.link()
        ana = Visitor(browser, Site(tmp_path / "var", web_port=port), "ana")
        page = ana.page
        page.goto("/try/")
        for _ in range(2):
            expect(page).to_have_url(re.compile("/practice/practice-1/"), timeout=STARTED)
            ana.wait_for_picture()
            expect(page.get_by_role("link", name="All robots")).to_be_visible()
            ana.leave()
            with page.expect_request("**/try/"):
                page.get_by_role("button", name="Drive again").click()
        # later its page is opened again from a bookmark
        page.goto("/about/")
        robot = lambda: running.find("run_robot", "practice-1")
        wait_for(lambda: not robot(), 2 * LINGER, "the end of the practice robot")
        page.goto("/practice/practice-1/")
        with page.expect_request("**/try/"):
            page.get_by_role("button", name="Try again").click(timeout=STARTED)
        expect(page).to_have_url(re.compile("/practice/practice-1/"), timeout=STARTED)
        ana.wait_for_picture()
