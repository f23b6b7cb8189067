"""A bot at the controls: the drive page's WebSocket, with everything that a page sends by itself.
Images come through the server.

Heartbeats five times a second, the next image requested when the last one has arrived, velocities
ten times a second while the bot drives, zeros when it releases the controller, then nothing: as
static/js does it, without WebRTC.
"""

import asyncio
import contextlib
import math
import time
import uuid
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from typing import Any, Self

from websockets.asyncio.client import ClientConnection
from websockets.asyncio.server import broadcast
from websockets.exceptions import ConnectionClosed
from websockets.frames import CloseCode

from experiments.bots.browser import Browser
from experiments.bots.driver import STAND, SpeedSetting
from experiments.bots.view import View
from robots.api import messages
from robots.api.codec import encode_frame
from sessions import protocol

# Seconds between two of the page's messages, which a loop of ticks sends.
TICK = 0.1
BEAT = 0.2
NETWORK_PERIOD = 1.0
PICTURE_PERIOD = 0.25  # new enough for full speed, and little work for a computer with many bots
PICTURE_PATIENCE = 1.5  # until the next image is requested though the last has not arrived
ZEROS = 3  # velocities after the controller is released


@dataclass(eq=False)
class Cockpit:
    """One connection of a visitor's browser to a robot. Use with `async with`. `address` is the
    WebSocket's path, `method` the controller that is reported; `clock` gives Unix seconds.
    """

    browser: Browser
    address: str
    method: messages.InputMethod
    clock: Callable[[], float] = time.time
    view: View = field(default_factory=View)
    is_mute: bool = False  # the page sends nothing by itself, as behind a firewall
    closed: int | None = None  # the code with which the connection was closed
    _socket: ClientConnection | None = None
    _tasks: list[asyncio.Task[None]] = field(default_factory=list)
    _changed: asyncio.Event = field(default_factory=asyncio.Event)
    _seq: int = 0
    _beats: int = 0
    _zeros: int = 0
    _speed: SpeedSetting = STAND
    _sent_at: dict[str, float] = field(default_factory=dict)  # of messages with a period
    _has_reported_first_frame: bool = False

    async def __aenter__(self) -> Self:
        await self.connect()
        return self

    async def __aexit__(self, *_error: object) -> None:
        await self.close()

    async def connect(self) -> None:
        """Open the connection; errors as in browser.open_websocket."""
        self._socket, self.closed = await self.browser.websocket(self.address), None
        loops = (self._listen(self._socket), self._keep_sending())
        self._tasks = [asyncio.create_task(loop) for loop in loops]

    async def close(self) -> None:
        await self._end_tasks()
        if self._socket is not None:
            await self._socket.close(CloseCode.GOING_AWAY)

    @property
    def is_open(self) -> bool:
        return bool(self._tasks) and self.closed is None

    async def lose_network(self) -> None:
        """Drop the connection without a close frame."""
        await self._end_tasks()
        if self._socket is not None:
            self._socket.transport.abort()

    async def come_back(self) -> None:
        """Connect again as the same page, and continue its session; errors as in `connect`."""
        self.view.granted, self.view.awaiting_picture = False, False
        await self.connect()
        self._send("session/take", protocol.Take(session=self.view.session, peer=self.view.peer))

    async def _end_tasks(self) -> None:
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)
        self._tasks = []

    # --- what the visitor does --------------------------------------------------------------------

    def take(self, *, takeover: bool = False) -> None:
        """Request the robot; `takeover` moves the session of another page of the visitor here."""
        self.view.turn = False
        session = self.view.session if takeover else None
        self._send("session/take", protocol.Take(session=session, takeover=takeover))

    def leave(self) -> None:
        """End the session, or leave the queue."""
        self.steer(STAND)
        self._send("session/leave", protocol.Leave())

    def steer(self, speed: SpeedSetting) -> None:
        """Hold the controller like this from now on."""
        if speed.is_zero and not self._speed.is_zero:
            self._zeros = ZEROS
        self._speed = speed

    def stop(self) -> None:
        """Press the stop button, and release the controller."""
        self.steer(STAND)
        self._seq += 1
        stop = messages.Stop(action_id=uuid.uuid4().hex, stamp=self.clock(), seq=self._seq)
        self._send("command/action", stop)

    def photo(self) -> str:
        """Request a photo and return the action's id."""
        action = messages.Photo(action_id=uuid.uuid4().hex, stamp=self.clock())
        self._send("command/action", action)
        return action.action_id

    def note(self, kind: str, **data: str | float | bool | None) -> None:
        """Report an event of the page for the record."""
        self._send("page/event", protocol.PageEvent(stamp=self.clock(), type=kind, data=data))

    async def until(self, condition: Callable[[], Any], seconds: float) -> bool:
        """Wait until a condition holds, the time is over or the connection is closed; tell whether
        the condition holds.
        """
        deadline = self.clock() + seconds
        while not condition():
            left = deadline - self.clock()
            if left <= 0.0 or self.closed is not None:
                return bool(condition())
            self._changed.clear()
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(self._changed.wait(), min(left, 0.5))
        return True

    # --- what the page sends by itself ------------------------------------------------------------

    async def _listen(self, socket: ClientConnection) -> None:
        try:
            while True:
                self.view.take(await socket.recv(), self.clock())
                self._report_first_frame()
                self._changed.set()
        except ConnectionClosed:
            self.closed = socket.close_code or CloseCode.ABNORMAL_CLOSURE
            self._changed.set()

    def _report_first_frame(self) -> None:
        if self.view.granted and self.view.frames and not self._has_reported_first_frame:
            self._has_reported_first_frame = True
            self.note("layout", interface=self.view.interface, width=1280.0, height=800.0, bot=True)
            self.note("first_frame", way="server")

    async def _keep_sending(self) -> None:
        while True:
            now, view = self.clock(), self.view
            if view.granted and view.ended is None and not self.is_mute:
                # half a tick early, as each tick is a little late
                if self._is_due("command/heartbeat", now, BEAT - TICK / 2.0):
                    self._send("command/heartbeat", self._beat(now))
                if self._is_due("page/network", now, NETWORK_PERIOD):
                    self._send("page/network", self._network(now))
                patience = PICTURE_PATIENCE if view.awaiting_picture else PICTURE_PERIOD
                if self._is_due("command/picture", now, patience):
                    view.awaiting_picture = True
                    trip = view.round_trip
                    request = messages.PictureRequest(stamp=now, seen=view.frame, round_trip=trip)
                    self._send("command/picture", request)
                self._send_velocity(now)
            await asyncio.sleep(TICK)

    def _is_due(self, suffix: str, now: float, period: float) -> bool:
        """Tell whether a message with this period is due, and note that it is sent."""
        is_due = now - self._sent_at.get(suffix, -math.inf) >= period
        if is_due:
            self._sent_at[suffix] = now
        return is_due

    def _frame_age(self, now: float) -> float | None:
        return max(0.0, now - self.view.frame) if self.view.frame is not None else None

    def _network(self, now: float) -> protocol.PageNetwork:
        trip, age = self.view.round_trip, self._frame_age(now)
        return protocol.PageNetwork(
            stamp=now, way="mqtt", path="server/jpeg", round_trip=trip, frame_age=age
        )

    def _beat(self, now: float) -> messages.CommandHeartbeat:
        echo = None
        if self.view.beat is not None:
            number, stamp, received = self.view.beat
            echo = messages.Echo(peer="robot", n=number, stamp=stamp, received=received)
        self._beats += 1
        odd = 2 * self._beats + 1  # it is sent by the WebSocket
        age = self._frame_age(now)
        return messages.CommandHeartbeat(n=odd, stamp=now, echo=echo, frame_age=age)

    def _send_velocity(self, now: float) -> None:
        if self._speed.is_zero:
            if self._zeros == 0:
                return
            self._zeros -= 1
        self._seq += 1
        view, speed = self.view, asdict(self._speed)
        assert view.session is not None
        about: dict[str, Any] = {"session": view.session, "epoch": view.epoch, "frame": view.frame}
        command = messages.VelocityCommand(
            seq=self._seq, stamp=now, method=self.method, **about, **speed
        )
        self._send("command/velocity", command)

    def _send(self, suffix: str, message: messages.Message) -> None:
        """Send without waiting, as a page does; on a closed connection, the message is lost."""
        if self._socket is not None:
            broadcast([self._socket], encode_frame(suffix, message))
