"""The sizes of screens at which tests look at pages."""

from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import Page

from tests.support.media.photographs import keep

SIZES = {
    "desktop": (1366, 768),
    "tablet": (820, 1180),
    "phone": (390, 844),
    "landscape": (844, 390),
}


def check_at_all_sizes(page: Page, name: str, *, axe_at_each: bool = False) -> None:
    """No page is wider than its screen, and axe-core finds nothing; keep pictures of all sizes."""
    before = page.viewport_size
    for size, (width, height) in SIZES.items():
        page.set_viewport_size({"width": width, "height": height})
        keep(page, f"{name}-{size}", whole=True)
        wide = page.evaluate("document.documentElement.scrollWidth - innerWidth")
        assert wide <= 0, f"{name} scrolls sideways on a {size}"
        if axe_at_each:
            check_with_axe(page, f"{name} on a {size}")
    page.set_viewport_size(before)
    check_with_axe(page, name)


def check_with_axe(page: Page, name: str) -> None:
    found = Axe().run(page).response["violations"]
    assert not found, f"{name}: {found[0]['id']} {found[0]['nodes'][0]['html']}"
