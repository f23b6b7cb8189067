"""Typing in Firefox never drives."""

import pytest

from tests.support.browsers.drive_page import moves
from tests.support.browsers.firefox import firefox
from tests.support.browsers.present_robot_page import CAPABILITIES, PresentRobotPage
from tests.support.sessions.site import wait_for

pytestmark = [pytest.mark.browser, pytest.mark.nightly]
TEXT = "Hello, is anybody there?"
PLAYING = "document.querySelector('#drive-page[data-playing][data-link=live]') !== null"
CLOSED = "document.querySelector('#talk-writing').hidden"
MIDDLE = """(() => {
  const box = document.querySelector('#presence-talk').getBoundingClientRect();
  return [box.x + box.width / 2, box.y + box.height / 2];
})()"""


@pytest.fixture
def site():
    with PresentRobotPage(capabilities=(*CAPABILITIES, "goto", "dock")) as fake:
        yield fake


def test_text_typed_right_after_write_in_firefox_never_drives(site):
    with firefox() as browser:
        browser.goto(f"{site.url}?go=1")
        wait_for(lambda: browser.evaluate(PLAYING), 40, "video in Firefox")
        visible = "document.querySelector('#presence-talk')?.checkVisibility()"
        wait_for(lambda: browser.evaluate(visible), 10, "a button to write")
        for _ in range(2):
            moved, tilt = moves(site), site.tilt
            browser.click(*browser.evaluate(MIDDLE))
            for character in TEXT:
                browser.key("keyDown", character)
                browser.key("keyUp", character)
            assert browser.evaluate("document.querySelector('#talk-field').value") == TEXT
            assert (moves(site), site.tilt) == (moved, tilt)
            browser.key("keyDown", "\ue007")
            browser.key("keyUp", "\ue007")
            wait_for(lambda: browser.evaluate(CLOSED), 5, "the field to close")
        browser.hold("a", lambda moved=moved: moves(site) > moved, 10, "keys that drive")
