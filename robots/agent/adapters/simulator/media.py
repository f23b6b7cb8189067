"""Camera and microphone of the simulated robot, each on a blocking connection of its own, read by
the media side's threads. Frames are in shared memory; only their numbers pass through the socket.
"""

import contextlib
import select
import socket
import threading
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from robots.agent.robot_interface import AdapterError, Frame
from robots.process import framing
from robots.simulator import wire
from robots.simulator.render.frame_ring import FrameReader

CONNECT_TIME = 2.0
CHUNK = 64 << 10

Address = tuple[str, int]


class MediaSocket:
    """A connection in one role; reads whole messages with a time-out."""

    def __init__(self, address: Address, role: wire.Role) -> None:
        """Connect and send the role; raises OSError."""
        self._socket = socket.create_connection(address, timeout=CONNECT_TIME)
        self._socket.sendall(framing.pack(wire.SimulatorHello(role)))
        self._buffer = bytearray()

    def read(self, timeout: float) -> Any:
        """Return the next message, or None without one in time. Raises OSError when the connection
        ends, WireError when the other side is no simulator.
        """
        while True:
            body = framing.take(self._buffer)
            if body is not None:
                return wire.unpack_answer(body)
            if not select.select([self._socket], [], [], max(timeout, 0.0))[0]:
                return None
            data = self._socket.recv(CHUNK)
            if not data:
                raise ConnectionResetError("the simulator closed the connection")
            self._buffer += data

    def close(self) -> None:
        """Disconnect; a read in another thread ends with OSError."""
        with contextlib.suppress(OSError):
            self._socket.shutdown(socket.SHUT_RDWR)
        self._socket.close()


class _Source:
    """Shared by camera and microphone: connect on read, disconnect on stop, one thread."""

    role: wire.Role

    def __init__(self, where: Callable[[], Address | None]) -> None:
        self._where = where
        self._lock = threading.Lock()
        self._running = threading.Event()
        self._line: MediaSocket | None = None

    def start(self) -> None:
        self._running.set()

    def stop(self) -> None:
        """Stop capturing; without viewers the simulator draws nothing."""
        self._running.clear()
        with self._lock:
            self._hang_up()

    def _hang_up(self) -> None:
        line, self._line = self._line, None
        if line is not None:
            line.close()

    def _next(self, timeout: float) -> Any:
        """Return the next message, None after `timeout`, holding the lock; raises AdapterError."""
        address = self._where()
        if address is None:  # the simulator is being started: the source is not at fault
            time.sleep(max(timeout, 0.0))
            return None
        try:
            if self._line is None:
                self._line = MediaSocket(address, self.role)
            message = self._line.read(timeout)
        except (OSError, ValueError, framing.WireError) as error:
            self._hang_up()
            why = getattr(error, "strerror", None) or error
            raise AdapterError(f"the connection to the {self.role} is lost: {why}") from error
        if isinstance(message, wire.RoleRefused):
            self._hang_up()
            raise AdapterError(f"the simulator refused the {self.role}: {message.reason}")
        return message


class SimulatorCamera(_Source):
    """See robot_interface.VideoSource."""

    role: wire.Role = "camera"

    def __init__(self, where: Callable[[], Address | None]) -> None:
        super().__init__(where)
        self._ring: FrameReader | None = None

    def read(self, timeout: float) -> Frame | None:
        """Return the newest unread frame; raises AdapterError, and tries again on the next read."""
        if not self._running.wait(timeout):
            return None
        with self._lock:
            if not self._running.is_set():
                return None
            newest = self._wait(time.monotonic() + timeout)
            while newest is not None and (message := self._next(0.0)) is not None:
                newest = self._take(message) or newest
            if newest is None or self._ring is None:
                return None
            image = self._ring.copy(newest.number)
            return None if image is None else Frame(image, newest.stamp, "yuv420p")

    def _wait(self, deadline: float) -> wire.FrameReady | None:
        while (message := self._next(deadline - time.monotonic())) is not None:
            ready = self._take(message)
            if ready is not None:
                return ready
        return None

    def _take(self, message: Any) -> wire.FrameReady | None:
        if isinstance(message, wire.FrameRingOffer):
            self._forget_ring()
            try:
                self._ring = FrameReader(message.name, message.width, message.height, message.slots)
            except OSError as error:
                self._hang_up()
                raise AdapterError(
                    f"the camera's shared memory cannot be opened: {error}"
                ) from error
        return message if isinstance(message, wire.FrameReady) else None

    def _hang_up(self) -> None:
        super()._hang_up()
        self._forget_ring()

    def _forget_ring(self) -> None:
        ring, self._ring = self._ring, None
        if ring is not None:
            ring.close()


class SimulatorMicrophone(_Source):
    """See robot_interface.AudioSource."""

    role: wire.Role = "microphone"

    def read(self, timeout: float) -> npt.NDArray[np.int16] | None:
        """Return the next 20 ms, (960,) int16; raises AdapterError, and tries again on the next
        read.
        """
        if not self._running.wait(timeout):
            return None
        with self._lock:
            if not self._running.is_set():
                return None
            deadline = time.monotonic() + timeout
            message = self._next(timeout)
            while isinstance(message, wire.SimulatorWelcome):
                message = self._next(deadline - time.monotonic())
            if not isinstance(message, wire.Sound):
                return None
            return np.frombuffer(message.samples, dtype=np.int16)
