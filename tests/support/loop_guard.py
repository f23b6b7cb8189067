"""Names what keeps an event loop waiting, instead of waiting with it.

A control loop that somebody blocks runs nothing any more, and no time-out of its own either. An
interval timer of the system does: its signal arrives in the main thread, where tests run their
loops, also in the middle of `time.sleep`, of a socket's `recv` or of a lock.
"""

import asyncio
import contextlib
import signal
import time
import traceback
from collections.abc import Iterator

import pytest

LONGEST = 8.0  # s: no computer is so busy for so long
LOOK = 0.25  # s between two looks

ADVICE = (
    "Nothing that an adapter does on the control loop may wait: have blocking calls made by"
    " asyncio.to_thread, or by a thread of your own (docs/howto/write-an-adapter.md)."
)


class LoopGuard:
    """Looks, at each signal, whether the running loop has done since what it was asked to do."""

    def __init__(self, longest: float) -> None:
        self._longest = longest
        self._loop: asyncio.AbstractEventLoop | None = None
        self._asked_at: float | None = None

    def look(self, _number: int, frame: object) -> None:
        try:
            loop = asyncio.get_running_loop()
        except RuntimeError:
            self._loop, self._asked_at = None, None
            return
        now = time.monotonic()
        if loop is not self._loop or self._asked_at is None:
            self._loop, self._asked_at = loop, now
            loop.call_soon_threadsafe(self._done)
        elif now - self._asked_at > self._longest:
            self._asked_at = None
            where = "".join(traceback.format_stack(frame, limit=4))
            pytest.fail(
                f"the adapter blocks the control loop: for {self._longest:g} s it has been in\n"
                f"{where}{ADVICE}"
            )

    def _done(self) -> None:
        self._asked_at = None


@contextlib.contextmanager
def guarded(longest: float = LONGEST) -> Iterator[None]:
    """Fail, with the place, when a loop of the main thread is kept waiting for so many seconds."""
    before = signal.signal(signal.SIGALRM, LoopGuard(longest).look)
    signal.setitimer(signal.ITIMER_REAL, LOOK, LOOK)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)
