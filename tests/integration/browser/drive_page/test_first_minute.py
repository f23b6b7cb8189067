"""The first minute, and the last: waiting, being called, being asked for a sign, and browsers
without live video.
"""

import asyncio
import time
from collections.abc import Callable

import pytest
from playwright.async_api import Browser, Page

from sessions import protocol
from tests.support.browsers.drive_page import driving, hold, opened, until
from tests.support.browsers.drive_page_scenes import FREE
from tests.support.browsers.fake_robot_page import PRACTICE, FakeRobotPage
from tests.support.media.picture_server import jpeg_of
from tests.support.patience import PRESSED, patient

pytestmark = [pytest.mark.browser, pytest.mark.asyncio(loop_scope="module")]
INSTAGRAM = (
    "Mozilla/5.0 (iPhone; CPU iPhone OS 15_0 like Mac OS X) AppleWebKit/605.1.15 (KHTML, like"
    " Gecko) Mobile/15E148 Instagram 334.0"
)


async def said_until_shown(page: Page, card: str, say: Callable[[], None]) -> None:
    """Say something until the page shows it: what is said while a page under load dials its
    WebSocket again is lost here, and not in earnest.
    """
    deadline = time.monotonic() + patient(20)
    while await page.locator(f"#card[data-card='{card}']:visible").count() == 0:
        assert time.monotonic() < deadline, f"the card {card} never came"
        say()
        await asyncio.sleep(0.5)


def signs(site: FakeRobotPage) -> list[protocol.PageEvent]:
    return [event for event in site.said("page/event") if event.type == protocol.HERE]


@pytest.mark.nightly
async def test_who_waits_for_a_robot_that_did_not_get_home_drives_one_that_is_free(browser, site):
    site.others = [{**FREE, "name": "rhodon", "action": "Drive Rhodon"}]
    async with opened(browser, site, query="?go=1") as first, opened(browser, site) as second:
        await driving(first)
        await second.click("text=Wait for my turn")
        await said_until_shown(
            second, "queued.paused", lambda: site.keep_waiting("paused: could not dock")
        )
        await second.click("#card-instead > a:has-text('Drive Rhodon')")
        await second.wait_for_url(f"**{PRACTICE}")
        assert site.said("session/leave")
    site.others = []


async def test_who_is_asked_for_a_sign_gives_it_by_the_button_or_any_touch_and_is_asked_no_more(
    browser, site
):
    async with opened(browser, site, query="?go=1") as page:
        await driving(page)
        for give in (lambda: page.click("#card-main"), lambda: page.mouse.wheel(0, 1)):
            known = len(signs(site))
            await said_until_shown(
                page,
                "idle",
                lambda: site.tell(
                    "session/asked_there", protocol.AskedThere(session=site.session, seconds=30.0)
                ),
            )
            assert await page.title() == "Are you still there? · Giraff · Telepresence"
            await give()
            await page.wait_for_selector("#card", state="hidden")
            assert await page.evaluate("document.activeElement.id") == "viewport"
            # given again, for the server has not said that it has it
            await until(lambda known=known: len(signs(site)) >= known + 2)
            site.tell("session/found_there", protocol.FoundThere(session=site.session))
        assert "still there" not in await page.title()


async def test_who_gave_no_sign_reads_why_the_visit_is_over(browser, site):
    async with opened(browser, site, query="?go=1") as page:
        await driving(page)
        await said_until_shown(
            page,
            "idle",
            lambda: site.tell(
                "session/asked_there", protocol.AskedThere(session=site.session, seconds=30.0)
            ),
        )
        over = protocol.Ended(session=site.session, outcome="timed_out", reason="idle")
        await said_until_shown(page, "ended.idle", lambda: site.tell("session/ended", over))


@pytest.mark.nightly
async def test_a_turn_calls_by_the_title_counts_down_and_passes_when_it_is_not_taken(browser, site):
    async with (
        opened(browser, site, query="?go=1") as first,
        opened(browser, site, query="?go=1") as second,
    ):
        first.set_default_timeout(patient(20) * 1000)
        second.set_default_timeout(patient(20) * 1000)
        await driving(first)
        await second.wait_for_selector("#card[data-card='queued.next']")
        await asyncio.sleep(PRESSED)
        site.offer_turn(8.0)
        await second.wait_for_selector("#card[data-card=turn]")
        assert await second.title() == "It is your turn · Giraff · Telepresence"
        await second.wait_for_selector("#card[data-card='ended.turn_missed']")


@pytest.mark.nightly
async def test_who_waits_practises_until_the_turn_comes_and_then_has_the_real_robot_before_them(
    browser, site
):
    site.practice = {"url": None}  # being made ready
    async with (
        opened(browser, site, query="?go=1") as first,
        opened(browser, site, query="?go=1") as second,
    ):
        for page in (first, second):
            page.set_default_timeout(patient(20) * 1000)
        await driving(first)
        await second.wait_for_selector("#card[data-card='queued.next']")
        await second.click("#card-main")
        await second.wait_for_selector("#card[data-card='queued.next'][data-busy]")
        site.practice = {"url": PRACTICE}
        await second.wait_for_selector("#practice:not([hidden])")
        await second.frame_locator("#practice-frame").locator("text=Another robot").wait_for()
        assert "You are next" in (await second.text_content("#practice-words") or "")
        await asyncio.sleep(PRESSED)
        site.offer_turn(30.0)
        await second.wait_for_selector("#card[data-card=turn]")
        await second.wait_for_selector("#practice", state="hidden")
        await (
            second.frame_locator("#practice-frame")
            .locator("text=Another robot")
            .wait_for(state="detached")
        )


async def without_live_video(browser: Browser, site: FakeRobotPage, **device: str) -> Page:
    page = await (await browser.new_context(**device)).new_page()
    page.set_default_timeout(patient(20) * 1000)
    await page.add_init_script("delete window.RTCPeerConnection;")
    await page.goto(site.url)
    return page


async def test_a_browser_without_live_video_drives_with_a_slow_picture(browser, site):
    site.still = jpeg_of(120)
    page = await without_live_video(browser, site)
    await page.wait_for_selector("#card[data-card='closed.unsupported']")
    await page.click("#card-main")
    await page.wait_for_selector("#card[data-card=lobby]")
    await page.click("#card-main")
    await page.wait_for_selector("#drive-page[data-playing][data-slow]")
    await hold(
        page,
        "ArrowLeft",
        lambda: [way for way, command in site.applied if command.angular > 0.0] != [],
    )
    await page.keyboard.up("ArrowLeft")
    assert {way for way, _ in site.applied} == {"mqtt"}


async def test_a_browser_inside_an_app_says_which_browser_to_take_and_gives_the_link(browser, site):
    page = await without_live_video(browser, site, user_agent=INSTAGRAM)
    await page.wait_for_selector("#card[data-card='closed.in_app']")
    assert await page.text_content("#card-title") == "Open this page in Safari"
    await page.click("#card-main")
    await page.wait_for_selector("#card-main:text('Copied: paste it there')")


@pytest.mark.nightly
async def test_a_connection_that_does_not_come_about_is_explained_after_some_seconds(browser, site):
    site.answers.clear()  # the robot's answer never comes
    page = await (await browser.new_context()).new_page()
    await page.goto(f"{site.url}?go=1")
    checked = await until(
        lambda: [event for event in site.said("page/event") if event.type == "check"], 20
    )
    assert checked[0].data["server"] == "quick"
    site.answers.set()
