"""The replay of ten minutes: 2,400 states, 9,600 commands, 600 network samples, 200 events, from
navigation to drawn.

The same page without a record is opened in the same run: what it takes is the computer's and the
browser's, whatever the record. Poses between the states (some 9,000 in ten minutes) are not stored:
the page interpolates them, sixty times a second while it plays.
"""

import contextlib
import sys
import tempfile
import time
import urllib.request
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from playwright.sync_api import sync_playwright

from benchmarks.table import Figure, keep, quantiles
from tests.support.browsers.visitor import Visitor, chromium
from tests.support.sessions.site import APPLICATION, DAPHNE, LOOPBACK, Site, wait_for

LOADS = 12
SECONDS, COMMANDS, EVENTS = 600, 4, 200
DRAWN = "performance.getEntriesByName('replay:drawn').map((mark) => mark.startTime / 1000)"
MAKE = f"""
from accounts.models import User
from tests.support.sessions import replays
User.objects.update(is_superuser=True, is_staff=True)
robot, ada, ben = replays.cabin_robot("cabin"), User(username="ada"), User(username="ben")
ada.save(), ben.save()
recorded = dict(seconds={SECONDS}, closed_at=replays.GRANTED)
visit = replays.session(robot, ada, **recorded)
replays.record(visit, seconds={SECONDS}, applied={COMMANDS})
participant = replays.participant(replays.study(), ada)
drive = replays.drive(participant, visit, settled_at=replays.GRANTED)
for n in range({EVENTS} // 2):
    replays.told(visit, n * 6.0, "collision", detail="front")
    replays.task_told(drive, n * 6.0 + 1.0, "cue", name="go_to_checkpoint", number=1)
bare = replays.session(robot, ben, **recorded)
print(visit.pk, bare.pk)
"""


def open_times(visitor: Visitor, address: str) -> list[float]:
    """Return seconds from navigation to drawn, a load each; the first is that of a browser that has
    nothing yet.
    """
    found = []
    for _ in range(LOADS):
        visitor.page.goto(address)
        found += wait_for(lambda: visitor.page.evaluate(DRAWN), 30, "a drawn replay")[:1]
        visitor.page.goto("about:blank")
    return found


def answer(site: Site, cookie: str, address: str) -> tuple[float, int]:
    """Return the seconds in which the server answers with the record, and the bytes that travel."""
    headers = {"Cookie": f"sessionid={cookie}", "Accept-Encoding": "gzip"}
    began = time.perf_counter()
    with urllib.request.urlopen(
        urllib.request.Request(site.url + address, headers=headers), timeout=20
    ) as response:
        size = len(response.read())
    return time.perf_counter() - began, size


@contextlib.contextmanager
def web_alone(var: Path) -> Iterator[Site]:
    """A site with a web server and nothing else: a replay needs neither broker
    nor session manager.
    """
    site = Site(var)
    try:
        site.prepare()
        site.start("web", [*DAPHNE, "-b", LOOPBACK, "-p", str(site.web_port), APPLICATION])
        wait_for(lambda: site.listening(site.web_port), 30, "the web server")
        yield site
    finally:
        site.stop_all()


def main() -> int:
    with (
        tempfile.TemporaryDirectory(prefix="telepresence-replay-") as folder,
        web_alone(Path(folder)) as site,
        sync_playwright() as playwright,
    ):
        cookie = site.sign_in("owner")
        session, bare = site.django(f"exec({MAKE!r})").split()
        answer(site, cookie, f"/studies/replay/{session}/")  # the server has loaded what it needs
        with chromium(playwright) as browser:
            visitor = Visitor(browser, site, "owner")
            times = open_times(visitor, f"/studies/replay/{session}/")
            empty = open_times(visitor, f"/studies/replay/{bare}/")
            visitor.close()
        answers = [answer(site, cookie, f"/studies/replay/{session}.json") for _ in range(LOADS)]
    figures = [Figure("from navigation to drawn, first load", times[0], "s", 1.0)]
    figures += quantiles("from navigation to drawn, later loads", times[1:], "s", p50=None, p95=1.0)
    figures += quantiles("the same page without a record", empty, "s", p50=None, p95=None)
    figures.append(
        Figure(
            "so many times as long as without a record, p50",
            float(np.median(times[1:]) / np.median(empty)),
            "",
        )
    )
    figures += quantiles(
        "the record from the server", [seconds for seconds, _ in answers], "s", p50=None, p95=None
    )
    figures.append(Figure("the record, compressed", answers[0][1] / 1000, "kB"))
    return keep("replay", figures, opened=times)


if __name__ == "__main__":
    sys.exit(main())
