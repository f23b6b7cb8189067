"""A visitor in a real browser."""

import contextlib
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from playwright.sync_api import (
    Browser,
    Error as PlaywrightError,
    FrameLocator,
    Page,
    Playwright,
    expect,
)

from tests.support.browsers.chromium import CHROMIUM, FLAGS
from tests.support.patience import HELD, patient
from tests.support.sessions.site import LOOPBACK, Site, wait_for

FRAMES = "document.getElementById('video').getVideoPlaybackQuality().totalVideoFrames"
# Greyscale statistics of the picture: a video that plays black or grey has hardly any spread.
SPREAD = """() => {
  const video = document.getElementById('video'), canvas = document.createElement('canvas');
  canvas.width = 64; canvas.height = 48;
  const context = canvas.getContext('2d', { willReadFrequently: true });
  context.drawImage(video, 0, 0, 64, 48);
  const data = context.getImageData(0, 0, 64, 48).data, greys = [];
  for (let i = 0; i < data.length; i += 4) greys.push((data[i] + data[i + 1] + data[i + 2]) / 3);
  const mean = greys.reduce((a, b) => a + b) / greys.length;
  return Math.sqrt(greys.reduce((a, b) => a + (b - mean) ** 2, 0) / greys.length);
}"""


def note_problems(page: Page, problems: list[str]) -> None:
    """Note the exceptions of a page's scripts, and what its content policy refuses."""
    refused = "Content Security Policy"
    page.on("pageerror", lambda error: problems.append(str(error)))
    page.on("console", lambda line: problems.append(line.text) if refused in line.text else None)


def turn_leaf(place: Page | FrameLocator) -> None:
    """Follow "Next", and wait for the next page: a second click would hit the same link again."""
    link = place.get_by_role("link", name="Next")
    old = place.locator(f'a[href="{link.get_attribute("href")}"]', has_text="Next")
    link.click()
    expect(old).to_have_count(0)
    expect(place.locator("main")).to_be_visible()


@contextlib.contextmanager
def chromium(playwright: Playwright, executable_path: str = CHROMIUM) -> Iterator[Browser]:
    browser = playwright.chromium.launch(executable_path=executable_path, args=FLAGS)
    yield browser
    browser.close()


class Visitor:
    """One person with one page."""

    def __init__(
        self,
        browser: Browser,
        site: Site,
        name: str | None = None,
        *,
        host: str = LOOPBACK,
        url: str = "",
        **context: Any,
    ) -> None:
        url = url or f"http://{host}:{site.web_port}"
        context = {"viewport": {"width": 1280, "height": 800}, "locale": "en", **context}
        self.site = site
        self.context = browser.new_context(base_url=url, **context)
        if name is not None:
            cookie = {"name": "sessionid", "value": site.sign_in(name), "url": url}
            self.context.add_cookies([cookie])
        self.problems: list[str] = []
        self.page: Page = self.new_page()

    def new_page(self) -> Page:
        page = self.context.new_page()
        note_problems(page, self.problems)
        return page

    def open(self, robot: str = "giraff", *, go: bool = False) -> "Visitor":
        self.page.goto(f"/robots/{robot}/{'?go=1' if go else ''}")
        return self

    def drive(self, robot: str = "giraff") -> "Visitor":
        """Open a robot, take it, and wait until its picture moves."""
        self.open(robot, go=True)
        self.wait_for_picture()
        return self

    def page_data(self, name: str) -> str:
        return self.page.locator("#drive-page").get_attribute(f"data-{name}") or ""

    def wait_for(self, name: str, value: str, within: float = 15.0) -> None:
        expect(self.page.locator("#drive-page")).to_have_attribute(
            f"data-{name}", value, timeout=patient(within) * 1000
        )

    def wait_for_picture(self, within: float = 15.0) -> None:
        # Not wait_for_function: the page's policy forbids the eval that it polls with.
        wait_for(
            lambda: self.frames() > 3,
            within,
            "a picture",
            lambda: {name: self.page_data(name) for name in ("phase", "link")},
        )

    def hold(self, key: str, reached: Callable[[], Any], within: float, what: str) -> None:
        """Hold a key until the condition is true, and keep it down. It is pressed again after
        `HELD`, as a page releases all keys when its link is replaced.
        """
        deadline = time.monotonic() + patient(within)
        while True:
            self.page.keyboard.down(key)
            again = time.monotonic() + HELD
            while time.monotonic() < again:
                if reached():
                    return
                self.page.wait_for_timeout(50)
            assert time.monotonic() < deadline, (
                f"{what} did not come within {within} s (link {self.page_data('link')}, transport"
                f" {self.page_data('transport')})"
            )
            self.page.keyboard.up(key)

    def frames(self) -> int:
        return int(self.page.evaluate(FRAMES))

    def spread(self) -> float:
        return float(self.page.evaluate(SPREAD))

    def marker(self) -> dict[str, float]:
        """Return where the map draws the robot's arrow, in CSS pixels, the stamp of that pose, and
        the map's transform.
        """
        data = self.page.evaluate("({...document.getElementById('map').dataset})")
        names = ("markerX", "markerY", "markerStamp", "viewX", "viewY", "viewScale")
        return {name: float(data[name]) for name in names}

    def screenshot(self, path: Path) -> None:
        self.page.screenshot(path=path)

    def leave(self) -> None:
        self.page.keyboard.up("ArrowUp")
        self.page.get_by_role("button", name="Leave", exact=True).click()
        self.page.locator("#card-main").click()
        self.wait_for("phase", "ended")

    def close(self) -> None:
        """Close the window; a driver leaves first, so that the next visitor does not wait."""
        with contextlib.suppress(PlaywrightError):
            if self.page.locator("#drive-page").count() and self.page_data("phase") == "driving":
                self.leave()
        self.context.close()
