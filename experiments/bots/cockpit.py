"""A bot at the wheel: the drive page's WebSocket, with everything that a page sends of itself.
Pictures come through the server.

Heartbeats five times a second, a picture asked for as soon as the one before has come, velocities
ten times a second while it drives, zeros when it lets go, and silence: as static/js does it,
without WebRTC.
"""

import asyncio
import contextlib
import time
import uuid
from collections.abc import Callable
from typing import Any, Self

from experiments.bots.browser import Browser
from experiments.bots.socket import Socket, SocketClosed
from experiments.bots.steering import STAND, SpeedSetting
from experiments.bots.view import View
from robots.api.codec import encode_frame
from robots.api.messages import (
    CommandHeartbeat,
    Echo,
    InputMethod,
    Message,
    Photo,
    PictureRequest,
    Stop,
    VelocityCommand,
)
from sessions import protocol

BEAT = 0.2
TICK = 0.1
ZEROS = 3
# seconds between two pictures: fresh enough for full speed, and easy on a computer that has many
# bots
PICTURE_PERIOD = 0.25
PICTURE_PATIENCE = 1.5
NETWORK_PERIOD = 1.0


class Cockpit:
    """One connection to a robot. Use with `async with`.

    Args:
        browser: whose visitor this is.
        address: the WebSocket's path, as the page's configuration says.
        method: the controller that is said to be used.
        clock: Unix seconds.
    """

    def __init__(
        self,
        browser: Browser,
        address: str,
        method: InputMethod,
        clock: Callable[[], float] = time.time,
    ) -> None:
        self._browser, self._address, self._method, self._clock = browser, address, method, clock
        self.view = View()
        # nothing that the page says of itself arrives: no heartbeat, no question for pictures
        self.is_mute = False
        self.closed: int | None = None
        self._socket: Socket | None = None
        self._tasks: list[asyncio.Task[None]] = []
        self._changed = asyncio.Event()
        self._seq = 0
        self._beats = 0
        self._zeros = 0
        self._speed = STAND
        self._asked_at = float("-inf")
        self._told_first_frame = False

    async def __aenter__(self) -> Self:
        await self.connect()
        return self

    async def __aexit__(self, *_error: object) -> None:
        await self.close()

    async def connect(self) -> None:
        """Open the connection.

        Raises:
            SocketClosed: the server does not want it.
            OSError: it cannot be reached.
        """
        self._socket = await Socket.connect(
            self._browser.site + self._address, self._browser.headers
        )
        self.closed = None
        self._tasks = [
            asyncio.create_task(work())
            for work in (self._listen, self._keep_beating, self._keep_moving)
        ]

    async def close(self) -> None:
        """Close the page."""
        await self._end_tasks()
        if self._socket is not None:
            await self._socket.close()

    @property
    def is_open(self) -> bool:
        """Tell whether the page is there and has its connection."""
        return bool(self._tasks) and self.closed is None

    async def lose_network(self) -> None:
        """Be gone without a word."""
        await self._end_tasks()
        if self._socket is not None:
            self._socket.abort()

    async def come_back(self) -> None:
        """Open the connection again, as the same page, and go on where the visit stands.

        Raises:
            SocketClosed: as `connect`.
            OSError: as `connect`.
        """
        session, peer = self.view.session, self.view.peer
        self.view.granted, self.view.awaiting_picture = False, False
        await self.connect()
        self._say("session/take", protocol.Take(session=session, peer=peer))

    async def _end_tasks(self) -> None:
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)
        self._tasks = []

    # --- what the visitor does --------------------------------------------------------------------

    def take(self, *, takeover: bool = False) -> None:
        """Ask for the robot; `takeover` brings a visit here that another page of
        the visitor has.
        """
        self.view.turn = False
        self._say(
            "session/take",
            protocol.Take(session=self.view.session if takeover else None, takeover=takeover),
        )

    def leave(self) -> None:
        """Say that one is done."""
        self.steer(STAND)
        self._say("session/leave", protocol.Leave())

    def steer(self, speed: SpeedSetting) -> None:
        """Hold the controller like this from now on."""
        if speed.is_zero and not self._speed.is_zero:
            self._zeros = ZEROS
        self._speed = speed

    def stop(self) -> None:
        """Press the stop button, and let go of the controller."""
        self.steer(STAND)
        self._seq += 1
        self._say(
            "command/action", Stop(action_id=uuid.uuid4().hex, stamp=self._clock(), seq=self._seq)
        )

    def photo(self) -> str:
        """Ask for a photo and return the action's id."""
        action = Photo(action_id=uuid.uuid4().hex, stamp=self._clock())
        self._say("command/action", action)
        return action.action_id

    def note(self, kind: str, **data: str | float | bool | None) -> None:
        """Tell the record what happened on the page."""
        self._say("page/event", protocol.PageEvent(stamp=self._clock(), type=kind, data=data))

    async def until(self, condition: Callable[[], Any], seconds: float) -> bool:
        """Wait until a condition holds or the time is over, whichever comes first; the end of the
        connection ends it too.
        """
        deadline = self._clock() + seconds
        while not condition():
            left = deadline - self._clock()
            if left <= 0.0 or self.closed is not None:
                return bool(condition())
            self._changed.clear()
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(self._changed.wait(), min(left, 0.5))
        return True

    # --- what the page does by itself -------------------------------------------------------------

    async def _listen(self) -> None:
        assert self._socket is not None
        try:
            while True:
                self.view.take(await self._socket.receive(), self._clock())
                self._tell_first_frame()
                self._changed.set()
        except SocketClosed as closed:
            self.closed = closed.code
            self._changed.set()

    def _tell_first_frame(self) -> None:
        if self.view.granted and self.view.frames and not self._told_first_frame:
            self._told_first_frame = True
            self.note("layout", interface=self.view.interface, width=1280.0, height=800.0, bot=True)
            self.note("first_frame", way="server")

    async def _keep_beating(self) -> None:
        measured = float("-inf")
        while True:
            now = self._clock()
            if self._is_driving:
                self._say("command/heartbeat", self._beat(now))
                if now - measured >= NETWORK_PERIOD:
                    measured = now
                    self._say("page/network", self._network(now))
            await asyncio.sleep(BEAT)

    @property
    def _is_driving(self) -> bool:
        return self.view.granted and self.view.ended is None and not self.is_mute

    def _beat(self, now: float) -> CommandHeartbeat:
        last = self.view.beats[-1] if self.view.beats else None
        echo = (
            Echo(peer="robot", n=last[0], stamp=last[1], received=last[2])
            if last is not None
            else None
        )
        age = max(0.0, now - self.view.frame) if self.view.frame is not None else None
        self._beats += 1
        # odd: it went by the WebSocket
        return CommandHeartbeat(n=2 * self._beats + 1, stamp=now, echo=echo, frame_age=age)

    def _network(self, now: float) -> protocol.PageNetwork:
        age = max(0.0, now - self.view.frame) if self.view.frame is not None else None
        return protocol.PageNetwork(
            stamp=now,
            way="mqtt",
            round_trip=self.view.round_trip,
            frame_age=age,
            path="server/jpeg",
        )

    async def _keep_moving(self) -> None:
        while True:
            now = self._clock()
            if self._is_driving:
                self._ask_for_picture(now)
                self._send_velocity(now)
            await asyncio.sleep(TICK)

    def _ask_for_picture(self, now: float) -> None:
        waited = now - self._asked_at
        if waited >= (PICTURE_PATIENCE if self.view.awaiting_picture else PICTURE_PERIOD):
            self._asked_at, self.view.awaiting_picture = now, True
            self._say(
                "command/picture",
                PictureRequest(stamp=now, seen=self.view.frame, round_trip=self.view.round_trip),
            )

    def _send_velocity(self, now: float) -> None:
        if self._speed.is_zero:
            if self._zeros == 0:
                return
            self._zeros -= 1
        self._seq += 1
        assert self.view.session is not None
        command = VelocityCommand(
            session=self.view.session,
            epoch=self.view.epoch,
            seq=self._seq,
            stamp=now,
            linear=self._speed.linear,
            angular=self._speed.angular,
            method=self._method,
            frame=self.view.frame,
        )
        self._say("command/velocity", command)

    def _say(self, suffix: str, message: Message) -> None:
        if self._socket is not None and self.closed is None:
            self._socket.send(encode_frame(suffix, message))
