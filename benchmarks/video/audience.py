"""Large audiences: what a robot and Janus spend on many viewers, and the delay of the driver's
video beside them.

The robot's real media side, in a process of its own, sends to pages directly, and through the real
Janus. The pages are aiortc's up to the handshake; after it they only count the packets that arrive
(they decrypt and decode nothing), so that their computer lasts for many. Processor time is that of
the robot's and Janus' processes alone. Of one run, compare ratios: machines differ. Janus and its
viewers fill two cores with 200 of them, so larger audiences watch a robot that sends two pictures a
second and no sound. The driver watches directly, in Chromium, as `benchmarks media` does.

`python -m benchmarks.video.audience 1 8 50` measures other numbers, at full rate alone. Linux only,
for /proc.
"""

import asyncio
import functools
import os
import sys
import tempfile
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from aiortc import RTCPeerConnection
from playwright.async_api import Browser

from benchmarks.table import Figure, keep
from benchmarks.video.media import PEER, cpu_of_tree, delays_of, glass_to_glass, load
from benchmarks.video.media_robots import RobotProcess
from robots.api.messages import Bye, Candidate, SdpAnswer
from sessions.sfu.broadcast import Broadcast
from tests.support.browsers.browser_page import chromium
from tests.support.media.loopback_peer import Exchange
from tests.support.media.sfu_rig import SfuPage, SfuRig
from tests.support.patience import until
from tests.support.programs.janus import Janus

os.environ.setdefault("DJANGO_SETTINGS_MODULE", "tests.settings")
AUDIENCES, SLOW_AUDIENCES = (1, 8, 100), (1, 100, 500)
MEASURED_SECONDS = 8.0
CONNECT_SECONDS = 60.0
TOGETHER = 20
_RTP = range(128, 192)  # the first byte of RTP and RTCP (RFC 7983)


@dataclass(frozen=True)
class Spent:
    """Shares of a core, and packets a second that a viewer got: on average, and the one with the
    fewest.
    """

    robot: float
    janus: float
    packets: float
    fewest: float
    connections: int
    # ms, of the frames of the robot's driver, and at the same time of the driver of another robot
    # without viewers, for the load of the computer
    delays: tuple[float, ...] = ()
    unwatched: tuple[float, ...] = ()


class CountingPage(SfuPage):
    """A page that takes packets and does nothing with them; `count` is how many."""

    count = 0
    _counts = False

    def count_only(self) -> None:
        protocol = _protocol_of(self.connection)
        if protocol is None or self._counts:
            return
        self._counts = True
        original = protocol.datagram_received

        def take(data: bytes, address: Any) -> None:
            if data[0] in _RTP:
                self.count += 1
            else:
                original(data, address)

        protocol.datagram_received = take


def _protocol_of(connection: RTCPeerConnection | None) -> Any:
    if connection is None or connection.connectionState != "connected":
        return None
    (transport,) = connection._RTCPeerConnection__iceTransports  # type: ignore[attr-defined]
    return transport._connection._nominated[1].protocol


class CrowdedRig(SfuRig):
    """A rig whose robot also has a driver, connected directly; `driver` has the answers to it."""

    def __init__(self, janus: Janus, kind: str) -> None:
        self.driver = Exchange(asyncio.get_running_loop())
        super().__init__(janus, media=functools.partial(RobotProcess, kind))

    def reply(self, peer: str, message: SdpAnswer | Candidate | Bye) -> None:
        if peer == PEER:
            self.driver.reply(peer, message)
        else:
            super().reply(peer, message)


async def through_janus(
    audiences: tuple[int, ...], kind: str, watching: tuple[Browser, str] | None = None
) -> dict[int, Spent]:
    """Return what each audience costs a robot of this kind; a larger one is the smaller one and
    more. With a browser, the delay of its driver is measured beside each.
    """
    found: dict[int, Spent] = {}
    with tempfile.TemporaryDirectory() as folder, Janus(Path(folder) / "janus") as janus:
        async with CrowdedRig(janus, kind) as rig:
            broadcast = rig.broadcast()
            pages: list[CountingPage] = []
            for number in sorted(audiences):
                while len(pages) < number:
                    await _join(rig, broadcast, pages, min(TOGETHER, number - len(pages)))
                spent = await _measure(rig, janus, pages)
                if watching is not None:
                    delays = await delays_of(*watching, rig.media, rig.driver, role="driver")
                    others = await glass_to_glass(*watching, "ours", "delays")
                    spent = replace(spent, delays=tuple(delays), unwatched=tuple(others))
                print(kind, number, replace(spent, delays=(), unwatched=()), flush=True)
                found[number] = spent
    return found


async def _join(rig: SfuRig, broadcast: Broadcast, pages: list[CountingPage], number: int) -> None:
    """Let so many more pages watch; more together than a core can shake hands with lose their
    connection again.
    """
    more = [CountingPage(broadcast, f"page-{len(pages) + n}") for n in range(number)]
    pages += more
    rig.pages += more
    for page in more:
        page.want()
    await until(functools.partial(_all_count, more), CONNECT_SECONDS, f"{len(pages)} viewers")


def _all_count(pages: list[CountingPage]) -> bool:
    for page in pages:
        page.count_only()
    return all(page.count for page in pages)


async def _measure(rig: SfuRig, janus: Janus, pages: list[CountingPage]) -> Spent:
    loop = asyncio.get_running_loop()
    before = [page.count for page in pages]
    robot, sfu, began = cpu_of_tree(rig.media.pid), janus.cpu_seconds(), loop.time()
    await asyncio.sleep(MEASURED_SECONDS)
    seconds = loop.time() - began
    packets = [(page.count - count) / seconds for page, count in zip(pages, before, strict=True)]
    return Spent(
        robot=(cpu_of_tree(rig.media.pid) - robot) / seconds,
        janus=(janus.cpu_seconds() - sfu) / seconds,
        packets=sum(packets) / len(packets),
        fewest=min(packets),
        connections=rig.offers_to_robot(),
    )


def figures_of(sfu: dict[int, Spent], which: str = "") -> list[Figure]:
    """Return what each audience of one robot costs; `which` says which robot."""
    figures, least, most = [], min(sfu), max(sfu)
    for number, spent in sfu.items():
        figures += [
            Figure(f"{which}robot, {number} through Janus", 100 * spent.robot, "% of a core"),
            Figure(f"{which}Janus, {number} viewers", 100 * spent.janus, "% of a core"),
            Figure(f"{which}packets for each of {number} viewers", spent.packets, "/s"),
            Figure(f"{which}packets for the one of {number} with the fewest", spent.fewest, "/s"),
            Figure(
                f"{which}connections of the robot, {number} viewers", spent.connections, "", 1.0
            ),
        ]
        for delays, whose in ((spent.delays, "their"), (spent.unwatched, "another")):
            figures += [
                Figure(
                    f"delay beside {number} viewers, {whose} robot's driver, p{share}",
                    float(np.percentile(delays, share)),
                    "ms",
                )
                for share in (50, 95)
                if delays
            ]
    ratio = sfu[most].robot / sfu[least].robot
    figures += [
        Figure(f"{which}robot, {most} to {least} through Janus", ratio, "x"),
        Figure(
            f"{which}Janus, for each of {most} viewers", 100 * sfu[most].janus / most, "% of a core"
        ),
    ]
    return figures


async def measure(audiences: tuple[int, ...], slow: tuple[int, ...]) -> list[Figure]:
    direct = {number: await load("ours", number) for number in (1, 8)}
    async with chromium() as browser:
        found = figures_of(await through_janus(audiences, "ours", browser))
    if slow:
        found += figures_of(await through_janus(slow, "slow"), "two pictures a second: ")
    return [
        *(
            Figure(f"robot, {number} directly", 100 * share, "% of a core")
            for number, share in direct.items()
        ),
        Figure("robot, 8 directly to 1 directly", direct[8] / direct[1], "x"),
        *found,
    ]


if __name__ == "__main__":
    wanted = tuple(int(word) for word in sys.argv[1:])
    chosen = (wanted, ()) if wanted else (AUDIENCES, SLOW_AUDIENCES)
    sys.exit(keep("audience", asyncio.run(measure(*chosen))))
