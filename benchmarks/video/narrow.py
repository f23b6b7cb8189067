"""The picture on a network of 400 kbit/s, and what becomes of it when the network is wide again.
Linux, as root: a network namespace and tbf.

A whole site, a simulated robot that turns (every pixel changes), Chromium behind a cable whose rate
is limited towards it, with a queue of half a second as home routers have. The age of a picture is
from the moment the camera sampled the world to the picture's callback in the page, by the same
clocks that a drive's record uses.
"""

import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from playwright.sync_api import Page, sync_playwright

from benchmarks.table import CAMERA_FPS, Figure, keep, quantiles
from tests.support.browsers.chromium import CHROMIUM
from tests.support.browsers.visitor import Visitor, chromium
from tests.support.programs.namespace import HERE, Namespace, namespace
from tests.support.sessions.site import LOOPBACK, Site, running_site

RATE = "400kbit"
NARROW, WIDE = 25.0, 15.0  # s
# The moment of every picture in seconds of the page, beside the page's own callback.
WATCH = """() => {
  const video = document.getElementById('video');
  window.seen = [];
  const each = (now) => {
    window.seen.push(now / 1000);
    video.requestVideoFrameCallback(each);
  };
  video.requestVideoFrameCallback(each);
  return performance.now() / 1000;
}"""


def limit(network: Namespace, rate: str | None) -> None:
    subprocess.run(
        ["tc", "qdisc", "del", "dev", network.cable, "root"], check=False, capture_output=True
    )
    if rate:
        command = [
            "tc",
            "qdisc",
            "add",
            "dev",
            network.cable,
            "root",
            "tbf",
            "rate",
            rate,
            "burst",
            "4kb",
            "latency",
            "500ms",
        ]
        subprocess.run(command, check=True, capture_output=True)


def rate_until(seen: list[float], at: float, wanted: float) -> float:
    """Return the seconds after `at` from which on a second of pictures has the wanted number."""
    moments = [moment for moment in seen if moment >= at]
    return next(
        (
            moment - at
            for index, moment in enumerate(moments)
            if len([m for m in moments[index:] if m < moment + 1.0]) >= wanted
        ),
        float("inf"),
    )


@dataclass
class NarrowDrive:
    """A drive whose network is narrow for a while: the moments of its pictures and of both changes
    of the network in seconds of the page, the states stored while it was narrow, and the log's
    lines about layers.
    """

    narrow: float
    wide: float
    seen: list[float]
    states: list[dict[str, Any]]
    layers: list[str] = field(default_factory=list)


def turn_left(page: Page, milliseconds: float) -> None:
    page.keyboard.down("ArrowLeft")
    page.wait_for_timeout(milliseconds)
    page.keyboard.up("ArrowLeft")


def drive(anna: Visitor, site: Site, network: Namespace) -> NarrowDrive:
    """Turn on a wide network, on a narrow one, and on a wide one again."""
    page = anna.page
    page.keyboard.down("ArrowLeft")
    page.wait_for_timeout(6000)
    page.evaluate(WATCH)
    page.wait_for_timeout(3000)
    limit(network, RATE)
    narrow, narrowed = page.evaluate("performance.now() / 1000"), time.time()
    # a page that hangs releases its keys, and people press again
    for _ in range(round(NARROW / 2.5)):
        turn_left(page, 2400)
        page.wait_for_timeout(100)
    limit(network, None)
    wide = page.evaluate("performance.now() / 1000")
    turn_left(page, WIDE * 1000)
    states = [
        state
        for state in site.states(site.sessions()[-1][0])
        if narrowed + 3.0 < state["stamp"] < narrowed + NARROW
    ]
    return NarrowDrive(narrow, wide, page.evaluate("window.seen"), states)


def measure() -> NarrowDrive:
    with (
        tempfile.TemporaryDirectory(prefix="telepresence-narrow-") as folder,
        running_site(Path(folder), bind="0.0.0.0", ALLOWED_HOSTS=f"{LOOPBACK},{HERE}") as site,
        sync_playwright() as playwright,
        namespace() as network,
        chromium(playwright, str(network.wrapper(Path(folder), CHROMIUM))) as browser,
    ):
        site.start_robot("giraff", "--start", "corridor-centre", "--fps", str(CAMERA_FPS))
        anna = Visitor(browser, site, "anna", host=HERE).drive()
        anna.wait_for("link", "live")
        result = drive(anna, site, network)
        anna.leave()
        anna.close()
        site.stop("giraff")
        site.stop("giraff-simulator")
        result.layers = [
            line.split()[0] + " " + line.split()[-1]
            for line in site.log("giraff").splitlines()
            if "picture_quality" in line
        ]
    return result


def figures_of(result: NarrowDrive) -> list[Figure]:
    """Return the time until the frame rate recovers, and the age of the frames until then."""
    narrow, wide, seen = result.narrow, result.wide, result.seen
    old = [
        1000.0 * command["frameAge"]
        for state in result.states
        for command in state.get("applied", [])
        if command.get("frameAge") is not None
    ]
    settled = [moment for moment in seen if narrow + 3.0 <= moment < wide]
    return [
        Figure("400 kbit/s: 12 pictures a second after", rate_until(seen, narrow, 12), "s", 3.0),
        Figure(
            "400 kbit/s: from one picture to the next, mean",
            1000.0 * (wide - narrow - 3.0) / max(1, len(settled)),
            "ms",
            1000.0 / 12.0,
        ),
        *quantiles(
            "400 kbit/s: age of the picture",
            old or [float("inf")],
            "ms",
            p50=None,
            p95=250.0,
            max=None,
        ),
        Figure("wide again: 24 pictures a second after", rate_until(seen, wide, 24), "s", 10.0),
    ]


def main() -> int:
    result = measure()
    return keep("narrow", figures_of(result), camera_fps=CAMERA_FPS, layers=result.layers)


if __name__ == "__main__":
    sys.exit(main())
