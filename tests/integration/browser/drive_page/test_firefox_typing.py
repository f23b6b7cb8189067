"""Typing in Firefox never drives."""

import pytest

from tests.support.browsers.drive_page import moves
from tests.support.browsers.firefox import firefox
from tests.support.browsers.present_robot_page import CAPABILITIES, PresentRobotPage
from tests.support.sessions.site import wait_for

pytestmark = [pytest.mark.browser, pytest.mark.nightly]
TEXT = "Hello, is anybody there?"


@pytest.fixture
def site():
    with PresentRobotPage(capabilities=(*CAPABILITIES, "goto", "dock")) as fake:
        yield fake


def test_firefox_writes_what_is_typed_at_once_after_write_and_does_not_drive_by_it(site):
    middle = (
        "(() => { const box = document.querySelector('#presence-talk').getBoundingClientRect();"
        " return [box.x + box.width / 2, box.y + box.height / 2]; })()"
    )
    with firefox() as browser:
        browser.goto(f"{site.url}?go=1")
        wait_for(
            lambda: browser.evaluate(
                "document.querySelector('#drive-page[data-playing][data-link=live]') !== null"
            ),
            40,
            "a picture in Firefox",
        )
        wait_for(
            lambda: browser.evaluate("document.querySelector('#presence-talk')?.checkVisibility()"),
            10,
            "a button to write",
        )
        for _ in range(2):
            moved, tilt = moves(site), site.tilt
            browser.click(*browser.evaluate(middle))
            for letter in TEXT:
                browser.key("keyDown", letter)
                browser.key("keyUp", letter)
            assert browser.evaluate("document.querySelector('#talk-field').value") == TEXT
            assert (moves(site), site.tilt) == (moved, tilt)
            browser.key("keyDown", "\ue007")
            browser.key("keyUp", "\ue007")
            wait_for(
                lambda: browser.evaluate("document.querySelector('#talk-writing').hidden"),
                5,
                "a field that is closed",
            )
        browser.hold("a", lambda moved=moved: moves(site) > moved, 10, "keys that drive")
