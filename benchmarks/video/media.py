"""Picture: glass to glass, first picture after the offer, and what viewers cost the robot.

Glass to glass is from the moment the camera samples the world to the picture's callback in
Chromium, read from a bar code that is drawn at that moment; the same by RTP timestamp and media
clock for the simulated robot. Ours and plain aiortc alternate in blocks of one run, because
machines differ and ratios do not. Processor time is that of the robot's processes alone; pages
without a browser watch where many are needed. Linux only, for /proc.
"""

import asyncio
import json
import os
import statistics
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from playwright.async_api import Browser

from benchmarks.table import RESULTS
from benchmarks.video.media_robots import RobotProcess
from robots.api.messages import Bye, Role
from tests.support.browsers.browser_page import BrowserPage, chromium
from tests.support.media.loopback_peer import Exchange, LoopbackPage
from tests.support.patience import until

PEER = "p1"
BLOCKS = 3  # of each kind
BLOCK = 6.0  # s
SETTLE = 3.0  # s left out after each connection
FIRST_FRAMES = 12
VIEWERS = 8
LOAD_SECONDS = 8.0


@dataclass(frozen=True)
class Measurement:
    """One line of the table; `limit` None is for information."""

    name: str
    value: float
    unit: str
    limit: float | None = None

    def __str__(self) -> str:
        verdict = (
            ""
            if self.limit is None
            else (
                f"   target <= {self.limit:g}  "
                f" {'reached' if self.value <= self.limit else 'MISSED'}"
            )
        )
        return f"{self.name:58s} {self.value:8.2f} {self.unit:4s}{verdict}"


async def glass_to_glass(browser: Browser, address: str, kind: str, what: str) -> list[float]:
    """Return the delays in ms of one block with one viewer of a robot that has just started."""
    exchange = Exchange(asyncio.get_running_loop())
    robot: Any = await asyncio.to_thread(RobotProcess, kind, exchange)
    delays = await delays_of(browser, address, robot, exchange, what)
    await asyncio.to_thread(robot.close)
    return delays


async def delays_of(
    browser: Browser,
    address: str,
    robot: Any,
    exchange: Exchange,
    what: str = "delays",
    role: Role = "observer",
) -> list[float]:
    """Return the delays in ms of one block, watched over a direct connection of PEER that ends with
    it; `what` names them in the page's report.
    """
    page = await BrowserPage.open(browser, address, robot, exchange, PEER, role=role)
    await page.watch()
    await page.report_when("report.decoded > 0")
    await asyncio.sleep(SETTLE)
    skipped = len((await page.report())[what])
    await asyncio.sleep(BLOCK)
    delays = [1000.0 * delay for delay in (await page.report())[what][skipped:]]
    robot.signal(PEER, Bye())
    await page.page.context.close()
    return delays


async def first_frames(browser: Browser, address: str) -> list[float]:
    """Return the seconds from making the offer to the first picture's callback, once a connection;
    the camera is cold each time.
    """
    exchange = Exchange(asyncio.get_running_loop())
    robot: Any = await asyncio.to_thread(RobotProcess, "ours", exchange)
    seconds = []
    for number in range(FIRST_FRAMES):
        page = await BrowserPage.open(browser, address, robot, exchange, f"p{number}")
        await page.watch()
        report = await page.report_when("report.decoded > 0")
        seconds.append(report["firstFrame"] - report["offered"])
        robot.signal(f"p{number}", Bye())
        await page.page.context.close()
    await asyncio.to_thread(robot.close)
    return seconds


async def load(kind: str, viewers: int) -> float:
    """Return the share of a core that a robot takes, with its children, while pages without a
    browser watch.
    """
    exchange = Exchange(asyncio.get_running_loop())
    robot: Any = await asyncio.to_thread(RobotProcess, kind, exchange)
    pages = [LoopbackPage(robot, exchange, f"p{number}", decode=False) for number in range(viewers)]
    for page in pages:
        await page.connect()
    await until(lambda: all(len(page.pictures) > 30 for page in pages))
    used, began = cpu_of_tree(robot.pid), asyncio.get_running_loop().time()
    await asyncio.sleep(LOAD_SECONDS)
    share = (cpu_of_tree(robot.pid) - used) / (asyncio.get_running_loop().time() - began)
    for page in pages:
        await page.close()
    await asyncio.to_thread(robot.close)
    return share


def cpu_of_tree(pid: int) -> float:
    """Return the processor time in seconds that a process and its living descendants have taken."""
    parents: dict[int, tuple[int, float]] = {}
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = stat.read_text().rpartition(")")[2].split()
        except OSError:
            continue  # the process has ended
        parents[int(stat.parent.name)] = (
            int(fields[1]),
            (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK"),
        )
    tree, grown = {pid}, True
    while grown:
        more = {child for child, (parent, _) in parents.items() if parent in tree} - tree
        tree, grown = tree | more, bool(more)
    return sum(parents[member][1] for member in tree if member in parents)


def p95(values: list[float]) -> float:
    """Return the 95th percentile."""
    return statistics.quantiles(values, n=20)[18]


async def measure() -> list[Measurement]:
    delays: dict[str, list[float]] = {"ours": [], "plain": []}
    async with chromium() as (browser, address):
        for _ in range(BLOCKS):
            for kind, values in delays.items():
                values.extend(await glass_to_glass(browser, address, kind, "delays"))
        simulated = await glass_to_glass(browser, address, "simulator", "ages")
        firsts = await first_frames(browser, address)
    loads = {
        viewers: min([await load("ours", viewers) for _ in range(2)]) for viewers in (1, VIEWERS)
    }
    simulator = await load("simulator", 1)
    ours, plain = statistics.median(delays["ours"]), statistics.median(delays["plain"])
    return [
        Measurement("glass to glass, p50", ours, "ms", 20.0),
        Measurement("glass to glass, p95", p95(delays["ours"]), "ms", 45.0),
        Measurement(
            "glass to glass, pictures a second", len(delays["ours"]) / BLOCKS / BLOCK, "1/s"
        ),
        Measurement("glass to glass of plain aiortc, p50", plain, "ms"),
        Measurement("glass to glass of plain aiortc, p95", p95(delays["plain"]), "ms"),
        Measurement("ratio of the medians, ours to plain aiortc", ours / plain, ""),
        Measurement(
            "glass to glass of the simulated robot, p50", statistics.median(simulated), "ms", 20.0
        ),
        Measurement("glass to glass of the simulated robot, p95", p95(simulated), "ms", 45.0),
        Measurement("first picture after the offer, p50", statistics.median(firsts), "s"),
        Measurement("first picture after the offer, p95", p95(firsts), "s", 0.6),
        Measurement("processor, synthetic camera, 1 viewer", 100.0 * loads[1], "%"),
        Measurement(f"processor, synthetic camera, {VIEWERS} viewers", 100.0 * loads[VIEWERS], "%"),
        Measurement(f"ratio of {VIEWERS} viewers to 1", loads[VIEWERS] / loads[1], "", 1.3),
        Measurement("processor, media side and simulator, 1 viewer", 100.0 * simulator, "%", 60.0),
    ]


def main() -> int:
    lines = asyncio.run(measure())
    for line in lines:
        print(line)
    RESULTS.mkdir(exist_ok=True)
    (RESULTS / "media.json").write_text(
        json.dumps(
            [
                {"name": line.name, "value": line.value, "unit": line.unit, "target": line.limit}
                for line in lines
            ],
            indent=1,
        )
    )
    return int(any(line.limit is not None and line.value > line.limit for line in lines))


if __name__ == "__main__":
    sys.exit(main())
