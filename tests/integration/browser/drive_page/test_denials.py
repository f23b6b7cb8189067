"""The drive page's messages about requests that the server denies."""

import msgspec
import pytest

from robots.api import messages as m
from sessions import protocol
from tests.support.browsers.drive_page import driving, opened
from tests.support.patience import patient, until

pytestmark = [pytest.mark.browser, pytest.mark.asyncio(loop_scope="module")]
LINE = ":is(#alert, #card-warning)[data-word='{}']:visible"


async def alert(page, word):
    """Wait for a message over the video or on a card, and return its text."""
    page.set_default_timeout(1000 * patient(15))
    return await page.locator(LINE.format(word)).inner_text()


async def quiet(page, word):
    await page.locator(LINE.format(word)).wait_for(state="hidden")


async def test_denied_robot_is_requested_again(browser, site):
    site.denies["session/take"] = "unavailable"
    async with opened(browser, site, query="?go=1") as page:
        text = await alert(page, "denied.take")
        assert text == "The server couldn't give you the robot. It is asked again every 3 seconds."
        site.denies.clear()
        await driving(page)
        await quiet(page, "denied.take")


async def test_denied_video_is_requested_again(browser, site):
    site.denies["session/observe"] = "unavailable"
    async with opened(browser, site) as page:
        await page.click("[data-action='watch']")
        await alert(page, "denied.observe")
        site.denies.clear()
        await page.wait_for_selector("#drive-page[data-phase='watching']")
        await quiet(page, "denied.observe")


@pytest.mark.parametrize("reason", ["unavailable", "busy", "rate"])
async def test_denied_leave_is_shown_until_the_server_accepts_it(site, page, reason):
    site.denies["session/leave"] = reason
    await page.click("#leave")
    await page.click("[data-action='leave_now']")
    text = await alert(page, "denied.leave")
    assert text.endswith("Keep it open.")
    site.denies.clear()
    await until(lambda: not site.session)
    await quiet(page, "denied.leave")


async def test_denied_release_of_a_stop_can_be_requested_again_at_once(browser, site):
    site.operates = True
    stopped = m.Safety(estop=True, estop_source="screen:Giraff")
    site.online = False  # its own states report no stop
    site.denies["command/action"] = "unavailable"
    async with opened(browser, site) as page:
        await page.wait_for_selector("#card[data-card^=lobby]")
        state = msgspec.structs.replace(site._state(), safety=stopped)
        site.tell("robot", protocol.RobotPresence(online=True))
        site.tell("state", state)
        await page.click("[data-action='release_stop']")
        await alert(page, "denied.action")
        await page.wait_for_selector("[data-action='release_stop']")
