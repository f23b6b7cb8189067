"""Profiles of the drive page, the connection in figures, and the whole screen, in Chromium."""

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any

import pytest
import pytest_asyncio
from playwright.async_api import Page

from sessions import protocol
from tests.support.browsers.drive_page import driving, evaluated, hold, moves, stands, stops
from tests.support.browsers.fake_robot_page import FakeRobotPage
from tests.support.patience import until

pytestmark = [pytest.mark.browser, pytest.mark.asyncio(loop_scope="module"), pytest.mark.nightly]
KNOWN = (
    *("fps", "glass", "trip_direct", "trip_server", "age", "refused", "loss", "jitter"),
    *("rate", "freezes", "size", "path"),
)
FIGURES = """() => Object.fromEntries(
  [...document.querySelectorAll(".figure")].map(
    (cell) => [cell.dataset.figure, cell.querySelector("span").textContent]))"""
WAY = """() => {
  const panel = document.querySelector("#technical").getBoundingClientRect();
  const picture = document.querySelector("#viewport").getBoundingClientRect();
  const covers = panel.right > picture.left && panel.left < picture.right
    && panel.bottom > picture.top && panel.top < picture.bottom;
  return covers ? (panel.bottom - picture.top) / picture.height : 0;
}"""


@pytest_asyncio.fixture(loop_scope="module")
async def page(browser) -> Page:
    context = await browser.new_context(
        viewport={"width": 1280, "height": 800}, permissions=["clipboard-read", "clipboard-write"]
    )
    return await context.new_page()


def recorded(site: FakeRobotPage, kind: str, field: str) -> list[Any]:
    return [event.data[field] for event in site.received("page/event") if event.type == kind]


def shown(site: FakeRobotPage) -> list[str]:
    """Return the recorded profiles in order."""
    return recorded(site, "layout", "interface")


@asynccontextmanager
async def visit(page: Page, site: FakeRobotPage) -> AsyncIterator[None]:
    await page.goto(f"{site.url}?go=1")
    await driving(page)
    yield
    site.end("completed")


async def choose_key(page: Page, command: str, key: str) -> str:
    """Press the button of a command and a key, and return the note about it."""
    await page.click(f"#own-keys [data-command={command}]")
    await page.keyboard.press(key)
    return await page.text_content("#own-keys-note") or ""


async def choose(page: Page, name: str) -> None:
    await page.click("#presence-volumes")
    await page.click(f"#profiles button[value={name}]")
    await page.click("#presence-volumes")


async def test_chosen_profile_is_kept_and_a_study_overrides_it(page, site):
    async with visit(page, site):
        await until(lambda: shown(site) == ["standard"])
        assert await page.is_visible("#hints")
        await choose(page, "expert")
        await until(lambda: shown(site) == ["standard", "expert"])
        assert not await page.is_visible("#hints")
        assert await page.get_attribute("[data-action=speed-2]", "aria-pressed") == "true"
        await choose(page, "technical")
        await page.keyboard.down("ArrowUp")
        figures = await _figures(page, *KNOWN)
        await page.keyboard.up("ArrowUp")
        await page.click("#figures-copy")
        copied = await _copied(page)
        assert await page.evaluate(WAY) == 0
        await page.set_viewport_size({"width": 844, "height": 390})
        assert 0 < await page.evaluate(WAY) < 0.3
    assert figures["size"].endswith("VP8")
    assert figures["path"].startswith("direct")
    assert "Command age: " in copied
    await page.set_viewport_size({"width": 1280, "height": 800})
    await page.goto(site.url)
    await page.wait_for_selector("#drive-page[data-profile=technical]")
    await _in_a_study(page, site)


async def _in_a_study(page: Page, site: FakeRobotPage) -> None:
    site.terms = protocol.GrantedTerms(interface="expert")
    before = len(shown(site))
    await page.click("#card-main")
    await driving(page)
    await until(lambda: "expert" in shown(site)[before:])
    await page.click("#presence-volumes")
    assert await page.locator("#profiles button:disabled").count() == 4
    assert await page.inner_text("#profile-text") == "Set by the study."
    await page.click("#full-screen")
    await evaluated(page, "() => document.fullscreenElement !== null")
    await page.click("#presence-volumes")
    known = len(site.applied)
    await hold(page, "ArrowUp", lambda: len(site.applied) > known + 3)
    halts = len(stops(site))
    # as the browser does on Escape, a key that pages never receive: the driver stops
    await page.evaluate("document.exitFullscreen()")
    await until(lambda: len(stops(site)) > halts)
    await until(lambda: recorded(site, "full_screen", "on") == [True, False])


async def test_own_keys_drive_at_once_and_after_a_reload_and_old_ones_do_not(page, site):
    async with visit(page, site):
        await page.click("#presence-volumes")
        await page.click("#own-keys-open")
        moved = moves(site)
        assert "stops the robot" in await choose_key(page, "talk", "Space")
        assert "browser" in await choose_key(page, "backward", "F2")
        assert "saved in this browser" in await choose_key(page, "forward", "i")
        assert await page.text_content("#own-keys [data-command=forward]") == "I"
        await page.click("#own-keys [data-command=left]")
        await page.keyboard.press("Escape")  # keeps the key, and the panel open
        assert await page.text_content("#own-keys [data-command=left]") == "←A"
        assert moves(site) == moved
        await page.keyboard.press("Escape")
        assert await page.text_content("#hints kbd >> nth=0") == "I"
        await hold(page, "i", lambda: moves(site) > moved)
        await page.keyboard.up("i")
        await until(lambda: stands(site))
    async with visit(page, site):
        moved = moves(site)
        await page.keyboard.press("w", delay=300)
        assert moves(site) == moved
        await hold(page, "i", lambda: moves(site) > moved)
        await page.keyboard.up("i")
        await page.click("#presence-volumes")
        await page.click("#own-keys-open")
        await page.click("#own-keys-usual")
        assert await page.text_content("#own-keys [data-command=forward]") == "↑W"


async def _figures(page: Page, *needed: str) -> dict[str, str]:
    """Return the figures once the needed ones are known."""
    is_known = "(name) => !['–', undefined].includes(figures[name])"
    await evaluated(
        page, f"() => {{ const figures = ({FIGURES})(); return {list(needed)}.every({is_known}); }}"
    )
    return await page.evaluate(FIGURES)


async def _copied(page: Page) -> str:
    await evaluated(
        page, "() => document.querySelector('#figures-copy-text').textContent !== 'Copy'"
    )
    return await page.evaluate("navigator.clipboard.readText()")
