"""The delay from the key to the wheels over both transports, and from the last command to the stop,
with one driver in Chromium and no simulated part.

A key press has the browser's own stamp of the event. A command reaches the robot at its stamp plus
the age that the safety kernel found; all processes share one clock here, and the error of its
estimate (half a round trip) is far below the figures.
"""

import argparse
import random
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from playwright.sync_api import Browser, sync_playwright

from benchmarks.table import CAMERA_FPS, keep, quantiles
from tests.support.agents.truth import Onlooker
from tests.support.browsers.visitor import Visitor, chromium
from tests.support.sessions.site import Site, running_site, wait_for

PRESSES = 60
STOPS = 40
TRANSPORTS = {"datachannel": 5.0, "mqtt": 10.0}
HOOKS = """
  window.presses = []; window.muffled = false; window.deaf = %s;
  addEventListener('keydown', (e) => {
    if (!e.repeat) window.presses.push((performance.timeOrigin + e.timeStamp) / 1000);
  }, true);
  const { WebSocket: Socket, RTCPeerConnection: Connection } = window;
  const muffle = (thing, dumb) => {
    const send = thing.send.bind(thing);
    thing.send = (data) => {
      if (!dumb() && !(window.muffled && String(data).startsWith('command/'))) send(data);
    };
    return thing;
  };
  window.WebSocket = class extends Socket {
    constructor(...a) { super(...a); muffle(this, () => false); }
  };
  window.RTCPeerConnection = class extends Connection {
    createDataChannel(...a) { return muffle(super.createDataChannel(...a), () => window.deaf); }
  };
"""


def driver(browser: Browser, site: Site, transport: str) -> Visitor:
    """Return a driver whose commands use this transport: without a working data channel the page
    sends them through the server.
    """
    someone = Visitor(browser, site, f"by-{transport}")
    someone.context.add_init_script(HOOKS % ("true" if transport == "mqtt" else "false"))
    someone.page = someone.new_page()
    someone.drive()
    wait_for(lambda: someone.page_data("transport") == transport, 20, f"the transport {transport}")
    return someone


def applied(site: Site) -> Iterator[dict[str, Any]]:
    for state in site.states(site.sessions()[-1][0]):
        yield from state.get("applied", [])


def key_latencies(site: Site, someone: Visitor, transport: str, rng: random.Random) -> list[float]:
    """Return milliseconds from each press to the first command of it that reached the wheels."""
    for number in range(PRESSES):
        key = "ArrowLeft" if number % 2 else "ArrowRight"
        someone.page.keyboard.down(key)
        someone.page.wait_for_timeout(120 + 100 * rng.random())
        someone.page.keyboard.up(key)
        someone.page.wait_for_timeout(900 + 100 * rng.random())
    presses = someone.page.evaluate("window.presses")
    wait_for(
        lambda: site.states(site.sessions()[-1][0])[-1]["stamp"] > presses[-1] + 2, 20, "the record"
    )
    arrivals = [
        command["stamp"] + command["age"]
        for command in applied(site)
        if command["way"] == transport and command["stamp"] > 0
    ]
    return [1000 * (min(at for at in arrivals if at > press - 0.002) - press) for press in presses]


def stop_delays(site: Site, giraff: Onlooker, someone: Visitor) -> list[float]:
    """Return milliseconds from the last accepted command to the first velocity that brakes, for
    commands that cease without a word.
    """
    found = []
    for number in range(STOPS):
        someone.page.keyboard.down("ArrowLeft" if number % 2 else "ArrowRight")
        wait_for(lambda: _steady(giraff), 10, "a steady turn")
        someone.page.evaluate("window.muffled = true")
        wait_for(lambda: abs(giraff.truth().angular) < 1e-3, 5, "a standing robot")
        rows = giraff.history(5)
        someone.page.keyboard.up("ArrowLeft" if number % 2 else "ArrowRight")
        speed = max(abs(row.commanded_angular) for row in rows)
        brake = rows[
            max(i for i, row in enumerate(rows) if abs(row.commanded_angular) > 0.98 * speed) + 1
        ].stamp
        wait_for(
            lambda brake=brake: any(
                s["stamp"] > brake + 0.3 for s in site.states(site.sessions()[-1][0])
            ),
            10,
            "the record",
        )
        found.append(
            1000
            * (
                brake
                - max(
                    c["stamp"] + c["age"]
                    for c in applied(site)
                    if c["stamp"] + c["age"] < brake + 0.01
                )
            )
        )
        someone.page.evaluate("window.muffled = false")
        time.sleep(1.2)
    return found


def _steady(giraff: Onlooker) -> bool:
    speeds = [abs(row.commanded_angular) for row in giraff.history(0.3)]
    return len(speeds) > 15 and min(speeds) > 0.1 and max(speeds) - min(speeds) < 1e-3


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--assist",
        choices=["off", "slow", "steer"],
        default="steer",
        help="how much the driver is helped meanwhile",
    )
    level = parser.parse_args().assist
    rng = random.Random(7)
    figures, samples = [], {}
    with (
        tempfile.TemporaryDirectory(prefix="telepresence-control-") as folder,
        running_site(Path(folder)) as site,
    ):
        site.django(
            "from robots.models import Robot; robot = Robot.objects.get(name='giraff');"
            f" robot.assist = {level!r}; robot.save()"
        )
        giraff = site.start_robot("giraff", "--start", "lounge-centre", "--fps", str(CAMERA_FPS))
        with sync_playwright() as playwright, chromium(playwright) as browser:
            for transport, bound in TRANSPORTS.items():
                someone = driver(browser, site, transport)
                wait_for(
                    lambda: any(
                        state.get("assist", "off") == level
                        for state in site.states(site.sessions()[-1][0])[-1:]
                    ),
                    20,
                    f"assistance {level}",
                )
                samples[transport] = key_latencies(site, someone, transport, rng)
                figures += quantiles(
                    f"key press to applied velocity, {transport}",
                    samples[transport],
                    "ms",
                    p50=bound,
                    p95=None,
                    max=None,
                )
                if transport == "datachannel":
                    samples["stop"] = stop_delays(site, giraff, someone)
                someone.close()
    figures += quantiles(
        "last accepted command to stop", samples["stop"], "ms", p50=None, p99=350, max=None
    )
    return keep("control", figures, camera_fps=CAMERA_FPS, assist=level, **samples)


if __name__ == "__main__":
    sys.exit(main())
