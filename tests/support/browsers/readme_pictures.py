"""`python -m tests.support.browsers.readme_pictures` takes the three pictures of the README on a
whole site and writes them into docs/img: the drive page with a mouse and on a phone, and the
analysis of a study with made-up drives.
"""

import shutil
import sys
import tempfile
from pathlib import Path

from PIL import Image
from playwright.sync_api import Browser, Page, sync_playwright

from tests.support.browsers.visitor import Visitor, chromium
from tests.support.sessions.site import ROOT, Site, running_site

FOLDER = ROOT / "docs" / "img"
LARGEST = 150_000  # bytes
FAST = 0.2  # m/s
WIDE, UPRIGHT = {"width": 1280, "height": 800}, {"width": 390, "height": 844}
PARTICIPANTS = 12
STUDY = f"""
import numpy as np
from accounts.models import User
from experiments.models import Study, StudyMember
from robots.models import FloorPlan, Robot
from tests.support.analysis.study_dataset import made_up
from tests.support.studies.study_rows import put
for rows in (Study, Robot, FloorPlan):
    rows.objects.all().delete()  # those of a new site, whose names the made-up ones have
stored = put(made_up(np.random.default_rng(7), {PARTICIPANTS}))
user, _ = User.objects.get_or_create(username="vera")
StudyMember.objects.create(slug=stored.study.slug, user=user, role="viewer")
print(stored.study.slug)
"""


def write(picture: Path, name: str) -> None:
    """Write a picture as WebP, at the best quality that fits into LARGEST bytes."""
    with Image.open(picture) as image:
        for quality in range(90, 30, -10):
            image.convert("RGB").save(FOLDER / f"{name}.webp", quality=quality, method=6)
            if (FOLDER / f"{name}.webp").stat().st_size <= LARGEST:
                return


def driving(browser: Browser, site: Site, name: str, size: dict[str, int], folder: Path) -> None:
    """Take a picture while driving to a door, with the robot's path shown."""
    is_phone = size is UPRIGHT
    driver = Visitor(browser, site, name, viewport=size, has_touch=is_phone, is_mobile=is_phone)
    driver.open(go=True)
    driver.wait_for("phase", "driving", 60)
    driver.wait_for_picture(60)
    driver.wait_for("link", "live", 60)
    while not is_on_its_way(driver.page):
        driver.page.keyboard.up("ArrowUp")
        driver.page.wait_for_timeout(1000)
    driver.screenshot(folder / f"{name}.png")
    driver.page.keyboard.up("ArrowUp")
    driver.close()


def is_on_its_way(page: Page) -> bool:
    """Hold a key for some seconds, and tell whether the robot moves and its path is shown."""
    page.keyboard.down("ArrowUp")
    for _ in range(30):
        page.wait_for_timeout(100)
        speed = (page.locator("#dial-speed").text_content() or "").replace("–", "") or "0"
        if float(speed) > FAST and page.get_attribute("#overlay", "data-shows") == "held":
            return True
    return False


def analysis(browser: Browser, site: Site, folder: Path) -> None:
    """Take a picture of the trajectories of a study on the floor plan."""
    slug = site.django(STUDY).strip()
    vera = Visitor(browser, site, "vera", viewport=WIDE)
    vera.page.goto(f"/studies/{slug}/analysis/trajectories/")
    vera.page.locator("#figure-7").wait_for(timeout=300_000)
    vera.page.locator("#figure-7").scroll_into_view_if_needed()
    vera.page.locator("#figure-7").evaluate(
        "(figure) => scrollTo(0, figure.getBoundingClientRect().top + scrollY - 12)"
    )
    vera.screenshot(folder / "analysis.png")
    vera.close()


def main() -> None:
    folder = Path(tempfile.mkdtemp(prefix="telepresence-pictures-"))
    try:
        with sync_playwright() as playwright, chromium(playwright) as browser:
            with running_site(folder / "drives") as site:
                site.start_robot("giraff", "--start", "lab-before-door")
                driving(browser, site, "drive", WIDE, folder)
                driving(browser, site, "phone", UPRIGHT, folder)
            with running_site(folder / "study") as site:
                analysis(browser, site, folder)
        for name in ("drive", "phone", "analysis"):
            write(folder / f"{name}.png", name)
    finally:
        shutil.rmtree(folder, ignore_errors=True)


if __name__ == "__main__":
    sys.exit(main())
