"""The page on a whole site: from ready to the first frame, the load of a drive, and how old the
picture is that a command names.
"""

import sys
import tempfile
import time
from pathlib import Path

import psutil
from playwright.sync_api import Browser, Page, sync_playwright

from benchmarks.table import CAMERA_FPS, Figure, keep, quantiles
from tests.support.browsers.visitor import Visitor, chromium
from tests.support.sessions.site import Site, running_site, wait_for

LOADS = 20
COLD_LOADS = 5  # with nothing in the browser's cache
SECONDS = 20.0
ON_THE_WAY = 10.0  # seconds that the way to the next room takes at least
BOUNDS = {"going to the next room": 60.0, "turning": 60.0}
FIRST_FRAME = "performance.getEntriesByName('drive:first-frame').length"
# What a load consists of, each from the end of the one before, but for the picture and the link,
# which come about at the same time.
PARTS = ("document", "scripts", "socket", "robot", "link", "picture")
TIMES = """(() => {
  const at = (name) => performance.getEntriesByName(name)[0].startTime;
  const [load] = performance.getEntriesByType('navigation');
  const [scripts, socket, robot] = [at('drive:taking'), at('drive:socket'), at('drive:driving')];
  return {
    document: load.responseEnd,
    scripts: scripts - load.responseEnd,
    socket: socket - scripts,
    robot: robot - socket,
    link: at('drive:link') - robot,
    picture: at('drive:first-frame') - robot,
    ready: scripts,
    whole: at('drive:first-frame'),
  };
})()"""


def load_once(visitor: Visitor) -> dict[str, float]:
    """Return seconds of one load: of its PARTS, until the page's script asks for the robot
    (`ready`), and until the first frame (`whole`).
    """
    visitor.open(go=True)
    wait_for(lambda: visitor.page.evaluate(FIRST_FRAME), 30, "a first frame")
    visitor.wait_for("link", "live")
    times = visitor.page.evaluate(TIMES)
    visitor.leave()
    return {name: milliseconds / 1000 for name, milliseconds in times.items()}


def cold_loads(browser: Browser, site: Site) -> list[dict[str, float]]:
    """Return the times of loads by browsers that were never here."""
    found = []
    for _ in range(COLD_LOADS):
        visitor = Visitor(browser, site, "anna")
        found.append(load_once(visitor))
        visitor.close()
    return found


def tree(pid: int) -> list[psutil.Process]:
    parent = psutil.Process(pid)
    return [parent, *parent.children(recursive=True)]


def cpu(pids: list[int]) -> float:
    """Return the CPU seconds that these processes and their children have used."""
    return sum(sum(process.cpu_times()[:2]) for pid in pids for process in tree(pid))


def load(site: Site, page: Page, seconds: float = SECONDS) -> float:
    """Return the share of a core (in %) that agent and simulator use with one viewer while they do
    what they are doing.
    """
    pids = [site.processes[name].pid for name in ("giraff", "giraff-simulator")]
    page.wait_for_timeout(2000)
    used, began = cpu(pids), time.monotonic()
    page.wait_for_timeout(seconds * 1000)
    return 100 * (cpu(pids) - used) / (time.monotonic() - began)


def loads_of(site: Site, page: Page) -> dict[str, float]:
    """Return the load of a robot that stands, of one that goes to another room by itself, and of
    one that turns at full speed.
    """
    found = {"standing": load(site, page)}
    page.get_by_role("button", name="Go to…").click()
    page.get_by_role("button", name="Laboratory", exact=True).click()
    found["going to the next room"] = load(site, page, ON_THE_WAY)
    page.keyboard.down("ArrowLeft")
    found["turning"] = load(site, page)
    page.keyboard.up("ArrowLeft")
    return found


def main() -> int:
    with (
        tempfile.TemporaryDirectory(prefix="telepresence-page-") as folder,
        running_site(Path(folder)) as site,
    ):
        site.start_robot("giraff", "--start", "lounge-centre", "--fps", str(CAMERA_FPS))
        with sync_playwright() as playwright, chromium(playwright) as browser:
            visitor = Visitor(browser, site, "anna")
            visitor.drive().leave()  # the first one fills the browser's cache
            loads, cold = [load_once(visitor) for _ in range(LOADS)], cold_loads(browser, site)
            visitor.drive()
            shares = loads_of(site, visitor.page)
            visitor.close()
    frames = [one["picture"] + one["robot"] + one["socket"] for one in loads]
    figures = quantiles(
        "link to page ready to drive", [one["ready"] for one in loads], "s", p50=1.0, max=None
    )
    figures += quantiles("page ready to first frame", frames, "s", p50=None, p95=0.6, max=None)
    figures += quantiles(
        "link to first frame", [one["whole"] for one in loads], "s", p50=None, max=None
    )
    figures += quantiles(
        "link to first frame, browser never here",
        [one["whole"] for one in cold],
        "s",
        p50=None,
        max=None,
    )
    for name in PARTS:
        figures += quantiles(f"of it {name}", [one[name] for one in loads], "s", p50=None)
        figures += quantiles(
            f"of it {name}, browser never here", [one[name] for one in cold], "s", p50=None
        )
    figures += [
        Figure(f"agent and simulator, one viewer, {doing}", share, "%", BOUNDS.get(doing))
        for doing, share in shares.items()
    ]
    return keep("page", figures, camera_fps=CAMERA_FPS, first_frames=frames)


if __name__ == "__main__":
    sys.exit(main())
