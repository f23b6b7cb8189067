"""What waits to be sent to one page: bounded, so that a slow page costs itself and nobody else.

Telemetry is worth only as much as it is new: when too much waits, the oldest goes. Signals, events
and news of the session are kept and stay in order; a page that lets hundreds of them pile up has
stopped reading, and its connection is ended. Of pictures one waits at most: a newer one takes its
place.
"""

import asyncio
import collections
import contextlib
import time
from typing import Any

DROPPABLE, KEPT = 64, 512


class SendQueue:
    """Frames for one page, oldest first. `dropped` counts telemetry that was too old to send."""

    def __init__(self, droppable: int = DROPPABLE, kept: int = KEPT) -> None:
        self._limits = droppable, kept
        self._telemetry: collections.deque[tuple[int, float, str]] = collections.deque()
        self._kept: collections.deque[tuple[int, float, str]] = collections.deque()
        self._picture: collections.deque[tuple[int, float, bytes]] = collections.deque(maxlen=1)
        self._number = 0
        self.taken_from = 0.0  # when the frame that was taken last was put in (monotonic)
        self._filled, self._emptied = asyncio.Event(), asyncio.Event()
        self.dropped = 0

    def __len__(self) -> int:
        return len(self._telemetry) + len(self._kept) + len(self._picture)

    def put(self, frame: str, *, droppable: bool) -> bool:
        """Add a frame; False when a kept one finds no room, which is the end of this page's
        connection.
        """
        queue, limit = (
            (self._telemetry, self._limits[0]) if droppable else (self._kept, self._limits[1])
        )
        if len(queue) >= limit:
            if not droppable:
                return False
            queue.popleft()
            self.dropped += 1
        queue.append((self._next(), time.monotonic(), frame))
        return True

    def put_picture(self, frame: bytes) -> None:
        """Add a picture instead of the one that still waits."""
        self.dropped += len(self._picture)
        self._picture.append((self._next(), time.monotonic(), frame))

    def _next(self) -> int:
        self._number += 1
        self._filled.set()
        self._emptied.clear()
        return self._number

    async def take(self) -> str | bytes:
        """Wait for the next frame."""
        while not self:
            self._filled.clear()
            self._emptied.set()
            await self._filled.wait()
        queues: tuple[collections.deque[Any], ...] = (self._telemetry, self._kept, self._picture)
        first = min((queue for queue in queues if queue), key=lambda queue: queue[0][0])
        _, self.taken_from, taken = first.popleft()
        frame: str | bytes = taken
        return frame

    async def wait_empty(self, seconds: float) -> None:
        """Wait until somebody has taken everything and asks for more, at most `seconds`."""
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(seconds):
                await self._emptied.wait()
