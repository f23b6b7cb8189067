"""Firefox ESR plays the video, and drives with keys and mouse."""

import pytest

from tests.support.browsers.firefox import firefox
from tests.support.browsers.visitor import SPREAD
from tests.support.sessions.site import LOOPBACK, wait_for

pytestmark = [pytest.mark.browser, pytest.mark.nightly]
ARROW_UP = "\ue013"
# Firefox leaves getVideoPlaybackQuality() at 0 for streams, so frames are counted as they are
# presented.
COUNT = """(() => {
  const video = document.getElementById('video');
  window.shownFrames = 0;
  const next = () => { window.shownFrames += 1; video.requestVideoFrameCallback(next); };
  video.requestVideoFrameCallback(next);
  return true;
})()"""
FLOOR = """(() => {
  const box = document.getElementById('video').getBoundingClientRect();
  return [box.left + box.width / 2, box.top + 0.75 * box.height];
})()"""


def test_firefox_plays_the_video_and_drives_with_keys_and_by_a_press_on_the_floor(site):
    giraff = site.start_robot("giraff", "--start", "lab-before-door")
    with firefox() as browser:
        browser.set_cookie("sessionid", site.sign_in("fiona"), LOOPBACK)
        browser.goto(f"{site.url}/robots/giraff/?go=1")
        browser.evaluate(COUNT)
        wait_for(
            lambda: browser.evaluate("window.shownFrames") > 25, 30, "a moving picture in Firefox"
        )
        assert browser.evaluate(f"({SPREAD})()") > 8
        start = giraff.truth()
        browser.hold(ARROW_UP, lambda: start.y - giraff.truth().y > 0.5, 15, "half a metre")
        wait_for(lambda: abs(giraff.truth().linear) < 0.01, 5, "a standing robot")
        # A page that is held up for half a second drives by the other way meanwhile.
        wait_for(
            lambda: (
                browser.evaluate("document.getElementById('drive-page').dataset.transport")
                == "datachannel"
            ),
            10,
            "the direct way",
        )
        pressed = giraff.truth()
        browser.click(*browser.evaluate(FLOOR))
        wait_for(
            lambda: pressed.y - giraff.truth().y > 0.3,
            15,
            "a robot that comes to where it was pressed",
        )
