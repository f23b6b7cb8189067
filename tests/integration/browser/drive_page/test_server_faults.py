"""What the drive page says of a server of which a part fails, or that says nothing any more."""

import pytest

from sessions import protocol
from tests.support.browsers.drive_page import driving, hold, opened

pytestmark = [pytest.mark.browser, pytest.mark.asyncio(loop_scope="module")]


async def alert(page, word):
    await page.wait_for_selector(f"#alert[data-word='{word}']:not([hidden])")
    return await page.inner_text("#alert")


NAMES = {
    "broker": "message service",
    "session_manager": "control service",
    "database": "database",
}
STOPS = "Unless it recovers, the robot stops in "


@pytest.mark.nightly
@pytest.mark.parametrize("part", NAMES)
async def test_a_part_that_fails_is_told_with_what_follows_until_it_is_back(browser, site, part):
    async with opened(browser, site, query="?go=1") as page:
        await driving(page)
        for _ in range(2):
            site.faults = (protocol.Fault(part=part, then="stops", seconds=9.0),)
            text = await alert(page, f"fault.{part}.stops")
            assert text.startswith(f"The server has a problem. {STOPS}")
            site.faults = (protocol.Fault(part=part, then="stopped"),)
            assert "The robot has stopped" in await alert(page, f"fault.{part}.stopped")
            site.faults = ()
            await page.wait_for_selector(
                f"#alert:not([data-word='fault.{part}.stopped'])", state="attached"
            )
        count = len(site.applied)
        await hold(page, "ArrowLeft", lambda: len(site.applied) > count + 3)


@pytest.mark.nightly
async def test_who_operates_the_robot_reads_which_part_it_is(browser, site):
    site.operates = True
    async with opened(browser, site, query="?go=1") as page:
        await driving(page)
        for part, name in NAMES.items():
            site.faults = (protocol.Fault(part=part, then="stops", seconds=9.0),)
            text = await alert(page, f"fault.{part}.stops")
            assert text.startswith(f"The server's {name} isn't responding. {STOPS}")


async def test_a_full_disk_is_said_and_stops_nobody(browser, site):
    async with opened(browser, site, query="?go=1") as page:
        await driving(page)
        site.faults = (protocol.Fault(part="disk_full", then="goes_on"),)
        assert "You can keep driving" in await alert(page, "fault.disk_full")
        count = len(site.applied)
        await hold(page, "ArrowLeft", lambda: len(site.applied) > count + 3)


@pytest.mark.nightly
async def test_a_server_that_keeps_its_socket_and_says_nothing_is_out_of_reach_and_asked_anew(
    browser, site
):
    async with opened(browser, site, query="?go=1") as page:
        await driving(page)
        session = site.session
        for _ in range(2):
            site.stopped = True
            assert (
                await alert(page, "alert.server_only")
                == "The server can't be reached. You can keep driving."
            )
            count = len(site.applied)
            await hold(page, "ArrowLeft", lambda count=count: len(site.applied) > count + 3)
            await page.keyboard.up("ArrowLeft")
            site.stopped = False
            await page.wait_for_selector(
                "#alert:not([data-word='alert.server_only'])", state="attached"
            )
        assert site.session == session


async def test_who_waits_in_line_reads_on_the_card_what_fails(browser, site):
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
