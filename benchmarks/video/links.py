"""The picture on links of several rates, round trips and losses, as a table.

A whole site, a simulated robot that turns (every pixel changes) with a camera of 30 frames a
second, and Chromium behind an emulated link: only the way to the visitor has a rate, with half a
second of queue; both ways have half of the round trip and the loss. Linux, as root.

`python -m benchmarks links`, or some cells: `python -m benchmarks.video.links 200/20/0 400/100/2`
(kbit/s, round trip in ms, loss in %).
"""

import argparse
import itertools
import os
import sys
import tempfile
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from playwright.sync_api import Page, sync_playwright

from benchmarks.table import CAMERA_FPS, Figure, keep
from benchmarks.video.narrow import WATCH
from robots.api.messages import NetworkLab
from tests.support.browsers.chromium import CHROMIUM
from tests.support.browsers.visitor import Visitor, chromium
from tests.support.programs.emulated_link import EmulatedLink, emulated_link
from tests.support.programs.namespace import HERE
from tests.support.sessions.site import LOOPBACK, Site, running_site

RATES, ROUND_TRIPS, LOSSES = (100, 200, 400, 800, 5000), (20, 100), (0, 2, 10)
DRIVABLE = 8.0  # frames a second, from 200 kbit/s on
NOW = """() => {
  const video = document.getElementById('video'), page = document.getElementById('drive-page');
  return {
    size: `${video.videoWidth}x${video.videoHeight}`,
    link: 'slow' in page.dataset ? 'slow' : page.dataset.link,
  };
}"""


@dataclass(frozen=True)
class LinkResult:
    """A link in kbit/s, ms and %, and what was seen on it: frames a second, longest gap in s, ages
    in ms, load as programs that want a core, and kbit/s to the visitor by kind.
    """

    rate: int
    round_trip: int
    loss: int
    fps: float
    gap: float
    age_p50: float
    age_p95: float
    size: str
    link: str
    load: float
    sent: dict[str, float]

    @property
    def name(self) -> str:
        return f"{self.rate}/{self.round_trip}/{self.loss}"

    def __str__(self) -> str:
        sent = ", ".join(f"{kind} {rate:.0f}" for kind, rate in self.sent.items())
        return (
            f"  {self.name:<13}{self.fps:5.1f}/s {self.size:<8} gap {self.gap:4.2f} s"
            f"  age {self.age_p50:4.0f} {self.age_p95:4.0f} ms  {self.link:<5}"
            f" load {self.load:4.1f}  {sent} kbit/s"
        )


def hold_left(page: Page, seconds: float) -> None:
    """Turn; a page that hangs releases its keys, and people press again."""
    until = time.monotonic() + seconds
    while (left := until - time.monotonic()) > 0.0:
        page.keyboard.down("ArrowLeft")
        page.wait_for_timeout(1000.0 * min(2.4, left))
        page.keyboard.up("ArrowLeft")
        page.wait_for_timeout(50)


def ages(states: list[dict[str, Any]], begin: float) -> list[float]:
    return [
        1000.0 * command["frameAge"]
        for state in states
        if state["stamp"] > begin
        for command in state.get("applied", [])
        if command.get("frameAge") is not None
    ]


def measure(
    anna: Visitor, site: Site, link: EmulatedLink, cell: tuple[int, int, int], seconds: float
) -> LinkResult:
    rate, round_trip, loss = cell
    both = {"delay": round_trip / 2000.0, "loss": loss / 100.0}
    link.set(NetworkLab(bitrate=1000 * rate, **both), NetworkLab(**both))
    hold_left(anna.page, 8.0)
    anna.page.evaluate("window.seen = []")
    began, before = time.time(), link.bits.copy()
    hold_left(anna.page, seconds)
    took = time.time() - began
    seen, now = anna.page.evaluate("window.seen"), anna.page.evaluate(NOW)
    sent = {kind: (bits - before[kind]) / took / 1000.0 for kind, bits in link.bits.most_common()}
    old = ages(site.states(site.sessions()[-1][0]), began) or [float("nan")]
    gaps = [after - first for first, after in itertools.pairwise(seen)] or [took]
    return LinkResult(
        *cell,
        fps=len(seen) / took,
        gap=max(gaps),
        age_p50=float(np.percentile(old, 50)),
        age_p95=float(np.percentile(old, 95)),
        size=now["size"],
        link=now["link"],
        load=os.getloadavg()[0],
        sent={kind: round(rate, 1) for kind, rate in sent.items() if rate >= 0.5},
    )


def measure_all(cells: list[tuple[int, int, int]], seconds: float) -> list[LinkResult]:
    found = []
    with (
        tempfile.TemporaryDirectory(prefix="telepresence-links-") as folder,
        running_site(Path(folder), bind="0.0.0.0", ALLOWED_HOSTS=f"{LOOPBACK},{HERE}") as site,
        sync_playwright() as playwright,
        emulated_link() as link,
        chromium(playwright, str(link.network.wrapper(Path(folder), CHROMIUM))) as browser,
    ):
        site.start_robot("giraff", "--start", "corridor-centre", "--fps", str(CAMERA_FPS))
        anna = Visitor(browser, site, "anna", host=HERE).drive()
        anna.wait_for("link", "live")
        anna.page.evaluate(WATCH)
        for cell in cells:
            found.append(measure(anna, site, link, cell, seconds))
            print(found[-1], flush=True)
        link.set(NetworkLab())
        anna.close()
    return found


def parsed(text: str) -> tuple[int, int, int]:
    rate, round_trip, loss = map(int, text.split("/"))
    return rate, round_trip, loss


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("cells", nargs="*", type=parsed)
    parser.add_argument("--seconds", type=float, default=10.0, help="of each cell")
    wanted = parser.parse_args()
    cells = wanted.cells or list(itertools.product(RATES, ROUND_TRIPS, LOSSES))
    found = measure_all(cells, wanted.seconds)
    figures = [
        Figure(
            f"{cell.name}: from one frame to the next, mean",
            1000.0 / max(cell.fps, 0.01),
            "ms",
            1000.0 / DRIVABLE if cell.rate >= 200 else None,
        )
        for cell in found
    ]
    return keep("links", figures, camera_fps=CAMERA_FPS, cells=[asdict(cell) for cell in found])


if __name__ == "__main__":
    sys.exit(main())
