"""The first minute and the last: the queue, the turn, the question whether the visitor is present,
and browsers without live video.
"""

import asyncio
import time
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager

import pytest
from playwright.async_api import Browser, Page

from sessions import protocol
from tests.support.browsers.drive_page import driven, driving, hold, opened
from tests.support.browsers.drive_page_scenes import FREE
from tests.support.browsers.fake_robot_page import PRACTICE, FakeRobotPage
from tests.support.media.picture_server import jpeg_of
from tests.support.patience import PRESSED, patient, until

pytestmark = [pytest.mark.browser, pytest.mark.asyncio(loop_scope="module")]
INSTAGRAM = (
    "Mozilla/5.0 (iPhone; CPU iPhone OS 15_0 like Mac OS X) AppleWebKit/605.1.15 (KHTML, like"
    " Gecko) Mobile/15E148 Instagram 334.0"
)


async def repeat_until_shown(page: Page, card: str, send: Callable[[], None]) -> None:
    """Repeat a message until the page shows its card: unlike the real server, this one loses
    messages while a page reconnects its WebSocket.
    """
    deadline = time.monotonic() + patient(20)
    while await page.locator(f"#card[data-card='{card}']:visible").count() == 0:
        assert time.monotonic() < deadline, f"the card {card} never came"
        send()
        await asyncio.sleep(0.5)


async def ask_whether_present(page: Page, site: FakeRobotPage) -> None:
    asked = protocol.PresenceAsked(session=site.session, seconds=30.0)
    await repeat_until_shown(page, "idle", lambda: site.tell("session/asked_there", asked))


@asynccontextmanager
async def driver_and_next(
    browser: Browser, site: FakeRobotPage
) -> AsyncIterator[tuple[Page, Page]]:
    """The page of a driver, and that of a visitor who is next in the queue."""
    async with driven(browser, site) as first, opened(browser, site, query="?go=1") as second:
        for page in (first, second):
            page.set_default_timeout(patient(20) * 1000)
        await second.wait_for_selector("#card[data-card='queued.next']")
        yield first, second


def signs(site: FakeRobotPage) -> list[protocol.PageEvent]:
    return [event for event in site.received("page/event") if event.type == protocol.HERE]


@pytest.mark.nightly
async def test_visitor_of_a_robot_that_did_not_dock_is_offered_a_free_one(browser, site):
    site.others = [{**FREE, "name": "rhodon", "action": "Drive Rhodon"}]
    async with opened(browser, site, query="?go=1") as first, opened(browser, site) as second:
        await driving(first)
        await second.click("text=Wait for my turn")
        pause = lambda: site.keep_waiting("paused: dock_failed")
        await repeat_until_shown(second, "queued.paused", pause)
        await second.click("#card-instead > a:has-text('Drive Rhodon')")
        await second.wait_for_url(f"**{PRACTICE}")
        assert site.received("session/leave")
    site.others = []


async def test_visitor_confirms_presence_by_button_or_any_input(site, page):
    for give in (lambda: page.click("#card-main"), lambda: page.mouse.wheel(0, 1)):
        known = len(signs(site))
        await ask_whether_present(page, site)
        assert await page.title() == "Are you still there? · Giraff · Telepresence"
        await give()
        await page.wait_for_selector("#card", state="hidden")
        assert await page.evaluate("document.activeElement.id") == "viewport"
        # sent again, as the server has not confirmed it
        await until(lambda known=known: len(signs(site)) >= known + 2)
        site.tell("session/found_there", protocol.PresenceConfirmed(session=site.session))
    assert "still there" not in await page.title()


async def test_session_that_ended_while_idle_says_why(site, page):
    await ask_whether_present(page, site)
    over = protocol.Ended(session=site.session, outcome="timed_out", reason="idle")
    await repeat_until_shown(page, "ended.idle", lambda: site.tell("session/ended", over))


@pytest.mark.nightly
async def test_turn_is_announced_in_the_title_and_expires(browser, site):
    async with driver_and_next(browser, site) as (_, second):
        await asyncio.sleep(PRESSED)
        site.offer_turn(8.0)
        await second.wait_for_selector("#card[data-card=turn]")
        assert await second.title() == "It is your turn · Giraff · Telepresence"
        await second.wait_for_selector("#card[data-card='ended.turn_missed']")


@pytest.mark.nightly
async def test_waiting_visitor_practises_until_the_turn(browser, site):
    site.practice = {"url": None}  # starting
    async with driver_and_next(browser, site) as (_, second):
        await second.click("#card-main")
        await second.wait_for_selector("#card[data-card='queued.next'][data-busy]")
        site.practice = {"url": PRACTICE}
        await second.wait_for_selector("#practice:not([hidden])")
        practice = second.frame_locator("#practice-frame").locator("text=Another robot")
        await practice.wait_for()
        assert "You are next" in (await second.text_content("#practice-words") or "")
        await asyncio.sleep(PRESSED)
        site.offer_turn(30.0)
        await second.wait_for_selector("#card[data-card=turn]")
        await second.wait_for_selector("#practice", state="hidden")
        await practice.wait_for(state="detached")


async def without_live_video(browser: Browser, site: FakeRobotPage, **device: str) -> Page:
    page = await (await browser.new_context(**device)).new_page()
    page.set_default_timeout(patient(20) * 1000)
    await page.add_init_script("delete window.RTCPeerConnection;")
    await page.goto(site.url)
    return page


async def test_browser_without_live_video_drives_with_single_pictures(browser, site):
    site.still = jpeg_of(120)
    page = await without_live_video(browser, site)
    await page.wait_for_selector("#card[data-card='closed.unsupported']")
    await page.click("#card-main")
    await page.wait_for_selector("#card[data-card=lobby]")
    await page.click("#card-main")
    await page.wait_for_selector("#drive-page[data-playing][data-slow]")
    await hold(page, "ArrowLeft", lambda: any(one.angular > 0.0 for _, one in site.applied))
    await page.keyboard.up("ArrowLeft")
    assert {transport for transport, _ in site.applied} == {"mqtt"}


async def test_browser_inside_an_app_names_another_browser_and_copies_the_link(browser, site):
    page = await without_live_video(browser, site, user_agent=INSTAGRAM)
    await page.wait_for_selector("#card[data-card='closed.in_app']")
    assert await page.text_content("#card-title") == "Open this page in Safari"
    await page.click("#card-main")
    await page.wait_for_selector("#card-main:text('Link copied')")


@pytest.mark.nightly
async def test_missing_video_connection_is_checked_after_some_seconds(browser, site):
    site.answers.clear()  # the robot's answer never comes
    page = await (await browser.new_context()).new_page()
    await page.goto(f"{site.url}?go=1")
    checks = lambda: [event for event in site.received("page/event") if event.type == "check"]
    checked = await until(checks, 20)
    assert checked[0].data["server"] == "quick"
    site.answers.set()
