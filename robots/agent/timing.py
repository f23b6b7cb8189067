"""Time in the agent's loops: clocks that a test can turn, periods, and pauses before retries."""

import random
import time
from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True)
class TimeSource:
    """The two clocks of a computer.

    `now` never jumps and judges durations (s, monotonic); `unix` is what stamps say (s, Unix time).
    """

    now: Callable[[], float] = time.monotonic
    unix: Callable[[], float] = time.time


@dataclass
class Cadence:
    """Due every `period` seconds of the time that it is asked with, without drifting when late."""

    period: float
    _next: float = float("-inf")

    def due(self, now: float) -> bool:
        """Return True when another one is due, and count it as done."""
        if now < self._next:
            return False
        self._next = (
            self._next + self.period if now - self._next < self.period else now + self.period
        )
        return True


@dataclass
class Backoff:
    """How long to wait before the next try.

    Seconds from `first`, doubled each time up to `longest`, of which a random half is left off, so
    that a thousand robots are never in step.

    A connection that holds shorter than `settled` seconds counts as another failure: what is
    accepted and dropped at once must not be tried again at full speed.
    """

    rng: random.Random
    first: float = 0.2
    longest: float = 5.0
    settled: float = 10.0
    _next: float = 0.0

    def failed(self, held: float = 0.0) -> float:
        """Return seconds to wait after a connection that held for `held` seconds (0: none)."""
        base = self.first if held >= self.settled else max(self.first, self._next)
        self._next = min(self.longest, base * 2)
        return base * self.rng.uniform(0.5, 1.0)
