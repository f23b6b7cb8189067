"""The frames that wait to be sent to one page: bounded, so that a slow page affects no other.

When too much telemetry waits, the oldest is dropped. Signals, events and notices are kept in order;
a page that has let hundreds of them pile up has stopped reading, and its connection is closed. At
most one picture waits: a newer one replaces it.
"""

import asyncio
import collections
import contextlib
import time
from typing import Any

DROPPABLE, KEPT = 64, 512


class SendQueue:
    """Frames for one page, oldest first. `dropped` counts telemetry and pictures."""

    def __init__(self, droppable: int = DROPPABLE, kept: int = KEPT) -> None:
        self._limits = droppable, kept
        self._telemetry: collections.deque[tuple[int, float, str]] = collections.deque()
        self._kept: collections.deque[tuple[int, float, str]] = collections.deque()
        self._picture: collections.deque[tuple[int, float, bytes]] = collections.deque(maxlen=1)
        self._number = 0
        self.taken_from = 0.0  # when the last taken frame was added, monotonic seconds
        self._filled, self._emptied = asyncio.Event(), asyncio.Event()
        self.dropped = 0

    def __len__(self) -> int:
        return len(self._telemetry) + len(self._kept) + len(self._picture)

    def put(self, frame: str, *, droppable: bool) -> bool:
        """Add a frame; False when there is no room for a kept one: the connection must end."""
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
        """Add a picture; it replaces one that still waits."""
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
        """Wait at most `seconds` until all frames are sent and the next is awaited."""
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(seconds):
                await self._emptied.wait()
