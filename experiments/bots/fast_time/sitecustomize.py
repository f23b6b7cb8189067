"""Lets time pass faster in a whole system of Python processes: every wait is shorter, and every
clock ahead by the same.

Python imports a module of this name when it starts. A process whose PYTHONPATH begins with this
folder, and whose environment names a file of the pace, therefore has other clocks and waits before
anything else is loaded, and so have its children. All processes agree on the time because they read
the same few bytes, which experiments/bots/pace.py writes and may change at any time. Waits in C do
not change (time-outs of sockets and of SQLite, a broker in C): all of these are upper limits.
"""

import math
import mmap
import os
import selectors
import struct
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

VARIABLE = "TELEPRESENCE_FAST_TIME"  # the file of the pace
# Byte 0 says which of two slots is valid, so that no reader sees one half written. A slot: a moment
# of the computer's monotonic clock, the changed monotonic and Unix clocks then, and how many times
# faster they have been since.
SLOT = struct.Struct("=4d")
SLOTS = (8, 8 + SLOT.size)
SIZE = 8 + 2 * SLOT.size
MILLISECOND = 1e-3  # to which epoll rounds up, which is much at a high pace
BILLION = 1_000_000_000


class Clocks:
    """The clocks of a file; `real` and `real_sleep` are the computer's own."""

    def __init__(self, path: str) -> None:
        self.real, self.real_sleep = time.monotonic, time.sleep
        with Path(path).open("rb") as file:
            self._bytes = mmap.mmap(file.fileno(), SIZE, access=mmap.ACCESS_READ)

    def slot(self) -> tuple[float, float, float, float]:
        real, monotonic, unix, rate = SLOT.unpack_from(self._bytes, SLOTS[self._bytes[0]])
        return real, monotonic, unix, rate

    def monotonic(self) -> float:
        real, monotonic, _unix, rate = self.slot()
        return monotonic + (self.real() - real) * rate

    def unix(self) -> float:
        real, _monotonic, unix, rate = self.slot()
        return unix + (self.real() - real) * rate

    def shorter(self, seconds: float) -> float:
        return seconds / self.slot()[3]

    def sleep(self, seconds: float) -> None:
        self.real_sleep(self.shorter(seconds))


def install(clocks: Clocks) -> None:
    """Change this process's clocks and waits."""
    time.monotonic = time.perf_counter = clocks.monotonic
    changed: Any = time
    changed.time, changed.sleep = clocks.unix, clocks.sleep
    time.monotonic_ns = time.perf_counter_ns = lambda: int(clocks.monotonic() * BILLION)
    time.time_ns = lambda: int(clocks.unix() * BILLION)
    _threads(clocks)
    for kind in ("Select", "Poll", "Epoll", "Devpoll", "Kqueue"):
        if hasattr(selectors, f"{kind}Selector"):
            _selector(getattr(selectors, f"{kind}Selector"), clocks)
    _django(clocks.unix)


def _threads(clocks: Clocks) -> None:
    import queue

    def quick(wait: Callable[..., Any]) -> Callable[..., Any]:
        def quick_wait(self: Any, timeout: float | None = None) -> Any:
            return wait(self, None if timeout is None else clocks.shorter(timeout))

        return quick_wait

    changed: Any = threading
    changed.Condition.wait = quick(threading.Condition.wait)
    changed.Thread.join = quick(threading.Thread.join)
    changed._time = clocks.monotonic
    queued: Any = queue
    queued.time = clocks.monotonic


def _selector(kind: Any, clocks: Clocks) -> None:
    select = kind.select

    def quick_select(self: Any, timeout: float | None = None) -> Any:
        if timeout is None or timeout <= 0.0:
            return select(self, timeout)
        left = clocks.shorter(timeout)
        # never longer than requested: the caller reads the clock again
        if left >= MILLISECOND:
            return select(self, math.floor(left / MILLISECOND) * MILLISECOND)
        ready = select(self, 0)
        if not ready:
            clocks.real_sleep(left)
            ready = select(self, 0)
        return ready

    kind.select = quick_select


def _django(unix: Callable[[], float]) -> None:
    """Change Django's clock, which reads `datetime`: a class in C that cannot be changed."""
    try:
        from django.utils import timezone
    except ImportError:
        return
    from datetime import UTC, datetime

    timezone.now = lambda: datetime.fromtimestamp(unix(), UTC)


clocks: Clocks | None = None  # of this process, when it keeps a pace
if __name__ == "sitecustomize" and os.environ.get(VARIABLE):
    clocks = Clocks(os.environ[VARIABLE])
    install(clocks)
