"""Observers beyond the direct connections of a robot watch through a real Janus."""

import pytest

from tests.support.browsers.visitor import Visitor
from tests.support.programs.janus import SECRET, Janus
from tests.support.sessions.site import running_site, wait_for

pytestmark = [pytest.mark.browser, pytest.mark.timeout(400), pytest.mark.nightly]
LARGE = "large audiences"


@pytest.fixture
def janus(tmp_path):
    with Janus(tmp_path / "janus") as running:
        yield running


def test_observer_through_janus_reads_why_video_is_lost_until_it_returns(tmp_path, janus, browser):
    settings = {"JANUS_URL": janus.url, "JANUS_SECRET": SECRET, "DIRECT_WATCHERS": "0"}
    with running_site(tmp_path / "site", **settings) as site:
        site.start_robot("giraff")
        driver = Visitor(browser, site, "anna").drive()
        watcher = Visitor(browser, site, "bob").open()
        driver.wait_for("link", "live")
        watcher.page.get_by_role("button", name="Watch").click()
        watcher.wait_for_picture(30.0)
        assert watcher.spread() > 10.0
        watcher.wait_for("phase", "watching")
        alert = watcher.page.locator("#alert")

        for key in ("ArrowLeft", "ArrowRight"):  # which turns the robot until Janus is back
            driver.page.keyboard.down(key)
            janus.kill()
            wait_for(lambda: LARGE in alert.text_content(), 20.0, "why there is no video")
            assert driver.page_data("link") == "live"
            janus.start()
            shown = watcher.frames()
            wait_for(lambda after=shown + 3: watcher.frames() > after, 30.0, "video again")
            wait_for(lambda: LARGE not in alert.text_content(), 10.0, "the end of it")
            driver.page.keyboard.up(key)
        assert not watcher.problems

        driver.leave()
        closed = "SELECT id FROM telepresence_sessions_session WHERE closed_at IS NOT NULL"
        ((session,),) = wait_for(lambda: site.rows(closed), 30.0, "the whole record")
        (ended,) = site.sessions()
        assert (ended[1], ended[3]) == ("anna", "completed")
        numbers = [state["seq"] for state in site.states(session)]
        assert numbers == list(range(numbers[0], numbers[0] + len(numbers))), "a state is missing"
        driver.close()
        watcher.close()
