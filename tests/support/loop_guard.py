"""Fails a test that blocks its event loop, with the place in the code.

A blocked loop cannot run a timeout of its own. The system's interval timer still works: its signal
arrives in the main thread, where tests run their loops, also during `time.sleep`, a socket's `recv`
or a lock.
"""

import asyncio
import contextlib
import signal
import time
import traceback
from collections.abc import Iterator

import pytest

LONGEST = 8.0  # s, longer than any computer is too busy to run the loop
LOOK = 0.25  # s between two checks

ADVICE = (
    "An adapter must not block the control loop: make blocking calls with"
    " asyncio.to_thread, or by a thread of your own (docs/howto/write-an-adapter.md)."
)


class LoopGuard:
    """Checks at each signal whether the loop has run the callback of an earlier one."""

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
    """Fail the test if a loop of the main thread is blocked for longer than this, in seconds."""
    before = signal.signal(signal.SIGALRM, LoopGuard(longest).look)
    signal.setitimer(signal.ITIMER_REAL, LOOK, LOOK)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)
