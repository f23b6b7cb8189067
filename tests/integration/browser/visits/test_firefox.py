"""Firefox ESR plays the video, and drives with keys and mouse."""

import pytest

from tests.support.browsers.firefox import firefox
from tests.support.browsers.visitor import SPREAD
from tests.support.sessions.site import LOOPBACK, wait_for

pytestmark = [pytest.mark.browser, pytest.mark.nightly]
ARROW_UP = "\ue013"
# In Firefox getVideoPlaybackQuality() is 0 for streams, so presented frames are counted.
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


def test_firefox_plays_video_and_drives_by_keys_and_mouse(site):
    giraff = site.start_robot("giraff", "--start", "lab-before-door")
    with firefox() as browser:
        browser.set_cookie("sessionid", site.sign_in("fiona"), LOOPBACK)
        browser.goto(f"{site.url}/robots/giraff/?go=1")
        browser.evaluate(COUNT)
        wait_for(lambda: browser.evaluate("window.shownFrames") > 25, 30, "video in Firefox")
        assert browser.evaluate(f"({SPREAD})()") > 8
        start = giraff.truth()
        browser.hold(ARROW_UP, lambda: start.y - giraff.truth().y > 0.5, 15, "half a metre")
        wait_for(lambda: abs(giraff.truth().linear) < 0.01, 5, "a robot at rest")
        # A page that was delayed by half a second uses the other transport for a while.
        used = "document.getElementById('drive-page').dataset.transport"
        wait_for(lambda: browser.evaluate(used) == "datachannel", 10, "the data channel")
        pressed = giraff.truth()
        browser.click(*browser.evaluate(FLOOR))
        wait_for(lambda: pressed.y - giraff.truth().y > 0.3, 15, "a drive to the pressed point")
