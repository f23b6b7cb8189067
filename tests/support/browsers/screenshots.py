"""The landing page, the account pages and the drive page in its states and sizes, as PNG files in
var/screenshots, to be looked at.

`make screenshots` also has the tests that visit every other page keep what they see
(tests/support/media/photographs.py).

The pictures that browsers show to whoever installs the page (static/img/screens) are taken again as
well; those of the README are tests/support/browsers/readme_pictures.py's.
"""

import shutil
import tempfile
from pathlib import Path

from PIL import Image
from playwright.sync_api import Browser, sync_playwright

from tests.support.browsers.visitor import Visitor, chromium
from tests.support.patience import PRESSED
from tests.support.sessions.site import ROOT, Site, running_site, wait_for

SIZES = {"desktop": (1280, 800), "phone": (390, 844)}
WITH_A_MOUSE = {
    "desktop": (1280, 800),
    "wide": (1440, 900),
    "small": (1024, 600),
    "low": (1280, 520),
}
WITH_FINGERS = {"phone": (390, 844), "tablet": (820, 1180), "landscape": (844, 390)}
PROFILES = ("standard", "novice", "expert", "technical")
INSTALLED = {"desktop": "wide", "phone": "narrow"}  # size of a picture to its form in the manifest
PAGES = {
    "home": "/",
    "log-in": "/accounts/login/",
    "sign-up": "/accounts/signup/",
    "about": "/about/",
    "missing": "/no/such/page/",
}


def choose(visitor: Visitor, profile: str) -> None:
    """Choose a profile of the page, as people do, and put the menu away."""
    visitor.page.set_viewport_size({"width": 1280, "height": 800})
    visitor.page.locator("#presence-volumes").click()
    visitor.page.locator(f"#profiles button[value={profile}]").click()
    visitor.screenshot(ROOT / "var" / "screenshots" / f"profiles-{profile}-desktop.png")
    visitor.page.locator("#presence-volumes").click()


def with_fingers(browser: Browser, site: Site, name: str, folder: Path, language: str = "") -> None:
    """The pages of a phone, and each profile of the drive page on what fingers steer."""
    width, height = SIZES["phone"]
    eva = Visitor(
        browser,
        site,
        name,
        viewport={"width": width, "height": height},
        has_touch=True,
        is_mobile=True,
        locale=language or "en",
    )
    end = f"-{language}.png" if language else ".png"
    eva.open(go=True)
    eva.wait_for("phase", "driving")
    eva.wait_for_picture()
    eva.wait_for("link", "live")
    for profile in PROFILES:
        eva.page.locator("#presence-volumes").click()
        eva.page.locator(f"#profiles button[value={profile}]").click()
        eva.screenshot(folder / f"profiles-{profile}-phone{end}")
        eva.page.locator("#presence-volumes").click()
        for size, (width, height) in WITH_FINGERS.items():
            eva.page.set_viewport_size({"width": width, "height": height})
            eva.page.wait_for_timeout(1200)
            eva.screenshot(
                folder / f"{'driving' if profile == 'standard' else profile}-{size}{end}"
            )
        eva.page.set_viewport_size({"width": SIZES["phone"][0], "height": SIZES["phone"][1]})
    eva.close()


def main() -> None:
    """Start a site with one robot, walk through its pages, and save what is seen."""
    folder = ROOT / "var" / "screenshots"
    folder.mkdir(parents=True, exist_ok=True)
    var = Path(tempfile.mkdtemp(prefix="telepresence-screenshots-"))
    try:
        with (
            running_site(var) as site,
            sync_playwright() as playwright,
            chromium(playwright) as browser,
        ):
            giraff = site.start_robot("giraff", "--start", "lounge-centre")
            for name, (width, height) in SIZES.items():
                stranger = Visitor(browser, site, viewport={"width": width, "height": height})
                for page, path in PAGES.items():
                    stranger.page.goto(path)
                    stranger.screenshot(folder / f"{page}-{name}.png")
                stranger.close()
            anna = Visitor(browser, site, "anna")
            anna.open()
            anna.page.wait_for_timeout(2000)
            anna.screenshot(folder / "lobby-desktop.png")
            anna.drive()
            anna.wait_for("link", "live")
            anna.page.keyboard.down("ArrowLeft")
            wait_for(lambda: abs(giraff.truth().theta - 1.57) > 0.5, 15, "a turn")
            anna.page.keyboard.up("ArrowLeft")
            anna.page.keyboard.down("ArrowDown")
            anna.page.wait_for_timeout(2500)
            anna.page.keyboard.up("ArrowDown")
            for profile in PROFILES:
                choose(anna, profile)
                for name, (width, height) in WITH_A_MOUSE.items():
                    anna.page.set_viewport_size({"width": width, "height": height})
                    anna.page.wait_for_timeout(1200)
                    anna.screenshot(
                        folder / f"{'driving' if profile == 'standard' else profile}-{name}.png"
                    )
            choose(anna, "standard")
            waiting = Visitor(browser, site, "dora", viewport={"width": 390, "height": 844}).open(
                go=True
            )
            waiting.wait_for("phase", "queued")
            waiting.page.wait_for_timeout(1000 * PRESSED)
            waiting.screenshot(folder / "queue-phone.png")
            anna.page.set_viewport_size({"width": 1280, "height": 800})
            anna.leave()
            anna.screenshot(folder / "left-desktop.png")
            waiting.wait_for("phase", "turn")
            waiting.screenshot(folder / "turn-phone.png")
            waiting.page.locator("#card-main").click()
            waiting.wait_for("phase", "driving")
            waiting.close()
            with_fingers(browser, site, "eva", folder)
            with_fingers(browser, site, "paz", folder, "es")
            for page, path in PAGES.items():
                stranger = Visitor(
                    browser, site, viewport={"width": 390, "height": 844}, locale="es"
                )
                stranger.page.goto(path)
                stranger.screenshot(folder / f"{page}-phone-es.png")
                stranger.close()
    finally:
        shutil.rmtree(var, ignore_errors=True)
    for size, form in INSTALLED.items():
        with Image.open(folder / f"driving-{size}.png") as picture:
            picture.convert("RGB").save(
                ROOT / "static" / "img" / "screens" / f"drive-{form}.webp", quality=80
            )


if __name__ == "__main__":
    main()
