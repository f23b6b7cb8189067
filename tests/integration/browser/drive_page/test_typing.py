"""Typing never drives: an open part of the drive page has all keys, from the next one on, and none
reaches the robot.
"""

import time
from collections.abc import AsyncIterator
from dataclasses import dataclass

import pytest
import pytest_asyncio
from playwright.async_api import Page, expect

from robots.api.messages import Say, Words
from tests.support.browsers.drive_page import actions, driving, hold, moves, stands, stops
from tests.support.browsers.present_robot_page import CAPABILITIES, PresentRobotPage
from tests.support.patience import patient, until

pytestmark = [pytest.mark.browser, pytest.mark.asyncio(loop_scope="module")]
TEXT = "Hello, is anybody there?"
# Every key that drives, tilts, talks or changes the speed.
ARROWS = ("ArrowUp", "ArrowDown", "ArrowLeft", "ArrowRight")
WORKING = [*"wasdrft=-/]", *ARROWS]
FAKE = ["--use-fake-device-for-media-stream", "--use-fake-ui-for-media-stream"]
COUNTED = """globalThis.asked = 0;
const devices = navigator.mediaDevices, get = devices.getUserMedia.bind(devices);
devices.getUserMedia = (...wanted) => { asked += 1; return get(...wanted); };"""
# Parts that take the keys, and what opens them. A new part of the page belongs here or in BESIDE.
OPENED = {
    "talk": "#presence-talk",
    "volumes": "#presence-volumes",
    "help": "#help-open",
    "places": "#places-toggle",
    "card": "#leave",
}
# Parts beside which one drives on; they never take the focus.
BESIDE = {
    *("viewport", "audience", "audience-panel", "offer", "photo", "kept", "aim", "task"),
    *("task-more", "map", "map-panel", "map-tools", "technical", "practice", "load-failed"),
    *("speed", "assist", "profiles", "own-keys", "stick", "presence", "presence-note", "tilt"),
    *("shared", "announcer", "point-note"),
}
# All parts that can be hidden and have something to press or to fill in, or a role.
PARTS = """() => [...document.querySelectorAll("body [id]")].filter((one) =>
  one.matches("dialog, details, form, [popover], [aria-modal], [data-holds-keys]")
  || one.matches("[role=dialog], [role=alertdialog], [role=menu], [role=listbox]")
  || (one.matches("section, main, aside, nav, [role=group], [hidden], [aria-label]")
    && one.querySelector("button, input, select, textarea, a"))
  || document.querySelector(`[aria-controls~="${one.id}"]`)).map(({ id }) => id)"""
FIELDS = (
    "() => [...document.querySelectorAll('input, textarea, select, [contenteditable]')].map((one)"
    " => [one.id, one.closest('section, .tilt')?.id ?? ''])"
)


@dataclass(frozen=True)
class Seen:
    """What keys must not change, of the robot and of the page."""

    tilt: float
    actions: int
    microphones: int
    speed: str


@pytest.fixture
def site():
    with PresentRobotPage(capabilities=(*CAPABILITIES, "goto", "dock")) as fake:
        yield fake


@pytest.fixture(scope="module")
def flags() -> list[str]:
    return FAKE


@pytest_asyncio.fixture(loop_scope="module")
async def page(browser, site) -> AsyncIterator[Page]:
    context = await browser.new_context(
        viewport={"width": 1280, "height": 800}, permissions=["microphone"]
    )
    page = await context.new_page()
    complaints: list[str] = []
    page.on("pageerror", lambda error: complaints.append(str(error)))
    await page.add_init_script(COUNTED)
    await page.goto(f"{site.url}?go=1")
    await driving(page)
    await page.wait_for_selector("#presence-talk", timeout=patient(10) * 1000)
    yield page
    await context.close()
    assert complaints == []


def ids(actions) -> set[str]:
    """Return the ids of actions, which are sent repeatedly until they are echoed."""
    return {action.action_id for action in actions}


def written(site: PresentRobotPage) -> set[str]:
    return ids(one for one in actions(site, Say) if one.text == TEXT)


async def seen(page: Page, site: PresentRobotPage) -> Seen:
    """Return it after five heartbeats, when the page has sent all earlier messages."""
    before = len(site.received("command/heartbeat"))
    await until(lambda: len(site.received("command/heartbeat")) >= before + 5)
    actions = sum(
        1 for one in site.received("command/action") if type(one).__name__ not in {"Stop", "Say"}
    )
    pressed = await page.locator("#speed [aria-pressed=true]").get_attribute("data-action")
    return Seen(site.tilt, actions, await page.evaluate("asked"), pressed or "")


async def drives(page: Page, site: PresentRobotPage) -> None:
    """The keys drive, and stop when they are released."""
    before = moves(site)
    await hold(page, "a", lambda: moves(site) > before)
    await page.keyboard.up("a")
    await until(lambda: stands(site))


async def test_every_part_and_field_of_the_page_is_known_here(page, site):
    parts = set(await page.evaluate(PARTS))
    assert parts - BESIDE - {"talk-form", "talk-writing", "ask-form"} == set(OPENED)
    for field, within in await page.evaluate(FIELDS):
        # only observers have a field in the audience panel
        assert within in {*OPENED, "tilt", "audience-panel"}, f"{field} in {within}"
    assert await page.evaluate("document.querySelectorAll('iframe').length") == 1, (
        "the practice robot's, where this robot is not driven"
    )


async def test_text_typed_right_after_write_is_in_the_field_and_never_drives(page, site):
    for count, key in enumerate(("", "Enter", "Space", ""), 1):
        await drives(page, site)
        before, stopped, moved = await seen(page, site), ids(stops(site)), moves(site)
        await (page.press("#presence-talk", key) if key else page.click("#presence-talk"))
        await page.keyboard.type(TEXT)
        assert await page.input_value("#talk-field") == TEXT
        assert await seen(page, site) == before
        assert moves(site) == moved
        new = ids(stops(site)) - stopped
        assert len(new) <= 1, "the space bar that presses a button stops, once"
        await page.keyboard.press("Enter")
        await until(lambda count=count: len(written(site)) == count)
        await expect(page.locator("#talk-writing")).to_be_hidden()
    await expect(page.locator("#talk-list .line")).to_have_count(4)


@pytest.mark.parametrize("name", sorted(OPENED))
async def test_open_part_has_the_keys_until_escape_closes_it(page, site, name):
    for _ in range(2):
        await drives(page, site)
        before, moved = await seen(page, site), moves(site)
        await page.click(OPENED[name])
        await page.keyboard.type(TEXT)
        for key in WORKING:
            await page.keyboard.press(key)
        await expect(page.locator(f"#{name}")).to_be_visible()
        assert await seen(page, site) == before
        assert moves(site) == moved
        await page.keyboard.press("Escape")
        await expect(page.locator(f"#{name}")).to_be_hidden()
        assert await page.evaluate("document.activeElement.id") == "viewport"
    await drives(page, site)


@pytest.mark.parametrize("name", sorted(OPENED))
async def test_key_held_when_a_part_opens_drives_only_after_a_new_press(page, site, name):
    await hold(page, "a", lambda: moves(site) > 3)
    await page.click(OPENED[name])
    await until(lambda: stands(site))
    moved = moves(site)
    await page.keyboard.down("a")  # the keyboard's own repetition
    await page.keyboard.press("Escape")
    await page.keyboard.down("a")
    await seen(page, site)
    assert moves(site) == moved
    await page.keyboard.up("a")
    await drives(page, site)


@pytest.mark.parametrize("name", ["talk", "volumes", "places"])
async def test_press_beside_a_menu_closes_it_and_the_keys_drive(page, site, name):
    await page.click(OPENED[name])
    await page.locator("#status").click()
    hidden = "talk-writing" if name == "talk" else name
    await expect(page.locator(f"#{hidden}")).to_be_hidden()
    await drives(page, site)


async def test_space_bar_and_stop_button_stop_while_a_menu_is_open(page, site):
    for name in ("volumes", "places", "card"):
        await page.click(OPENED[name])
        stopped = len(stops(site))
        await page.keyboard.press("Space")
        await until(lambda stopped=stopped: len(stops(site)) > stopped)
        stopped = len(stops(site))
        await page.click("#stop")  # it is covered by nothing
        await until(lambda stopped=stopped: len(stops(site)) > stopped)
        await page.keyboard.press("Escape")


async def test_writing_goes_on_when_the_link_to_the_robot_breaks(page, site):
    before, moved = await seen(page, site), moves(site)
    await page.click("#presence-talk")
    await page.keyboard.type(TEXT[:8])
    site.muted = True
    await page.wait_for_selector(
        "#drive-page[data-frozen]:not([data-playing])", timeout=patient(20) * 1000
    )
    await page.keyboard.type(TEXT[8:])
    assert await page.input_value("#talk-field") == TEXT
    site.muted = False
    await driving(page)
    await page.keyboard.type("!")
    assert await page.input_value("#talk-field") == f"{TEXT}!"
    assert await seen(page, site) == before
    assert moves(site) == moved


async def test_new_message_neither_takes_the_keys_nor_closes_a_menu(page, site):
    def comes(text: str) -> None:
        words = {"action_id": "say-1", "session": site.session, "by": "screen", "text": text}
        site.tell("words", Words(stamp=time.time(), **words))

    await page.click("#presence-volumes")
    comes("Good morning")
    await page.wait_for_selector("#unread:not([hidden])")
    await expect(page.locator("#volumes")).to_be_visible()
    await page.keyboard.press("Escape")
    comes("Are you there?")
    await page.wait_for_selector("#talk-list >> text=Are you there?")
    await drives(page, site)
