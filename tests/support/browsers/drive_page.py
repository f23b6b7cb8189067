"""The drive page in a Chromium: opened and driven with, and what it sent."""

import asyncio
import time
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from typing import Any

from playwright.async_api import Browser, Page

from robots.api.messages import Action, Stop
from tests.support.browsers.fake_robot_page import FakeRobotPage
from tests.support.patience import HELD, patient

WIDE, UPRIGHT, LOW = (1280, 800), (390, 844), (844, 390)
# plugs in a gamepad, whose `stub` a test moves
PAD = """() => {
  const buttons = Array.from({ length: 17 }, () => ({ pressed: false }));
  const pad = { index: 0, id: "stub", mapping: "standard", axes: [0, 0, 0, 0], buttons };
  window.stub = pad;
  navigator.getGamepads = () => [pad];
  window.dispatchEvent(Object.assign(new Event("gamepadconnected"), { gamepad: pad }));
}"""


@asynccontextmanager
async def opened(
    browser: Browser, site: FakeRobotPage, size: tuple[int, int] = WIDE, *, query: str = ""
) -> AsyncIterator[Page]:
    """Open the page; its errors, those of its content policy included, fail the test."""
    touch = size != WIDE
    context = await browser.new_context(
        viewport={"width": size[0], "height": size[1]}, has_touch=touch, is_mobile=touch
    )
    page = await context.new_page()
    complaints: list[str] = []
    note_errors(page, complaints, but="WebSocket connection")
    await page.goto(site.url + query)
    yield page
    await context.close()
    assert complaints == []


@asynccontextmanager
async def driven(
    browser: Browser, site: FakeRobotPage, size: tuple[int, int] = WIDE
) -> AsyncIterator[Page]:
    """Open the page, take the robot, and wait until it can be driven."""
    async with opened(browser, site, size, query="?go=1") as page:
        await driving(page)
        yield page


def note_errors(page: Page, complaints: list[str], but: str = "nothing") -> None:
    """Note all errors of a page's scripts and on its console, but those that mention `but`."""
    page.on("pageerror", lambda error: complaints.append(str(error)))
    is_one = lambda line: line.type == "error" and but not in line.text
    page.on("console", lambda line: complaints.append(line.text) if is_one(line) else None)


async def driving(page: Page) -> None:
    await page.wait_for_selector("#drive-page[data-playing][data-link=live]", timeout=60_000)


async def evaluated(
    page: Page, script: str, is_right: Callable[[Any], Any] = bool, seconds: float = 20.0
) -> Any:
    """Return the value of a script once it is right; the page's policy refuses Playwright's own
    method.
    """
    deadline = time.monotonic() + patient(seconds)
    while (found := await page.evaluate(script)) is None or not is_right(found):
        assert time.monotonic() < deadline, f"never right: {script}; the last was {found}"
        await asyncio.sleep(0.05)
    return found


async def hold(page: Page, key: str, condition: Callable[[], Any], seconds: float = 15.0) -> Any:
    """Hold a key until a condition is true, keep it down, and return the condition's value. Pressed
    again after `HELD`, as a page releases all keys when its link is replaced.
    """
    deadline = time.monotonic() + patient(seconds)
    while True:
        await page.keyboard.down(key)
        again = time.monotonic() + HELD
        while time.monotonic() < again:
            if found := condition():
                return found
            await asyncio.sleep(0.02)
        assert time.monotonic() < deadline, f"the condition did not come true while {key} was held"
        await page.keyboard.up(key)


def actions(site: FakeRobotPage, kind: type[Action], transport: str | None = None) -> list[Any]:
    """Return the actions of a kind that pages have sent."""
    return [one for one in site.received("command/action", transport) if isinstance(one, kind)]


def stops(site: FakeRobotPage, transport: str | None = None) -> list[Stop]:
    return actions(site, Stop, transport)


def stands(site: FakeRobotPage) -> bool:
    """Tell whether the page's last velocity is zero, and the robot is at rest: one that missed
    velocities may be so earlier.
    """
    last, motion = site.received("command/velocity")[-1], site.simulation.motion
    return last.linear == last.angular == motion.linear == motion.angular == 0.0


def moves(site: FakeRobotPage) -> int:
    """Return how many velocities other than zero the pages have sent."""
    return sum(1 for one in site.received("command/velocity") if one.linear or one.angular)
