"""One Chromium for all tests of a module; each has contexts of its own."""

from collections.abc import AsyncIterator, Iterator

import pytest
import pytest_asyncio
from playwright.async_api import Browser, Page, async_playwright

from tests.support.browsers.chromium import CHROMIUM, FLAGS
from tests.support.browsers.drive_page import driven
from tests.support.browsers.fake_robot_page import FakeRobotPage


@pytest.fixture
def site() -> Iterator[FakeRobotPage]:
    with FakeRobotPage() as fake:
        yield fake


@pytest.fixture(scope="module")
def flags() -> list[str]:
    """What a module's Chromium is started with beside the usual."""
    return []


@pytest_asyncio.fixture(scope="module", loop_scope="module")
async def chromium(flags) -> AsyncIterator[Browser]:
    async with async_playwright() as playwright:
        browser = await playwright.chromium.launch(executable_path=CHROMIUM, args=[*FLAGS, *flags])
        yield browser
        await browser.close()


@pytest_asyncio.fixture(loop_scope="module")
async def browser(chromium) -> AsyncIterator[Browser]:
    yield chromium
    for context in chromium.contexts:
        await context.close()


@pytest_asyncio.fixture(loop_scope="module")
async def page(browser, site) -> AsyncIterator[Page]:
    """The page of a visitor who drives."""
    async with driven(browser, site) as page:
        yield page
