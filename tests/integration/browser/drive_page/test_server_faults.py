"""The drive page's messages about a failing part of the server, and about a silent server."""

import pytest

from sessions import protocol
from tests.support.browsers.drive_page import driven, hold, opened

pytestmark = [pytest.mark.browser, pytest.mark.asyncio(loop_scope="module")]


async def alert(page, word):
    await page.wait_for_selector(f"#alert[data-word='{word}']:not([hidden])")
    return await page.inner_text("#alert")


async def goes_on(page, site):
    count = len(site.applied)
    await hold(page, "ArrowLeft", lambda: len(site.applied) > count + 3)


NAMES = {"broker": "message service", "session_manager": "control service", "database": "database"}
STOPS = "Unless it recovers, the robot stops in "


@pytest.mark.nightly
@pytest.mark.parametrize("part", NAMES)
async def test_failing_part_and_its_consequence_are_shown_until_it_recovers(site, page, part):
    for _ in range(2):
        site.faults = (protocol.Fault(part=part, then="stops", seconds=9.0),)
        text = await alert(page, f"fault.{part}.stops")
        assert text.startswith(f"The server has a problem. {STOPS}")
        site.faults = (protocol.Fault(part=part, then="stopped"),)
        assert "The robot has stopped" in await alert(page, f"fault.{part}.stopped")
        site.faults = ()
        over = f"#alert:not([data-word='fault.{part}.stopped'])"
        await page.wait_for_selector(over, state="attached")
    await goes_on(page, site)


@pytest.mark.nightly
async def test_operator_reads_which_part_fails(browser, site):
    site.operates = True
    async with driven(browser, site) as page:
        for part, name in NAMES.items():
            site.faults = (protocol.Fault(part=part, then="stops", seconds=9.0),)
            text = await alert(page, f"fault.{part}.stops")
            assert text.startswith(f"The server's {name} isn't responding. {STOPS}")


async def test_full_disk_is_shown_and_driving_goes_on(site, page):
    site.faults = (protocol.Fault(part="disk_full", then="goes_on"),)
    assert "You can keep driving" in await alert(page, "fault.disk_full")
    await goes_on(page, site)


@pytest.mark.nightly
async def test_server_with_open_socket_but_silent_counts_as_out_of_reach(site, page):
    session = site.session
    for _ in range(2):
        site.stopped = True
        text = await alert(page, "alert.server_only")
        assert text == "The server can't be reached. You can keep driving."
        await goes_on(page, site)
        await page.keyboard.up("ArrowLeft")
        site.stopped = False
        over = "#alert:not([data-word='alert.server_only'])"
        await page.wait_for_selector(over, state="attached")
    assert site.session == session


async def test_card_of_the_queue_shows_what_fails(browser, site):
    async with (
        opened(browser, site, query="?go=1") as driver,
        opened(browser, site, query="?go=1") as page,
    ):
        await driver.wait_for_selector("#drive-page[data-phase=driving]")
        await page.wait_for_selector("#drive-page[data-phase=queued]")
        for part in NAMES:
            site.faults = (protocol.Fault(part=part, then="waits"),)
            line = page.locator(f"#card-warning[data-word='fault.{part}.waits']:visible")
            assert "You keep your place" in await line.inner_text()
        site.faults = ()
        await page.locator("#card-warning").wait_for(state="hidden")
