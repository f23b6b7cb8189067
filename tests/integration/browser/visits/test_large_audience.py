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


def test_a_page_watches_through_janus_hears_why_it_is_gone_and_comes_back(tmp_path, janus, browser):
    with running_site(
        tmp_path / "site",
        JANUS_URL=janus.url,
        JANUS_SECRET=SECRET,
        DIRECT_WATCHERS="0",
    ) as site:
        site.start_robot("giraff")
        watcher = Visitor(browser, site, "bob").open()
        watcher.page.get_by_role("button", name="Watch").click()
        watcher.wait_for_picture(30.0)
        assert watcher.spread() > 10.0
        watcher.wait_for("phase", "watching")

        janus.kill()
        wait_for(
            lambda: "large audiences" in watcher.page.locator("#alert").text_content(),
            20.0,
            "why there is no video",
        )
        janus.start()
        shown = watcher.frames()
        wait_for(lambda: watcher.frames() > shown + 3, 30.0, "video again")
        alert = watcher.page.locator("#alert")
        wait_for(lambda: "large audiences" not in alert.text_content(), 10.0, "the end of it")
        assert not watcher.problems
        watcher.close()
