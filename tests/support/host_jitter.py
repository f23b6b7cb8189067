"""How late this computer schedules a thread, by which a test's time limit may be exceeded.

A thread sleeps again and again, and notes how much too late it wakes up. On an idle computer a
safety bound is tested as it is, on a busy one with that allowance.
"""

import contextlib
import threading
import time
from collections.abc import Iterable, Iterator
from itertools import pairwise

STEP = 0.005
AROUND = 0.1  # s before and after that count as well
KEPT = 60.0


class HostJitter:
    """Times are those of `time.time`."""

    def __init__(self) -> None:
        self._late: list[tuple[float, float]] = []
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._watch, daemon=True)

    def excuse(self, since: float, until: float) -> float:
        """Return the seconds by which a bound may be exceeded between two moments. Page, agent and
        base may each be late.
        """
        near = [
            late
            for at, late in list(self._late)
            if at >= since - AROUND and at - late <= until + AROUND
        ]
        return 3.0 * max(near, default=0.0)

    def _watch(self) -> None:
        while not self._over.is_set():
            before = time.monotonic()
            time.sleep(STEP)
            late = time.monotonic() - before - STEP
            if late > STEP:
                now = time.time()
                recent = [(at, value) for at, value in self._late if now - at < KEPT]
                self._late = [*recent, (now, late)]


def pauses(stamps: Iterable[float], usual: float) -> float:
    """Return the seconds for which another process did not run: the gaps between its stamps, beyond
    the usual distance.
    """
    return sum(max(0.0, after - before - usual) for before, after in pairwise(stamps))


@contextlib.contextmanager
def watched() -> Iterator[HostJitter]:
    jitter = HostJitter()
    jitter._thread.start()
    try:
        yield jitter
    finally:
        jitter._over.set()
        jitter._thread.join()
