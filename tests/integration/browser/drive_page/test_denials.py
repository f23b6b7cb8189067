"""What the drive page says when the server does not do what the page asked for."""

import msgspec
import pytest

from robots.api import messages as m
from sessions import protocol
from tests.support.browsers.drive_page import driving, opened, until
from tests.support.patience import patient

pytestmark = [pytest.mark.browser, pytest.mark.asyncio(loop_scope="module")]


async def alert(page, word):
    """Wait until the line over the video, or the one on the card before it, says this."""
    page.set_default_timeout(1000 * patient(15))
    line = page.locator(f":is(#alert, #card-warning)[data-word='{word}']:visible")
    return await line.inner_text()


async def quiet(page, word):
    """Wait until no line says this any more."""
    line = page.locator(f":is(#alert, #card-warning)[data-word='{word}']:visible")
    await line.wait_for(state="hidden")


async def test_a_robot_that_the_server_cannot_give_is_asked_for_again(browser, site):
    site.denies["session/take"] = "unavailable"
    async with opened(browser, site, query="?go=1") as page:
        text = await alert(page, "denied.take")
        assert text == "The server couldn't give you the robot. It is asked again every 3 seconds."
        site.denies.clear()
        await driving(page)
        await quiet(page, "denied.take")


async def test_video_that_the_server_cannot_give_is_asked_for_again(browser, site):
    site.denies["session/observe"] = "unavailable"
    async with opened(browser, site) as page:
        await page.click("[data-action='watch']")
        await alert(page, "denied.observe")
        site.denies.clear()
        await page.wait_for_selector("#drive-page[data-phase='watching']")
        await quiet(page, "denied.observe")


@pytest.mark.parametrize("reason", ["unavailable", "busy", "rate"])
async def test_who_leaves_reads_that_the_server_does_not_know_it(browser, site, reason):
    async with opened(browser, site, query="?go=1") as page:
        await driving(page)
        site.denies["session/leave"] = reason
        await page.click("#leave")
        await page.click("[data-action='leave_now']")
        text = await alert(page, "denied.leave")
        assert text.endswith("Keep it open.")
        site.denies.clear()
        await until(lambda: not site.session)
        await quiet(page, "denied.leave")


async def test_a_release_that_the_server_denies_can_be_asked_for_at_once(browser, site):
    site.operates = True
    stopped = m.Safety(estop=True, estop_source="screen:Giraff")
    site.online = False  # its own states would say that it is free
    site.denies["command/action"] = "unavailable"
    async with opened(browser, site) as page:
        await page.wait_for_selector("#card[data-card^=lobby]")
        state = msgspec.structs.replace(site._state(), safety=stopped)
        site.tell("robot", protocol.RobotPresence(online=True))
        site.tell("state", state)
        await page.click("[data-action='release_stop']")
        await alert(page, "denied.action")
        await page.wait_for_selector("[data-action='release_stop']")
