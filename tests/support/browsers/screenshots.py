"""Takes pictures of the landing page, the account pages and the drive page in its states and sizes,
as PNG files in var/screenshots.

`make screenshots` also keeps pictures of the pages that tests visit
(tests/support/media/photographs.py). Those of README and documentation are made by
tests/support/browsers/pictures.py.
"""

import shutil
import tempfile
from pathlib import Path

from playwright.sync_api import Browser, sync_playwright

from tests.support.agents.truth import Onlooker
from tests.support.browsers.visitor import Visitor, chromium
from tests.support.patience import PRESSED
from tests.support.sessions.site import ROOT, Site, running_site, wait_for

FOLDER = ROOT / "var" / "screenshots"
SIZES = {"desktop": (1280, 800), "phone": (390, 844)}
WITH_A_MOUSE = {
    "desktop": (1280, 800),
    "wide": (1440, 900),
    "small": (1024, 600),
    "low": (1280, 520),
}
WITH_FINGERS = {"phone": (390, 844), "tablet": (820, 1180), "landscape": (844, 390)}
PROFILES = ("standard", "novice", "expert", "technical")
PAGES = {
    "home": "/",
    "log-in": "/accounts/login/",
    "sign-up": "/accounts/signup/",
    "about": "/about/",
    "missing": "/no/such/page/",
}


def picture(visitor: Visitor, name: str) -> None:
    visitor.screenshot(FOLDER / f"{name}.png")


def resize(visitor: Visitor, size: tuple[int, int]) -> None:
    visitor.page.set_viewport_size({"width": size[0], "height": size[1]})


def choose(visitor: Visitor, profile: str, name: str) -> None:
    """Choose a profile in the menu, and take a picture of the menu."""
    visitor.page.locator("#presence-volumes").click()
    visitor.page.locator(f"#profiles button[value={profile}]").click()
    picture(visitor, f"profiles-{profile}-{name}")
    visitor.page.locator("#presence-volumes").click()


def at_sizes(visitor: Visitor, profile: str, sizes: dict[str, tuple[int, int]], end: str) -> None:
    for name, size in sizes.items():
        resize(visitor, size)
        visitor.page.wait_for_timeout(1200)
        picture(visitor, f"{'driving' if profile == 'standard' else profile}-{name}{end}")


def pages(browser: Browser, site: Site, size: str, language: str = "en") -> None:
    width, height = SIZES[size]
    end = size if language == "en" else f"{size}-{language}"
    for page, path in PAGES.items():
        stranger = Visitor(
            browser, site, viewport={"width": width, "height": height}, locale=language
        )
        stranger.page.goto(path)
        picture(stranger, f"{page}-{end}")
        stranger.close()


def with_mouse(browser: Browser, site: Site, giraff: Onlooker) -> None:
    """Take pictures of the lobby, of every profile on large screens, and of the queue."""
    anna = Visitor(browser, site, "anna")
    anna.open()
    anna.page.wait_for_timeout(2000)
    picture(anna, "lobby-desktop")
    anna.drive()
    anna.wait_for("link", "live")
    anna.page.keyboard.down("ArrowLeft")
    wait_for(lambda: abs(giraff.truth().theta - 1.57) > 0.5, 15, "a turn")
    anna.page.keyboard.up("ArrowLeft")
    anna.page.keyboard.down("ArrowDown")
    anna.page.wait_for_timeout(2500)
    anna.page.keyboard.up("ArrowDown")
    for profile in (*PROFILES, "standard"):
        resize(anna, SIZES["desktop"])
        choose(anna, profile, "desktop")
        at_sizes(anna, profile, WITH_A_MOUSE, "")
    waiting = Visitor(browser, site, "dora", viewport={"width": 390, "height": 844}).open(go=True)
    waiting.wait_for("phase", "queued")
    waiting.page.wait_for_timeout(1000 * PRESSED)
    picture(waiting, "queue-phone")
    resize(anna, SIZES["desktop"])
    anna.leave()
    picture(anna, "left-desktop")
    waiting.wait_for("phase", "turn")
    picture(waiting, "turn-phone")
    waiting.page.locator("#card-main").click()
    waiting.wait_for("phase", "driving")
    waiting.close()


def with_fingers(browser: Browser, site: Site, name: str, language: str = "") -> None:
    """Take pictures of every profile of the drive page on touch screens."""
    width, height = SIZES["phone"]
    touch = {"has_touch": True, "is_mobile": True, "locale": language or "en"}
    eva = Visitor(browser, site, name, viewport={"width": width, "height": height}, **touch)
    end = f"-{language}" if language else ""
    eva.open(go=True)
    eva.wait_for("phase", "driving")
    eva.wait_for_picture()
    eva.wait_for("link", "live")
    for profile in PROFILES:
        choose(eva, profile, f"phone{end}")
        at_sizes(eva, profile, WITH_FINGERS, end)
        resize(eva, SIZES["phone"])
    eva.close()


def main() -> None:
    FOLDER.mkdir(parents=True, exist_ok=True)
    var = Path(tempfile.mkdtemp(prefix="telepresence-screenshots-"))
    try:
        with (
            running_site(var) as site,
            sync_playwright() as playwright,
            chromium(playwright) as browser,
        ):
            giraff = site.start_robot("giraff", "--start", "lounge-centre")
            for size in SIZES:
                pages(browser, site, size)
            with_mouse(browser, site, giraff)
            with_fingers(browser, site, "eva")
            with_fingers(browser, site, "paz", "es")
            pages(browser, site, "phone", "es")
    finally:
        shutil.rmtree(var, ignore_errors=True)


if __name__ == "__main__":
    main()
