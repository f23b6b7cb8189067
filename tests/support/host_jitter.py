"""How late the computer itself is: what a bound in seconds may be missed by when others keep the
processor busy.

A thread sleeps for a moment over and over, and notes how much later than asked it woke up. A safety
bound is held against what the program does beyond that: on an idle computer the bound itself.
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
        """Return the seconds by which a bound may be missed between two moments: page, agent and
        base take part, and each may be late.
        """
        return 3.0 * max(
            (
                late
                for at, late in list(self._late)
                if at >= since - AROUND and at - late <= until + AROUND
            ),
            default=0.0,
        )

    def _watch(self) -> None:
        while not self._over.is_set():
            before = time.monotonic()
            time.sleep(STEP)
            late = time.monotonic() - before - STEP
            if late > STEP:
                now = time.time()
                self._late = [(at, value) for at, value in self._late if now - at < KEPT] + [
                    (now, late)
                ]


def pauses(stamps: Iterable[float], usual: float) -> float:
    """Return the seconds for which another process was kept waiting: what is missing between its
    stamps, `usual` apart at most.
    """
    return sum(max(0.0, after - before - usual) for before, after in pairwise(stamps))


@contextlib.contextmanager
def watched() -> Iterator[HostJitter]:
    """Watch the computer."""
    jitter = HostJitter()
    jitter._thread.start()
    try:
        yield jitter
    finally:
        jitter._over.set()
        jitter._thread.join()
