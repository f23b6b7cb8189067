"""More people watch than a robot has places for: a real page, through the real Janus."""

import pytest

from tests.support.browsers.visitor import Visitor
from tests.support.programs.janus import SECRET, Janus
from tests.support.sessions.site import running_site, wait_for

pytestmark = [pytest.mark.browser, pytest.mark.timeout(400), pytest.mark.nightly]


@pytest.fixture
def janus(tmp_path):
    with Janus(tmp_path / "janus") as running:
        yield running


def test_a_page_watches_through_janus_hears_why_it_is_gone_and_comes_back_and_the_drive_goes_on(
    tmp_path, janus, browser
):
    with running_site(
        tmp_path / "site",
        JANUS_URL=janus.url,
        JANUS_SECRET=SECRET,
        DIRECT_WATCHERS="0",
    ) as site:
        site.start_robot("giraff")
        driver, watcher = (
            Visitor(browser, site, "anna").drive(),
            Visitor(browser, site, "bob").open(),
        )
        driver.wait_for("link", "live")
        watcher.page.get_by_role("button", name="Watch").click()
        watcher.wait_for_picture(30.0)
        assert watcher.spread() > 10.0
        watcher.wait_for("phase", "watching")
        alert = watcher.page.locator("#alert")

        for key in ("ArrowLeft", "ArrowRight"):  # which turns the robot until Janus is back
            driver.page.keyboard.down(key)
            janus.kill()
            wait_for(
                lambda: "large audiences" in alert.text_content(), 20.0, "why there is no video"
            )
            assert driver.page_data("link") == "live"
            janus.start()
            shown = watcher.frames()
            wait_for(lambda after=shown + 3: watcher.frames() > after, 30.0, "video again")
            wait_for(lambda: "large audiences" not in alert.text_content(), 10.0, "the end of it")
            driver.page.keyboard.up(key)
        assert not watcher.problems

        driver.leave()
        closed = "SELECT id FROM telepresence_sessions_session WHERE closed_at IS NOT NULL"
        ((session,),) = wait_for(lambda: site.rows(closed), 30.0, "the whole record")
        assert [(name, outcome) for _, name, _, outcome in site.sessions()] == [
            ("anna", "completed")
        ]
        numbers = [state["seq"] for state in site.states(session)]
        assert numbers == list(range(numbers[0], numbers[0] + len(numbers))), "a state is missing"
        driver.close()
        watcher.close()
