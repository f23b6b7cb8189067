"""Whether a robot's agent grows with each visit: its memory, threads and sockets over many short
ones.

A real agent with its simulated robot and camera, a Mosquitto, and one page after the other
(aiortc), each of which connects over WebRTC, drives, and leaves. The memory is that of the agent's
process alone (Pss of smaps_rollup). It grows at first, while caches, pools and the arenas of malloc
fill, and for ten minutes while it keeps its states: what counts is the slope of the second half of
the visits.

`--trace` also prints, by tracemalloc, where the memory that Python allocated between the first
quarter of the visits and their end is held; that slows the agent down.
"""

import argparse
import asyncio
import contextlib
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.table import Figure, keep
from robots.api import messages as m
from robots.api.codec import encode_frame
from tests.support.architectures.mqtt_ear import Ear
from tests.support.media.loopback_peer import LoopbackPage
from tests.support.paths import ROOT
from tests.support.programs.mosquitto import Mosquitto

PERIOD_S = 0.05  # between two velocities
SLOPE_BOUND = 2.0  # MB in a hundred visits
TRACED = """
import gc, signal, sys, tracemalloc
from robots.agent.agent import main

tracemalloc.start(6)
looks = []

def look(*_):
    gc.collect()
    looks.append(tracemalloc.take_snapshot())
    if len(looks) > 1:
        for grown in looks[-1].compare_to(looks[0], "traceback")[:15]:
            print(grown, *grown.traceback.format(), sep="\\n", flush=True)
    else:
        print("traced", flush=True)

signal.signal(signal.SIGUSR1, look)
sys.exit(main())
"""


class Signalling:
    """The way of the pages' offers to the agent and back, in place of the server: a media side and
    an exchange of `LoopbackPage`.
    """

    def __init__(self, ear: Ear) -> None:
        self._ear = ear

    def signal(self, peer: str, message: m.Signal) -> None:
        self._ear.say(f"signal/{peer}", message)

    def answers(self, peer: str) -> list[str]:
        return [
            reply.sdp
            for reply in self._ear.all(f"signal/{peer}/reply")
            if isinstance(reply, m.SdpAnswer)
        ]


class Visit:
    """One driver, from their lease until they leave."""

    def __init__(self, ear: Ear, number: int) -> None:
        self._ear, self._epoch, self._peer = ear, number, f"p{number}"
        self._page = LoopbackPage(Signalling(ear), Signalling(ear), self._peer, decode=False)  # type: ignore[arg-type]
        self._sent = self._beat = 0

    async def run(self, seconds: float) -> bool:
        """Connect, turn on the spot for so many seconds, and leave; return whether the page was
        shown something and the robot turned.
        """
        self._ear.say("lease", self._lease())
        await self._page.connect("driver")
        until_then = time.monotonic() + seconds
        while time.monotonic() < until_then:
            self._drive()
            await asyncio.sleep(PERIOD_S)
        self._ear.say("lease", None)
        self._ear.say(f"signal/{self._peer}", m.Bye())
        await self._page.close()
        turned = (abs(state.velocity.angular) for state in self._ear.all("state"))
        return bool(self._page.pictures) and max(turned) > 0.1

    def _lease(self) -> m.Lease:
        return m.Lease(
            session=f"s{self._epoch}",
            epoch=self._epoch,
            peer=self._peer,
            who="Ada",
            renewal=0,
            video="none",
            stamp=time.time(),
        )

    def _drive(self) -> None:
        beats = [message for suffix, message in self._page.messages if suffix == "heartbeat"]
        self._sent += 1
        if beats and beats[-1].n != self._beat:
            self._beat = beats[-1].n
            now = time.time()
            echo = m.Echo(peer="robot", n=self._beat, stamp=beats[-1].stamp, received=now)
            self._send(
                "command/heartbeat",
                m.CommandHeartbeat(n=self._sent, stamp=now, peer=self._peer, echo=echo),
            )
        self._send(
            "command/velocity",
            m.VelocityCommand(
                session=f"s{self._epoch}",
                epoch=self._epoch,
                seq=self._sent,
                stamp=time.time(),
                linear=0.0,
                angular=0.0 if self._sent < 10 else 0.5,
                method="script",
            ),
        )

    def _send(self, suffix: str, message: m.Message) -> None:
        self._page.channel.send(encode_frame(suffix, message))


def size_of(process: int) -> tuple[float, int, int]:
    """Return the memory of a process in MB, its threads, and its descriptors."""
    folder = Path(f"/proc/{process}")
    lines = (folder / "smaps_rollup").read_text().splitlines()
    pss = next(int(line.split()[1]) for line in lines if line.startswith("Pss:"))
    return (
        pss / 1024.0,
        len(list((folder / "task").iterdir())),
        len(list((folder / "fd").iterdir())),
    )


@contextlib.contextmanager
def running_agent(broker: Mosquitto, folder: Path, *, trace: bool) -> Iterator[int]:
    program = ["-c", TRACED] if trace else ["-m", "robots.agent"]
    arguments = ["giraff", "--mqtt", broker.url, "--var", str(folder / "var")]
    with (folder / "log").open("w") as log:
        agent = subprocess.Popen(
            [sys.executable, *program, *arguments], cwd=ROOT, stderr=log, env=os.environ
        )
        try:
            yield agent.pid
        finally:
            agent.terminate()
            agent.wait()


async def repeat_visits(
    ear: Ear, agent: int, given: Any
) -> tuple[list[tuple[float, int, int]], int]:
    """Make the visits, and return how large the agent was after each, and how many had a picture
    and a robot that turned.
    """
    sizes, whole = [], 0
    for number in range(1, given.visits + 1):
        with ear._news:
            ear.heard.clear()
        whole += await Visit(ear, number).run(given.seconds)
        await asyncio.sleep(given.pause)
        sizes.append(size_of(agent))
        if number % 10 == 0:
            print(number, "visits: {:.1f} MB, {} threads, {} descriptors".format(*sizes[-1]))
        if given.trace and number == given.visits // 4:
            os.kill(agent, signal.SIGUSR1)
    if given.trace:
        os.kill(agent, signal.SIGUSR1)
        await asyncio.sleep(20.0)
    return sizes, whole


def main() -> int:
    words = argparse.ArgumentParser(description=__doc__)
    words.add_argument("--visits", type=int, default=200)
    words.add_argument("--seconds", type=float, default=3.0, help="that each drives")
    words.add_argument("--pause", type=float, default=0.5, help="seconds between two visits")
    words.add_argument("--trace", action="store_true", help="print where memory is held")
    given = words.parse_args()
    with tempfile.TemporaryDirectory() as directory:
        folder = Path(directory)
        with (
            Mosquitto(folder) as broker,
            Ear(broker.port) as ear,
            running_agent(broker, folder, trace=given.trace) as agent,
        ):
            ear.wait("state", lambda s: s.safety.inhibited == "no_lease", within=60.0)
            before = size_of(agent)
            sizes, whole = asyncio.run(repeat_visits(ear, agent, given))
    half = np.array([megabytes for megabytes, *_ in sizes[len(sizes) // 2 :]])
    slope = float(np.polyfit(np.arange(len(half)), half, 1)[0])
    return keep(
        "visits",
        [
            Figure("visits without picture or motion", given.visits - whole, ""),
            Figure("before the first visit", before[0], "MB"),
            Figure("after the first", sizes[0][0], "MB"),
            Figure("after half of them", sizes[len(sizes) // 2][0], "MB"),
            Figure("after the last", sizes[-1][0], "MB"),
            Figure("growth of the second half, in 100 visits", 100.0 * slope, "MB", SLOPE_BOUND),
            Figure("more threads than after the first", sizes[-1][1] - sizes[0][1], "", 2),
            Figure("more descriptors than after the first", sizes[-1][2] - sizes[0][2], "", 2),
        ],
        visits=given.visits,
        seconds=given.seconds,
        sizes=sizes,
    )


if __name__ == "__main__":
    sys.exit(main())
