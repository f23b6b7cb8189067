"""A program that drives a robot, written from docs/reference/robot-api.md alone: WebSocket, JSON,
pictures through the server, no WebRTC.

It imports nothing of the project on purpose: a missing detail is a fault of the document. Times are
those of this process.
"""

import asyncio
import contextlib
import json
import random
import struct
import time
from collections import Counter

from websockets.asyncio.client import connect
from websockets.exceptions import WebSocketException

TICK, BEAT, HASTY_BEAT = 0.05, 0.2, 0.1
HASTY = 3.0  # s of frequent heartbeats after a grant, a new boot or a reconnection
PICTURE_AGAIN = 0.7
SILENCE = 3.0
FIRST_PAUSE, LONGEST_PAUSE = 0.25, 1.0
PICTURE = b"picture\n"


class DocumentClient:
    """Use with `async with`; turns on the spot at `angular` rad/s as soon as the robot is granted.

    `url` is the site's, `cookie` that of a logged-in session; `moved` is when the robot's states
    last showed a turn by our commands.
    """

    def __init__(self, url, cookie, robot="giraff", *, angular=0.4):
        self.url = f"{url.replace('http', 'ws', 1)}/ws/robots/{robot}/"
        self.headers = {"Cookie": f"sessionid={cookie}"}
        self.origin, self.angular = url, angular
        self.session = self.peer = self.boot = None
        self.epoch = self.seq = self.beats = 0
        self.socket = self.echo = self.frame = self.state = None
        self.driving = self.online = False
        self.moved = self.last_received_at = 0.0
        self.hasty_until = self.asked_at = self.zero_until = 0.0
        self.state_seq = -1
        self.take_at = float("inf")
        self.received, self.denied = Counter(), Counter()
        self.faults, self.ended = [], None

    async def __aenter__(self):
        self._tasks = [asyncio.create_task(self._stay()), asyncio.create_task(self._tick())]
        return self

    async def __aexit__(self, *_error):
        if self.socket is not None:
            with contextlib.suppress(WebSocketException, OSError):
                await self._say("session/leave", {})
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)

    # --- the connection ---

    async def _stay(self):
        """Keep connecting: at once, then after pauses that double up to a second, each shortened at
        random.
        """
        pause = 0.0
        while True:
            await asyncio.sleep(pause * random.uniform(0.5, 1.0))
            try:
                async with connect(
                    self.url,
                    additional_headers=self.headers,
                    origin=self.origin,
                    open_timeout=2.0,
                    close_timeout=0.2,
                ) as socket:
                    pause = 0.0
                    await self._talk(socket)
            except (WebSocketException, OSError, TimeoutError):
                self.received["lost"] += 1
            self.socket = None
            pause = min(LONGEST_PAUSE, pause * 2) or FIRST_PAUSE

    async def _talk(self, socket):
        """Receive until the socket ends or is silent for too long: `server/status` arrives once a
        second.
        """
        self.socket, self.last_received_at = socket, time.time()
        await self._take()
        self._hurry()
        while True:
            async with asyncio.timeout(SILENCE):
                frame = await socket.recv()
            self.last_received_at = time.time()
            if isinstance(frame, bytes):
                await self._picture(frame)
            else:
                suffix, _, payload = frame.partition("\n")
                self.received[suffix] += 1
                await self._receive(suffix, json.loads(payload))

    async def _take(self):
        known = {"session": self.session, "peer": self.peer}
        self.take_at = float("inf")
        await self._say("session/take", {name: value for name, value in known.items() if value})

    async def _say(self, suffix, message):
        if self.socket is not None:
            await self.socket.send(f"{suffix}\n{json.dumps(message)}")

    # --- incoming ---

    async def _receive(self, suffix, message):
        now = time.time()
        if suffix == "session/granted":
            if (message["session"], message["epoch"]) != (self.session, self.epoch):
                self.seq = 0
            self.session, self.epoch = message["session"], message["epoch"]
            self.peer = message["peer"]
            self.driving = True
            self._hurry()
        elif suffix == "session/offered":
            await self._say("session/take", {"session": message["session"]})
        elif suffix in {"session/ended", "session/refused"}:
            self.ended, self.driving, self.session, self.peer = message, False, None, None
        elif suffix == "heartbeat":
            echoed = {"n": message["n"], "stamp": message["stamp"]}
            self.echo = {"peer": "robot", "received": now, **echoed}
        elif suffix == "state":
            self._state(message, now)
        elif suffix in {"hello", "robot"}:
            self.online = message["online"]
            self._hurry()
        elif suffix == "server/status":
            self.faults = message.get("faults", [])
        elif suffix == "denied":
            self.denied[f"{message['suffix']} {message['reason']}"] += 1
            if message["suffix"] == "session/take" and message["reason"] == "unavailable":
                self.take_at = now + 1.0

    def _state(self, state, now):
        if state["boot"] != self.boot:
            self.boot, self.state_seq = state["boot"], -1
            self._hurry()
        if state["seq"] <= self.state_seq:
            return
        self.state, self.state_seq = state, state["seq"]
        if (state.get("safety") or {}).get("inhibited") == "stopped":
            self.zero_until = now + 0.2
        if state.get("session") == self.session and any(
            command.get("angular") for command in state.get("applied", ())
        ):
            self.moved = now

    def _hurry(self):
        self.hasty_until, self.asked_at = time.time() + HASTY, 0.0

    async def _picture(self, frame):
        (self.frame,) = struct.unpack(">d", frame[len(PICTURE) : len(PICTURE) + 8])
        await self._ask()

    async def _ask(self):
        self.asked_at = time.time()
        seen = {"seen": self.frame} if self.frame else {}
        await self._say("command/picture", {"stamp": self.asked_at} | seen)

    # --- outgoing ---

    async def _tick(self):
        beat_at = 0.0
        while True:
            await asyncio.sleep(TICK)
            now = time.time()
            if self.socket is None:
                continue
            with contextlib.suppress(WebSocketException, OSError):
                if now >= self.take_at:
                    await self._take()
                if not self.driving:
                    continue
                if now - beat_at >= (HASTY_BEAT if now < self.hasty_until else BEAT) - TICK / 2:
                    beat_at, self.beats = now, self.beats + 1
                    echo = {"echo": self.echo} if self.echo else {}
                    await self._say("command/heartbeat", {"n": self.beats, "stamp": now} | echo)
                if now - self.asked_at >= PICTURE_AGAIN:
                    await self._ask()
                await self._say("command/velocity", self._velocity(now))

    def _velocity(self, now):
        self.seq += 1
        velocity = {"session": self.session, "epoch": self.epoch, "seq": self.seq, "stamp": now}
        angular = 0.0 if now < self.zero_until else self.angular
        velocity |= {"linear": 0.0, "angular": angular, "method": "keyboard"}
        return velocity | ({"frame": self.frame} if self.frame else {})

    # --- for tests ---

    async def until(self, condition, seconds, what):
        """Wait for a condition; an error says what was missing, and what was received instead."""
        deadline = time.monotonic() + seconds
        while not condition():
            why = (
                f"received {dict(self.received)}, faults {self.faults}, ended {self.ended}, denied"
                f" {dict(self.denied)}, refused {(self.state or {}).get('refused')}"
            )
            assert time.monotonic() < deadline, f"{what} did not come within {seconds} s: {why}"
            await asyncio.sleep(0.02)

    async def turns(self, seconds, since=None):
        """Wait until the robot has turned by a command after a moment."""
        since = time.time() if since is None else since
        await self.until(lambda: self.moved > since, seconds, "turning")
        return self.moved - since

    async def names(self, part, seconds):
        """Wait until the server reports a fault of a part, and return it."""
        found = lambda: [fault for fault in self.faults if fault["part"] == part]
        await self.until(found, seconds, f"the fault of {part}")
        return found()[0]
