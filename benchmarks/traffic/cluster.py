"""A drive in a browser over a whole cluster, while each of its engines is killed in turn: three
machines, each a network namespace with etcd, PostgreSQL under Patroni, a NATS node, a session
manager and a web process, as in docs/howto/run-a-cluster.md.

The table shows how long the robot stopped, and the texts of the page during that time. Screenshots
are in benchmarks/results/cluster: `NAME-away.png` while an engine is down, `NAME-back.png` when the
robot turns again and the page shows no fault. `CLUSTER_PARTS` selects the engines; `partition` cuts
the first machine off from the other two. `CLUSTER_KEEP=1` kills nothing, prints how to reach the
site and its processes, and keeps them running. Needs root.
"""

import contextlib
import json
import os
import re
import secrets
import signal
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from itertools import pairwise
from pathlib import Path

from playwright.sync_api import sync_playwright

from benchmarks.table import CAMERA_FPS, RESULTS, conditions
from benchmarks.traffic.places import RunningSite, running_place
from tests.support.agents.truth import Onlooker
from tests.support.browsers.visitor import Visitor, chromium
from tests.support.patience import patient

ROBOT = "giraff"
SIMULATOR = ("--start", "lab-centre", "--fps", str(CAMERA_FPS))
AWAY = 15.0  # s for which an engine is away: longer than a lease
RECOVERY = 60.0
PRESSED = 1.0  # s after which the key is pressed again, as people do
TURNS, STANDS = 0.2, 0.05  # rad/s
SEED = """
from robots.models import Robot
from telepresence_site.demo.seed import seed
seed({url!r})
Robot.objects.update(returns_home=False, shown_to_visitors=True)
"""
PASSWORD = """
from accounts.models import User
ana, _ = User.objects.get_or_create(username="ana")
ana.set_password({password!r})
ana.save()
"""
SHOWN_TEXT = """
["#alert", "#card-title", "#status-text"].map((name) => document.querySelector(name)).filter(
  (element) => element.checkVisibility() && element.textContent.trim(),
).map((element) => element.textContent.trim())
"""


@dataclass(frozen=True)
class EngineLoss:
    """An engine that was away: for how many seconds the robot stood, and what the page shown, each
    with the seconds since the loss.
    """

    part: str
    stood: float
    shown: list[tuple[float, str]]


@dataclass
class ClusterDrive:
    """A visitor who turns a robot on the spot, and an onlooker at the robot."""

    place: RunningSite
    visitor: Visitor
    onlooker: Onlooker
    folder: Path

    def lose(self, part: str) -> EngineLoss:
        """Kill an engine or cut a cable, bring it back, and wait until the robot turns again and
        the page has no complaint.
        """
        self._turn_until(self._is_well, RECOVERY)
        lost, shown = time.monotonic(), []
        stamp = self.onlooker.history(1.0)[-1].stamp
        self.place.kill(part)
        self._turn_until(lambda: time.monotonic() > lost + AWAY, AWAY, shown, lost)
        self.visitor.screenshot(self.folder / f"{part}-away.png")
        self.place.start(part)
        self._turn_until(self._is_well, RECOVERY, shown, lost)
        self.visitor.screenshot(self.folder / f"{part}-back.png")
        return EngineLoss(part, self._stood(stamp, time.monotonic() - lost), shown)

    def _is_well(self) -> bool:
        return self.onlooker.history(0.5)[-1].angular > TURNS and not self.visitor.page.evaluate(
            "document.querySelector('#alert').checkVisibility()"
        )

    def _turn_until(
        self,
        reached: Callable[[], bool],
        within: float,
        shown: list[tuple[float, str]] | None = None,
        since: float = 0.0,
    ) -> None:
        page, pressed, deadline = self.visitor.page, 0.0, time.monotonic() + patient(within)
        while not reached():
            if time.monotonic() > deadline:
                raise RuntimeError(f"not well after {within} s: {page.evaluate(SHOWN_TEXT)}")
            if time.monotonic() > pressed + PRESSED:
                page.keyboard.up("ArrowLeft")
                page.keyboard.down("ArrowLeft")
                pressed = time.monotonic()
            for text in page.evaluate(SHOWN_TEXT):
                sentence = re.sub(r"\d+", "…", text)  # a countdown is one sentence
                if shown is not None and sentence not in [known for _, known in shown]:
                    shown.append((round(time.monotonic() - since, 1), sentence))
            page.wait_for_timeout(100)

    def _stood(self, stamp: float, seconds: float) -> float:
        rows = [row for row in self.onlooker.history(seconds + 1.0) if row.stamp >= stamp]
        moved = [row.stamp for row in rows if abs(row.angular) > STANDS]
        return max((later - earlier for earlier, later in pairwise(moved)), default=seconds)


def main() -> int:
    folder = RESULTS / "cluster"
    folder.mkdir(parents=True, exist_ok=True)
    print(f"{conditions(CAMERA_FPS)}; starting three machines takes a minute or two …", flush=True)
    with (
        tempfile.TemporaryDirectory(prefix="telepresence-cluster-") as made,
        running_place("machines", Path(made)) as place,
        sync_playwright() as playwright,
        chromium(playwright) as browser,
    ):
        place.site.django(SEED.format(url=place.site.mqtt_url))
        place.site.write_users()
        place.site.cluster.reload()
        if os.environ.get("CLUSTER_KEEP"):
            place.site.start_robot(ROBOT, *SIMULATOR)
            _keep(place)
            return 0
        onlooker = place.site.start_robot(ROBOT, *SIMULATOR)
        visitor = Visitor(browser, place.site, "ana", url=f"http://{place.webs['web-0']}")
        visitor.drive(ROBOT)
        drive = ClusterDrive(place, visitor, onlooker, folder)
        chosen = [part for part in os.environ.get("CLUSTER_PARTS", "").split(",") if part]
        losses = []
        for part in chosen or parts_of(place):
            print(f"{part:18} is lost …", flush=True)
            loss = drive.lose(part)
            print(f"{part:18} the robot stood for {loss.stood:5.1f} s")
            print(*(f"{at:24.1f} s  {text}" for at, text in loss.shown), sep="\n", flush=True)
            losses.append(loss)
        visitor.close()
    (RESULTS / "cluster.json").write_text(json.dumps([asdict(loss) for loss in losses], indent=1))
    return 0


def _keep(place: RunningSite) -> None:
    """Print how to reach a running site, and wait for Ctrl-C."""
    password = secrets.token_urlsafe(9)
    place.site.django(PASSWORD.format(password=password))
    print(f"The site's pages, for ana with the password {password}:")
    print(*(f"  http://{address}/" for address in place.webs.values()), sep="\n")
    print("They are in a network of their own. What reaches them:")
    print(f"  nsenter --target {os.getpid()} --net COMMAND")
    print("Processes to kill:")
    print(*(f"  {name:18} {pid}" for name, pid in place.processes.items()), sep="\n")
    print("Ctrl-C ends everything.", flush=True)
    with contextlib.suppress(KeyboardInterrupt):
        signal.pause()


def parts_of(place: RunningSite) -> list[str]:
    return [name for name in place.processes if not name.startswith(ROBOT)] + list(place.cables)


if __name__ == "__main__":
    sys.exit(main())
