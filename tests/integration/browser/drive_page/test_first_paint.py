"""The drive page is painted before its script runs, which then moves nothing, and can be driven
before all scripts are loaded.
"""

import asyncio
import re
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

import pytest
from playwright.async_api import Browser, Page, Route

from tests.support.browsers.drive_page import LOW, UPRIGHT, WIDE, driving, evaluated, hold, moves
from tests.support.browsers.fake_robot_page import FakeRobotPage
from tests.support.patience import patient

pytestmark = [pytest.mark.browser, pytest.mark.asyncio(loop_scope="module")]
MODULES = re.compile(r"/static/js/(?!drive/load_retry)")
LATER = re.compile(r"/static/js/(view/(map|overlay|display)|autonomy|study|presence)/feature\.")
# A server that has not answered yet: the page stays at its first card. The page's clock is stopped,
# as the card would change after six seconds.
NO_ANSWER = """window.WebSocket = class extends EventTarget { readyState = 0; close() {} };
const began = performance.now();
performance.now = () => began;"""
WATCH = """window.moved = [];
window.watcher = new PerformanceObserver((list) => {
  for (const { sources } of list.getEntries()) {
    moved.push(...sources.map(({ node }) => node?.id || node?.className || node?.nodeName));
  }
});
watcher.observe({ type: "layout-shift", buffered: true });"""
BOXES = """() => [...document.querySelectorAll("#drive-page, #drive-page *")]
  .filter((one) => one.checkVisibility())
  .map((one) => [one.id || one.getAttribute("class") || one.nodeName, one.getBoundingClientRect()])
  .map(([name, { x, y, width, height }]) => [name, ...[x, y, width, height].map(Math.round)])"""
SETTLED = f"""() => new Promise((done) => requestAnimationFrame(() => setTimeout(() => {{
  watcher.takeRecords();
  moved.length = 0;
  done(({BOXES})());
}})))"""
PAINTED = "performance.getEntriesByName('first-contentful-paint').length > 0"
COMPLETE = "performance.getEntriesByName('drive:complete').length > 0"


class Held:
    """Requests that wait until they are released."""

    def __init__(self) -> None:
        self.released = asyncio.Event()

    async def __call__(self, route: Route) -> None:
        await self.released.wait()
        await route.continue_()


@asynccontextmanager
async def without(
    modules: re.Pattern[str],
    browser: Browser,
    site: FakeRobotPage,
    size: tuple[int, int] = WIDE,
    script: str = "",
) -> AsyncIterator[tuple[Page, Held]]:
    """Open the page while some of its modules are held back."""
    touch = size != WIDE
    context = await browser.new_context(
        viewport={"width": size[0], "height": size[1]},
        has_touch=touch,
        is_mobile=touch,
        reduced_motion="reduce",  # a rotating element has another box each time
    )
    page = await context.new_page()
    page.set_default_timeout(patient(20) * 1000)
    await page.add_init_script(WATCH + script)
    held = Held()
    await page.route(modules, held)
    await page.goto(site.url + "?go=1", wait_until="commit")
    try:
        yield page, held
    finally:
        held.released.set()
        await context.close()


@pytest.mark.nightly
@pytest.mark.parametrize("size", [WIDE, UPRIGHT, LOW])
async def test_page_is_painted_before_its_script_which_then_moves_nothing(browser, site, size):
    async with without(MODULES, browser, site, size, NO_ANSWER) as (page, held):
        await evaluated(page, PAINTED)
        assert await page.inner_text("#card-title") == "Connecting…"
        assert await page.is_visible("#card .card__spinner")
        assert await page.is_visible("#status")
        await evaluated(page, "document.readyState !== 'loading'")
        drawn = await page.evaluate(SETTLED)
        held.released.set()
        await evaluated(page, COMPLETE)
        assert await page.evaluate(BOXES) == drawn
        assert await page.evaluate("moved") == []


async def test_robot_is_driven_while_the_rest_of_the_page_loads(browser, site):
    async with without(LATER, browser, site) as (page, held):
        await driving(page)
        await hold(page, "ArrowLeft", lambda: moves(site))
        await page.keyboard.up("ArrowLeft")
        assert await page.text_content("#map-state") == ""
        assert not await page.evaluate(COMPLETE)
        held.released.set()
        await evaluated(page, "document.getElementById('map-state').textContent !== ''")
        await evaluated(page, COMPLETE)


async def test_page_without_javascript_says_that_it_needs_it(chromium, site):
    context = await chromium.new_context(java_script_enabled=False)
    page = await context.new_page()
    await page.goto(site.url)
    assert await page.locator("noscript h2").inner_text() == "This page needs JavaScript"
    assert await page.is_visible("noscript h2")
    assert await page.is_hidden("#card")
