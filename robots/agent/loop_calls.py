"""Bounded calls to an event loop from other threads: a hanging loop must not fill the memory."""

import asyncio
import threading
from collections.abc import Callable
from typing import Any

import structlog

log = structlog.stdlib.get_logger(__name__)

MOST_CALLS = 1000
MOST_FRAMES = 60  # of video and sound: late ones are useless


class LoopCalls:
    """The calls that wait for one loop; `loop` is None before it runs and after it has ended."""

    def __init__(self, name: str) -> None:
        self.loop: asyncio.AbstractEventLoop | None = None
        self._name = name
        self._lock = threading.Lock()
        self._waiting = self._dropped = 0

    def post(self, call: Callable[..., None], *arguments: Any, most: float = MOST_CALLS) -> None:
        """Have the loop call this; dropped without a loop, or when `most` calls wait already."""
        with self._lock:
            loop = self.loop
            if loop is None:
                return
            if self._waiting >= most:
                self._dropped += 1
                return
            self._waiting += 1
        try:
            loop.call_soon_threadsafe(self._call, call, arguments)
        except RuntimeError:
            log.debug("loop_closed", loop=self._name)

    def _call(self, call: Callable[..., None], arguments: tuple[Any, ...]) -> None:
        with self._lock:
            self._waiting -= 1
            dropped, self._dropped = self._dropped, 0
        if dropped:
            log.warning("loop_calls_dropped", loop=self._name, count=dropped)
        call(*arguments)
