"""`make pictures` takes the pictures of README and documentation on whole sites with a simulated
robot, and writes them into docs/img: a drive through a door as a moving picture, the drive page
with a mouse and on a phone, and the analysis of a study with made-up drives. The two of the drive
page are also what browsers show when the page is installed (static/img/screens).

pictures.json says what each of them shows, for the tests that find an outdated one
(tests/support/browsers/shown.py has what counts).
"""

import base64
import hashlib
import io
import json
import math
import re
import shutil
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import django
from PIL import Image
from playwright.sync_api import Browser, Page, sync_playwright

from tests.support.agents.truth import Onlooker
from tests.support.browsers.present_robot_page import ABLE, PresentRobotPage
from tests.support.browsers.shown import FOLDER, PROBE, RECORDS, Control, controls, differences
from tests.support.browsers.visitor import Visitor, chromium
from tests.support.sessions.site import ROOT, Site, running_site, wait_for

LARGEST = 150_000  # bytes of a picture
LARGEST_FILM = 1_500_000
FILM_SIZE, FILM_FPS = (720, 450), 8
FAST = 0.2  # m/s
WIDE, UPRIGHT = {"width": 1280, "height": 800}, {"width": 390, "height": 844}
# The page that a picture shows, and the window of its record.
PAGE_OF = {
    "drive-through-a-door.webp": "drive page",
    "drive.webp": "drive page",
    "phone.webp": "drive page on a phone",
    "analysis.webp": "analysis",
}
INSTALLED = {"drive": "wide", "phone": "narrow"}  # the form factor in the manifest
DOOR_PASSED, CORRIDOR_X = 1.45, 3.6  # m: y behind the laboratory's door, x along the corridor
ALONG = 0.25  # rad
TAKES = 3
# A fault of the server or the link, which a computer that is too busy has.
NOTE_ALERTS = """() => {
  const alert = document.getElementById("alert");
  const note = () => { if (!alert.hidden) document.body.dataset.alerted = alert.textContent; };
  new MutationObserver(note).observe(alert, { attributes: true, attributeFilter: ["hidden"] });
}"""
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


def write(picture: Path, target: Path) -> None:
    """Write a picture as WebP, at the best quality that fits into LARGEST bytes."""
    with Image.open(picture) as image:
        for quality in range(90, 30, -10):
            image.convert("RGB").save(target, quality=quality, method=6)
            if target.stat().st_size <= LARGEST:
                return


# --- drives ---


def driver_of(browser: Browser, site: Site, name: str, size: dict[str, int]) -> Visitor:
    is_phone = size is UPRIGHT
    driver = Visitor(browser, site, name, viewport=size, has_touch=is_phone, is_mobile=is_phone)
    driver.open(go=True)
    driver.wait_for("phase", "driving", 60)
    driver.wait_for_picture(60)
    driver.wait_for("link", "live", 60)
    # The robot looks for its position on the map, and the page says so.
    driver.page.locator("#offer").wait_for(state="hidden", timeout=60_000)
    return driver


def driving(
    browser: Browser, site: Site, giraff: Onlooker, name: str, size: dict[str, int], folder: Path
) -> None:
    """Take a picture while driving to a door, with the robot's path shown."""
    driver = driver_of(browser, site, name, size)
    while not is_on_its_way(driver.page, giraff):
        driver.page.keyboard.up("ArrowUp")
        driver.page.wait_for_timeout(1000)
    driver.screenshot(folder / f"{name}.png")
    driver.page.keyboard.up("ArrowUp")
    driver.close()


def is_on_its_way(page: Page, giraff: Onlooker) -> bool:
    """Hold a key for some seconds, and tell whether the robot moves and its path is shown."""
    page.keyboard.down("ArrowUp")
    for _ in range(30):
        page.wait_for_timeout(100)
        is_shown = page.get_attribute("#overlay", "data-shows") == "held"
        if giraff.truth().linear > FAST and is_shown:
            return True
    return False


@contextmanager
def filmed(page: Page) -> Iterator[list[tuple[float, bytes]]]:
    """Collect what the page shows as (s, JPEG) while the block runs."""
    frames: list[tuple[float, bytes]] = []
    session = page.context.new_cdp_session(page)

    def note(frame: dict[str, Any]) -> None:
        frames.append((frame["metadata"]["timestamp"], base64.b64decode(frame["data"])))
        session.send("Page.screencastFrameAck", {"sessionId": frame["sessionId"]})

    session.on("Page.screencastFrame", note)
    session.send("Page.startScreencast", {"format": "jpeg", "quality": 90})
    yield frames
    session.send("Page.stopScreencast")


def hold_until(page: Page, key: str, reached: Callable[[], bool]) -> None:
    """Hold a key until the robot has reached what it should."""
    page.keyboard.down(key)
    deadline = time.monotonic() + 30
    while not reached():
        assert time.monotonic() < deadline, f"{key} did not bring the robot there"
        page.wait_for_timeout(40)
    page.keyboard.up(key)


def through_a_door(browser: Browser, site: Site, giraff: Onlooker) -> bool:
    """Film a drive from the laboratory through its door and along the corridor, and tell whether no
    alert was shown, as on a computer that is too busy.
    """
    driver = driver_of(browser, site, "film", WIDE)
    page, truth = driver.page, giraff.truth
    page.evaluate(NOTE_ALERTS)
    with filmed(page) as frames:
        page.wait_for_timeout(600)
        hold_until(page, "ArrowUp", lambda: truth().y < DOOR_PASSED)
        hold_until(page, "ArrowLeft", lambda: abs(math.remainder(truth().theta, math.tau)) < ALONG)
        hold_until(page, "ArrowUp", lambda: truth().x > CORRIDOR_X)
        page.wait_for_timeout(800)
    is_calm = page.locator("body[data-alerted]").count() == 0
    driver.close()
    write_film(frames, FOLDER / "drive-through-a-door.webp")
    return is_calm


def write_film(frames: list[tuple[float, bytes]], target: Path) -> None:
    """Write what was filmed as an animated WebP that repeats, at its real pace."""
    first, last = frames[0][0], frames[-1][0]
    shown = []
    for tick in range(int((last - first) * FILM_FPS) + 1):
        _, data = max(one for one in frames if one[0] <= first + tick / FILM_FPS)
        shown.append(Image.open(io.BytesIO(data)).convert("RGB").resize(FILM_SIZE, Image.LANCZOS))
    for quality in range(80, 10, -10):
        shown[0].save(
            target,
            save_all=True,
            append_images=shown[1:],
            duration=1000 // FILM_FPS,
            loop=0,
            quality=quality,
            method=4,
        )
        if target.stat().st_size <= LARGEST_FILM:
            return


# --- a study ---


def analysis(browser: Browser, site: Site) -> tuple[Visitor, list[Control]]:
    """Open the trajectories of a study on the floor plan, and return what the page shows."""
    slug = site.django(STUDY).strip()
    vera = Visitor(browser, site, "vera", viewport=WIDE)
    vera.page.goto(f"/studies/{slug}/analysis/trajectories/")
    vera.page.locator("#figure-7").wait_for(timeout=300_000)
    vera.page.locator("#figure-7").scroll_into_view_if_needed()
    vera.page.locator("#figure-7").evaluate(
        "(figure) => scrollTo(0, figure.getBoundingClientRect().top + scrollY - 12)"
    )
    return vera, controls(vera.page.evaluate(PROBE))


# --- records ---


def drive_page(browser: Browser, size: dict[str, int]) -> list[Control]:
    """Return what the drive page shows while its visitor drives, once it no longer changes. It is
    the page of the tests, whose robot does the same every time.
    """
    is_phone = size is UPRIGHT
    with PresentRobotPage(capabilities=ABLE) as site:
        page = browser.new_page(viewport=size, has_touch=is_phone, is_mobile=is_phone)
        page.goto(f"{site.url}?go=1")
        page.wait_for_selector("#drive-page[data-playing][data-link=live]", timeout=60_000)
        found = None
        while found is None or differences(found, controls(page.evaluate(PROBE))):
            found = controls(page.evaluate(PROBE))
            page.wait_for_timeout(3000)
        page.close()
    return found


def record(pages: dict[str, list[Control]]) -> None:
    """Write the digest of each picture, and what its page shows: one line a control."""
    digests = {
        name: {"page": page, "sha256": hashlib.sha256((FOLDER / name).read_bytes()).hexdigest()}
        for name, page in PAGE_OF.items()
    }
    text = json.dumps({"pictures": digests, "pages": pages}, indent=1, ensure_ascii=False)
    one_line = lambda match: " ".join(match[0].split())
    RECORDS.write_text(re.sub(r"\{[^{}]*\}", one_line, text) + "\n", "utf-8")


def main() -> None:
    django.setup()  # for the drive page without a site
    folder = Path(tempfile.mkdtemp(prefix="telepresence-pictures-"))
    try:
        with sync_playwright() as playwright, chromium(playwright) as browser:
            shown = take(browser, folder)
            pages = {
                "drive page": drive_page(browser, WIDE),
                "drive page on a phone": drive_page(browser, UPRIGHT),
                "analysis": shown,
            }
    finally:
        shutil.rmtree(folder, ignore_errors=True)
    record(pages)


def take(browser: Browser, folder: Path) -> list[Control]:
    """Take all pictures, and return what the page of the analysis shows."""
    for number in range(TAKES):
        with running_site(folder / f"film-{number}") as site:
            giraff = site.start_robot("giraff", "--start", "lab-before-door", "--fps", "15")
            if through_a_door(browser, site, giraff):
                break
    with running_site(folder / "drives") as site:
        giraff = site.start_robot("giraff", "--start", "lab-before-door")
        driving(browser, site, giraff, "drive", WIDE, folder)
        driving(browser, site, giraff, "phone", UPRIGHT, folder)
    with running_site(folder / "study") as site:
        vera, shown = analysis(browser, site)
        vera.screenshot(folder / "analysis.png")
        vera.close()
    for name in ("drive", "phone", "analysis"):
        write(folder / f"{name}.png", FOLDER / f"{name}.webp")
    for name, form in INSTALLED.items():
        write(folder / f"{name}.png", ROOT / "static" / "img" / "screens" / f"drive-{form}.webp")
    return shown


if __name__ == "__main__":
    sys.exit(main())
