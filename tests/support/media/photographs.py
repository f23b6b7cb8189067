"""Pictures of pages on which a test has just looked, for people to look at: kept where SCREENSHOTS
names a folder, and only then.
"""

import os
from pathlib import Path

from playwright.async_api import Page as AsyncPage
from playwright.sync_api import Page

FOLDER = os.environ.get("SCREENSHOTS", "")
# that tests which know a page by more than its words ask for
LANGUAGE = os.environ.get("SCREENSHOTS_LANGUAGE", "en")
SIZES = {"desktop": (1280, 800), "phone": (390, 844)}
SETTLED = 400  # ms in which a page that has changed its size comes to rest


def keep(page: Page, name: str, *, whole: bool = False) -> None:
    """Keep a page as it is, under a name; `whole` down to its end."""
    if FOLDER:
        page.screenshot(path=Path(FOLDER) / f"{name}.png", full_page=whole)


def keep_at_all_sizes(page: Page, name: str) -> None:
    """Keep a page at the size of a phone and at that of a desktop, which stays."""
    if FOLDER:
        for kind in ("phone", "desktop"):
            width, height = SIZES[kind]
            page.set_viewport_size({"width": width, "height": height})
            page.wait_for_timeout(SETTLED)
            keep(page, f"{name}-{kind}")


async def kept(page: AsyncPage, name: str) -> None:
    """Keep a page of Playwright's asynchronous interface as it is."""
    if FOLDER:
        await page.screenshot(path=Path(FOLDER) / f"{name}.png")
