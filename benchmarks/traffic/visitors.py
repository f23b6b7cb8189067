"""`python -m benchmarks.traffic.visitors`: visitors without browsers, many in one process, with the
traffic of drive pages whose WebRTC failed.

Each has its own WebSocket, authenticated by a session cookie. It takes the robot, sends velocities
20 times, heartbeats 5 times and its network once a second, and reads all messages. A page with a
data channel sends its velocities there, so this is the most load that a visitor causes. It receives
no video, and reports a frame as new as the robot's last message. After a lost connection it
reconnects as the same page; when its time is over, it leaves and requests the robot again.

They measure the delay of poses, states and heartbeats from the robot's stamp: all processes share
one clock.
"""

import asyncio
import random
import time
from array import array
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import msgspec
from websockets.asyncio.client import ClientConnection
from websockets.asyncio.server import broadcast
from websockets.exceptions import ConnectionClosed, WebSocketException

from benchmarks.traffic import worker
from benchmarks.traffic.every import Timers
from experiments.bots.browser import open_websocket
from robots.api import messages as m
from robots.api.codec import encode_frame
from sessions import protocol

VELOCITY, BEAT, NETWORK = 1 / 20, 1 / 5, 1.0
AGAIN = (0.2, 1.0)  # s until the next attempt, drawn between
OFF_SECONDS = 0.5  # between leaving and asking again


class RobotStamp(msgspec.Struct):
    """The fields that are read of a robot's message; `seq` is in states, `n` in heartbeats."""

    stamp: float
    seq: int = 0
    n: int = 0


@dataclass
class VisitorMeasurements:
    """The measurements of a process's visitors: seconds that poses and states took, and counts."""

    delays: array = field(default_factory=lambda: array("d"))
    counts: Counter[str] = field(default_factory=Counter)


class LightVisitor:
    """One visitor at one robot.

    Args:
        url: the WebSocket's address, as http://.
        cookie: of the session in which this visitor is signed in.
        stays: for how long it drives before it makes room for others, in seconds.
    """

    def __init__(
        self,
        url: str,
        cookie: str,
        stays: float,
        *,
        measured: VisitorMeasurements,
        timers: Timers,
        rng: random.Random,
    ) -> None:
        self._url, self._stays, self._measured, self._timers, self._rng = (
            url,
            stays,
            measured,
            timers,
            rng,
        )
        self._headers = {"Cookie": f"sessionid={cookie}", "Origin": url.partition("/ws/")[0]}
        self._decoder = msgspec.json.Decoder(RobotStamp)
        self._socket: ClientConnection | None = None
        self._session: str | None = None
        self._peer: str | None = None
        self._epoch = self._seq = self._beats = self._state = 0
        self._newest = 0.0
        self._echo: m.Echo | None = None
        self._leaves_at = float("inf")
        self._departed = False
        self.drives = False
        self.sessions: list[str] = []

    async def live(self) -> None:
        """Connect, and again whenever the connection is lost, for ever."""
        self._ring()
        while True:
            try:
                self._socket = await open_websocket(self._url, self._headers)
                self._say("session/take", protocol.Take(session=self._session, peer=self._peer))
                while True:
                    self._hear(await self._socket.recv())
            except (WebSocketException, OSError) as error:
                self._measured.counts[f"closed_{_code_of(error)}"] += 1
            self._socket, self.drives = None, False
            await asyncio.sleep(self._rng.uniform(*AGAIN))

    def _ring(self) -> None:
        rings: list[tuple[float, Callable[[], None]]] = [
            (VELOCITY, self._drive),
            (BEAT, self._beat),
            (NETWORK, self._tell_network),
        ]
        for period, act in rings:
            self._timers.every(period, self._rng.random(), act)

    # --- what it hears ----------------------------------------------------------------------------

    def _hear(self, frame: str | bytes) -> None:
        now = time.time()
        assert isinstance(frame, str)
        suffix, _, payload = frame.partition("\n")
        match suffix:
            case "pose" | "state" | "heartbeat":
                self._on_robot_message(self._decoder.decode(payload), now)
            case "session/granted":
                self._granted(msgspec.json.decode(payload, type=protocol.Granted))
            case "session/offered":
                self._ask()
            case "session/ended" | "session/refused":
                self._measured.counts[suffix] += 1
                self._over()
            case "denied":
                self._denied(msgspec.json.decode(payload, type=protocol.Denied))

    def _on_robot_message(self, stamp: RobotStamp, now: float) -> None:
        self._measured.delays.append(now - stamp.stamp)
        self._newest = max(self._newest, stamp.stamp)
        if stamp.n:
            self._echo = m.Echo(peer="robot", n=stamp.n, stamp=stamp.stamp, received=now)
        if stamp.seq:
            self._measured.counts["states_missing"] += (
                max(0, stamp.seq - self._state - 1) if self._state else 0
            )
            self._state = stamp.seq

    def _granted(self, granted: protocol.Granted) -> None:
        self._measured.counts["resumed" if granted.resumed else "granted"] += 1
        if granted.session != self._session:
            self._leaves_at = time.monotonic() + self._stays
            self.sessions.append(granted.session)
            self._seq = 0
        if (granted.session, granted.epoch) != (self._session, self._epoch):
            self._seq = 0
        self._session, self._epoch, self._peer, self.drives = (
            granted.session,
            granted.epoch,
            granted.peer,
            True,
        )

    def _over(self) -> None:
        self._session = self._peer = None
        self.drives, self._leaves_at = False, float("inf")
        asyncio.get_running_loop().call_later(OFF_SECONDS + self._rng.random(), self._ask)

    def _ask(self) -> None:
        if not self._departed:
            self._say("session/take", protocol.Take())

    def _denied(self, denied: protocol.Denied) -> None:
        """Ask again, as a page does that gets no answer, for what the server could not do just
        then.
        """
        self._measured.counts[f"denied_{denied.reason}"] += 1
        again = {"session/take": self._ask, "session/leave": self.leave}.get(denied.suffix)
        if denied.reason == "unavailable" and again is not None:
            asyncio.get_running_loop().call_later(self._rng.uniform(*AGAIN), again)

    # --- what it says -----------------------------------------------------------------------------

    def _drive(self) -> None:
        if not self.drives or self._session is None:
            return
        if time.monotonic() > self._leaves_at:
            self.leave()
            return
        self._seq += 1
        self._measured.counts["commands"] += 1
        linear = 0.35 if self._seq % 40 < 20 else 0.2
        self._say(
            "command/velocity",
            m.VelocityCommand(
                session=self._session,
                epoch=self._epoch,
                seq=self._seq,
                stamp=time.time(),
                linear=linear,
                angular=0.1,
                method="keyboard",
                frame=self._newest or None,
            ),
        )

    def depart(self) -> None:
        self._departed = True
        self.leave()

    def leave(self) -> None:
        self.drives = False
        self._say("session/leave", protocol.Leave())

    def _beat(self) -> None:
        if self.drives:
            self._beats += 1
            self._say(
                "command/heartbeat",
                m.CommandHeartbeat(n=self._beats, stamp=time.time(), echo=self._echo),
            )

    def _tell_network(self) -> None:
        if self.drives:
            self._say(
                "page/network",
                protocol.PageNetwork(
                    stamp=time.time(), way="mqtt", round_trip=0.01, path="server/jpeg"
                ),
            )

    def _say(self, suffix: str, message: m.Message) -> None:
        if self._socket is not None:
            broadcast([self._socket], encode_frame(suffix, message))  # without waiting, as a page


def _code_of(error: Exception) -> int | str:
    if not isinstance(error, ConnectionClosed):
        return "unreachable"
    return error.rcvd.code if error.rcvd is not None else 1006


class Visitors:
    """The benchmark's requests to this process; see worker.py."""

    def __init__(self) -> None:
        self._measured, self._timers, self._rng = VisitorMeasurements(), Timers(), random.Random(2)
        self._visitors: list[LightVisitor] = []
        self._living: set[asyncio.Task[None]] = set()

    def add(self, visitors: list[list[str]], stays: float) -> int:
        """Let visitors come, given as [address of the WebSocket, cookie]; returns how many there
        are.
        """
        for url, cookie in visitors:
            self._visitors.append(
                LightVisitor(
                    url, cookie, stays, measured=self._measured, timers=self._timers, rng=self._rng
                )
            )
            self._living.add(asyncio.create_task(self._visitors[-1].live()))
        return len(self._visitors)

    def driving(self) -> int:
        return sum(visitor.drives for visitor in self._visitors)

    def leave(self) -> None:
        for task in self._living:
            task.cancel()
        for visitor in self._visitors:
            visitor.depart()

    def measured(self) -> dict[str, Any]:
        found = {
            "delays": list(self._measured.delays),
            "counts": dict(self._measured.counts),
            "late": list(self._timers.late),
        }
        del self._measured.delays[:], self._timers.late[:]
        self._measured.counts.clear()
        return found


if __name__ == "__main__":
    worker.serve(Visitors)
