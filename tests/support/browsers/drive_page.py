"""The drive page in a Chromium: to open it, to drive with it, and to see what it said and what the
robot did.
"""

import asyncio
import time
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from typing import Any

from playwright.async_api import Browser, Page

from robots.api.messages import Stop
from tests.support.browsers.fake_robot_page import FakeRobotPage
from tests.support.patience import HELD, patient

WIDE, UPRIGHT, LOW = (1280, 800), (390, 844), (844, 390)


@asynccontextmanager
async def opened(
    browser: Browser, site: FakeRobotPage, size: tuple[int, int] = WIDE, *, query: str = ""
) -> AsyncIterator[Page]:
    """Open the page; what it complains about, its content policy included, fails the test."""
    touch = size != WIDE
    context = await browser.new_context(
        viewport={"width": size[0], "height": size[1]}, has_touch=touch, is_mobile=touch
    )
    page = await context.new_page()
    complaints: list[str] = []
    page.on("pageerror", lambda error: complaints.append(str(error)))
    page.on(
        "console",
        lambda line: (
            complaints.append(line.text)
            if line.type == "error" and "WebSocket connection" not in line.text
            else None
        ),
    )
    await page.goto(site.url + query)
    yield page
    await context.close()
    assert complaints == []


async def driving(page: Page) -> None:
    await page.wait_for_selector("#drive-page[data-playing][data-link=live]", timeout=40_000)


async def until(condition: Callable[[], Any], seconds: float = 10.0) -> Any:
    """Wait for a condition and return what it gave."""
    deadline = time.monotonic() + patient(seconds)
    while not (found := condition()):
        assert time.monotonic() < deadline, "nothing of the kind happened"
        await asyncio.sleep(0.02)
    return found


async def hold(page: Page, key: str, condition: Callable[[], Any], seconds: float = 10.0) -> Any:
    """Hold a key until a condition gives something, and on; return that. A link that is replaced
    lets go of every key, and people press again.
    """
    deadline = time.monotonic() + patient(seconds)
    while True:
        await page.keyboard.down(key)
        again = time.monotonic() + HELD
        while time.monotonic() < again:
            if found := condition():
                return found
            await asyncio.sleep(0.02)
        assert time.monotonic() < deadline, f"nothing of the kind happened while {key} was held"
        await page.keyboard.up(key)


def stops(site: FakeRobotPage, way: str | None = None) -> list[Stop]:
    return [action for action in site.said("command/action", way) if isinstance(action, Stop)]


def stands(site: FakeRobotPage) -> bool:
    """Whether the page said so last, which the robot may be held up for too long to believe, and it
    is so.
    """
    last, motion = site.said("command/velocity")[-1], site.simulation.motion
    return last.linear == last.angular == motion.linear == motion.angular == 0.0


def moves(site: FakeRobotPage) -> int:
    """Return how many commands to move the page has said."""
    return sum(1 for command in site.said("command/velocity") if command.linear or command.angular)
