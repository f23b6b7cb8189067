"""The drive page's own work: a minute of driving in a headless Chromium against a robot in this
process; `--seconds 10` for a shorter one.

Long tasks are the browser's (PerformanceObserver: more than 50 ms without a pause), by the clock on
the wall: on a busy machine whatever took the processor away is in them. The longest task by its own
CPU time, from the browser's trace, tells the page's share. What HUD, overlay and map cost is their
share of a sampling profile (samples with a function of theirs on the stack, of all samples of the
page's script) of the CPU time that the browser says all script took, and all that it spent on
styles and layout: CPU time, so that other work on the machine changes it little. Decoding and
painting are the browser's and not in it. How long a page of a whole site takes to be ready is
measured in benchmarks/page.py.
"""

import argparse
import asyncio
import gzip
import json
import os
import re
import sys
from pathlib import Path
from typing import Any

import django
from playwright.async_api import Browser, CDPSession, Page, async_playwright

from benchmarks.table import Figure, keep
from telepresence_site.web.module_graph import later_modules_of, modules_of

os.environ.setdefault("DJANGO_SETTINGS_MODULE", "tests.settings")

ROOT = Path(__file__).parents[1]
SAMPLE_MICROSECONDS = 250
STROKE_SECONDS = 2.0  # of each key in turn
KEYS = ("ArrowUp", "ArrowLeft", "ArrowDown", "ArrowRight")
SHOWN = re.compile(r"/static/js/(view|autonomy|study)/")
WATCH = """window.longTasks = [];
new PerformanceObserver((list) => {
  longTasks.push(...list.getEntries().map(({ duration }) => duration));
}).observe({ type: 'longtask' });"""
TASKS = {"RunTask", "ThreadControllerImpl::RunTask"}
PLAYING = "#drive-page[data-playing][data-link=live]"


def shares(profile: dict[str, Any]) -> tuple[float, float]:
    """Return seconds with a function of HUD, overlay or map on the stack, and seconds of all of the
    page's script, of a CPU profile.
    """
    nodes = {node["id"]: node for node in profile["nodes"]}
    parents = {child: node["id"] for node in profile["nodes"] for child in node.get("children", ())}

    def stack(node: int) -> str:
        urls = []
        at: int | None = node
        while at is not None:
            urls.append(nodes[at]["callFrame"]["url"])
            at = parents.get(at)
        return " ".join(urls)

    shown, script = 0.0, 0.0
    known = {node: stack(node) for node in nodes}
    for node, delta in zip(profile["samples"], profile["timeDeltas"], strict=True):
        script += delta / 1e6 if "/static/js/" in known[node] else 0.0
        shown += delta / 1e6 if SHOWN.search(known[node]) else 0.0
    return shown, script


def script_bytes() -> int:
    """Return how many bytes of script the drive page is sent at once, each file compressed as they
    are collected.
    """
    return sum(
        len(gzip.compress((ROOT / "static" / name).read_bytes()))
        for name in [
            *modules_of("js/drive/page.js"),
            *later_modules_of("js/drive/features.js", "js/drive/page.js"),
            "js/drive/load_retry.js",
        ]
    )


def longest_task(trace: bytes) -> float:
    """Return milliseconds of CPU that the longest task of a page's main thread took, of a browser's
    trace (Trace Event Format).
    """
    events = json.loads(trace)["traceEvents"]
    mains = {
        (one["pid"], one["tid"])
        for one in events
        if one["name"] == "thread_name" and one["args"]["name"] == "CrRendererMain"
    }
    return max(
        (
            one["tdur"] / 1000
            for one in events
            if one["name"] in TASKS and "tdur" in one and (one["pid"], one["tid"]) in mains
        ),
        default=0.0,
    )


async def metrics(session: CDPSession) -> dict[str, float]:
    """Return the renderer's own counters, in seconds of CPU."""
    found = await session.send("Performance.getMetrics")
    return {one["name"]: one["value"] for one in found["metrics"]}


async def drive(
    browser: Browser, page: Page, seconds: float
) -> tuple[dict[str, float], dict[str, Any], bytes]:
    """Drive and return what the counters rose by, the CPU profile of it, and the
    browser's trace.
    """
    session = await page.context.new_cdp_session(page)
    await session.send("Performance.enable", {"timeDomain": "threadTicks"})
    await session.send("Profiler.enable")
    await session.send("Profiler.setSamplingInterval", {"interval": SAMPLE_MICROSECONDS})
    await page.evaluate("longTasks.length = 0")
    before = await metrics(session)
    await session.send("Profiler.start")
    await browser.start_tracing(
        page=page, categories=["toplevel", "disabled-by-default-devtools.timeline", "__metadata"]
    )
    strokes = max(1, round(seconds / STROKE_SECONDS))
    for n in range(strokes):
        await page.keyboard.down(KEYS[n % len(KEYS)])
        await page.wait_for_timeout(STROKE_SECONDS * 1000)
        await page.keyboard.up(KEYS[n % len(KEYS)])
    trace = await browser.stop_tracing()
    profile = (await session.send("Profiler.stop"))["profile"]
    after = await metrics(session)
    return {name: after[name] - before[name] for name in after}, profile, trace


async def measure(seconds: float) -> list[Figure]:
    from tests.support.browsers.chromium import CHROMIUM, FLAGS
    from tests.support.browsers.fake_robot_page import FakeRobotPage

    with FakeRobotPage() as site:
        async with async_playwright() as playwright:
            browser = await playwright.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
            page = await (
                await browser.new_context(viewport={"width": 1280, "height": 800})
            ).new_page()
            await page.add_init_script(WATCH)
            await page.goto(f"{site.url}?go=1")
            await page.wait_for_selector(PLAYING)
            spent, profile, trace = await drive(browser, page, seconds)
            long_tasks = await page.evaluate("longTasks")
            await page.close()
            await browser.close()
    return figures(spent, profile, long_tasks, longest_task(trace))


def figures(
    spent: dict[str, float], profile: dict[str, Any], long_tasks: list[float], longest: float
) -> list[Figure]:
    shown, script = shares(profile)
    drawn = spent["ScriptDuration"] * (shown / script if script else 0.0)
    wall = (profile["endTime"] - profile["startTime"]) / 1e6
    layout = spent["LayoutDuration"] + spent["RecalcStyleDuration"]
    return [
        Figure("long tasks (> 50 ms) a minute", 60 * len(long_tasks) / wall, "", 0.0),
        Figure("longest task above 50 ms", max(long_tasks, default=0.0), "ms"),
        Figure("longest task of the main thread, of its own CPU", longest, "ms", 50.0),
        Figure("HUD, overlay and map, script and layout", 100 * (drawn + layout) / wall, "%", 5.0),
        Figure("of it styles and layout", 100 * layout / wall, "%"),
        Figure("all script of the page", 100 * spent["ScriptDuration"] / wall, "%"),
        Figure("main thread busy", 100 * spent["TaskDuration"] / wall, "%"),
        Figure("script that is sent at once, compressed", script_bytes() / 1000, "kB", 168.5),
    ]


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=60.0)
    seconds = parser.parse_args().seconds
    django.setup()
    return keep("cockpit", asyncio.run(measure(seconds)), seconds=seconds)


if __name__ == "__main__":
    sys.exit(main())
