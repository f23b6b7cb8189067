"""Time in the agent's loops: clocks that a test can replace, periods, and pauses before retries."""

import random
import time
from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True)
class TimeSource:
    """Two clocks: `now` is monotonic seconds, for durations; `unix` is Unix time, for stamps."""

    now: Callable[[], float] = time.monotonic
    unix: Callable[[], float] = time.time


@dataclass
class Cadence:
    """Due every `period` seconds, without drifting when late."""

    period: float
    _next: float = float("-inf")

    def due(self, now: float) -> bool:
        """Return True when another one is due, and count it as done."""
        if now < self._next:
            return False
        is_late = now - self._next >= self.period
        self._next = (now if is_late else self._next) + self.period
        return True


@dataclass
class Backoff:
    """Pauses before retries: from `first` seconds, doubled up to `longest`, less a random half, so
    that a thousand robots are never in step. A connection that holds for less than `settled`
    seconds counts as another failure.
    """

    rng: random.Random
    first: float = 0.2
    longest: float = 5.0
    settled: float = 10.0
    _next: float = 0.0

    def failed(self, held: float = 0.0) -> float:
        """Return the seconds to wait after a connection that held for `held` seconds (0: none)."""
        base = self.first if held >= self.settled else max(self.first, self._next)
        self._next = min(self.longest, base * 2)
        return base * self.rng.uniform(0.5, 1.0)
