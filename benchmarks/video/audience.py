"""Large audiences: what a robot and Janus spend on many viewers.

The robot's real media side, in a process of its own, sends to pages directly, and through the real
Janus. The pages are aiortc's up to the handshake; after it they only count the packets that arrive
(they decrypt and decode nothing), so that their computer lasts for many. Processor time is that of
the robot's and Janus' processes alone. Of one run, compare ratios: machines differ. `python -m
benchmarks.video.audience 1 8 100 500` measures other numbers. Linux only, for /proc.
"""

import asyncio
import functools
import os
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from aiortc import RTCPeerConnection

from benchmarks.table import Figure, keep
from benchmarks.video.media import cpu_of_tree, load
from benchmarks.video.media_robots import RobotProcess
from tests.support.media.loopback_peer import until
from tests.support.media.sfu_rig import SfuPage, SfuRig
from tests.support.programs.janus import Janus

os.environ.setdefault("DJANGO_SETTINGS_MODULE", "tests.settings")
AUDIENCES = (1, 8, 100)
MEASURED_SECONDS = 8.0
CONNECT_SECONDS = 120.0
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


class CountingPage(SfuPage):
    """A page that takes packets and does nothing with them; `count` is how many."""

    count = 0
    _counts = False

    def count_only(self) -> None:
        """Decrypt nothing from now on."""
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


async def through_janus(audiences: tuple[int, ...]) -> dict[int, Spent]:
    """Return what each audience costs; a larger one is the smaller one and more."""
    found: dict[int, Spent] = {}
    with tempfile.TemporaryDirectory() as folder, Janus(Path(folder) / "janus") as janus:
        async with SfuRig(janus, media=lambda rig: RobotProcess("ours", rig)) as rig:
            broadcast, pages = rig.broadcast(), []
            for number in sorted(audiences):
                more = [CountingPage(broadcast, f"page-{n}") for n in range(len(pages), number)]
                pages += more
                rig.pages += more
                for page in more:
                    page.want()
                await until(
                    functools.partial(_all_count, pages), CONNECT_SECONDS, f"{number} viewers"
                )
                found[number] = await _measure(rig, janus, pages)
    return found


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


async def measure(audiences: tuple[int, ...]) -> list[Figure]:
    """Return all figures."""
    direct = {number: await load("ours", number) for number in (1, 8)}
    sfu = await through_janus(audiences)
    least, most = min(sfu), max(sfu)
    figures = [
        Figure(f"robot, {number} directly", 100 * share, "% of a core")
        for number, share in direct.items()
    ]
    for number, spent in sfu.items():
        figures += [
            Figure(f"robot, {number} through Janus", 100 * spent.robot, "% of a core"),
            Figure(f"Janus, {number} viewers", 100 * spent.janus, "% of a core"),
            Figure(f"packets for each of {number} viewers", spent.packets, "/s"),
            Figure(f"packets for the one of {number} with the fewest", spent.fewest, "/s"),
            Figure(f"connections of the robot, {number} viewers", spent.connections, "", 1.0),
        ]
    figures += [
        Figure(f"robot, {most} to {least} through Janus", sfu[most].robot / sfu[least].robot, "x"),
        Figure("robot, 8 directly to 1 directly", direct[8] / direct[1], "x"),
        Figure(f"Janus, for each of {most} viewers", 100 * sfu[most].janus / most, "% of a core"),
    ]
    return figures


if __name__ == "__main__":
    wanted = tuple(int(word) for word in sys.argv[1:]) or AUDIENCES
    sys.exit(keep("audience", asyncio.run(measure(wanted))))
