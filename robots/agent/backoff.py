"""How long to wait before trying again: longer each time, and never in step with
a thousand others.
"""

import random
from dataclasses import dataclass


@dataclass
class Backoff:
    """Waits in seconds from `first`, doubled each time up to `longest`, of which a random half is
    left off.

    A connection that holds shorter than `settled` seconds counts as another failure: what is
    accepted and dropped at once must not be tried again at full speed.
    """

    rng: random.Random
    first: float = 0.2
    longest: float = 5.0
    settled: float = 10.0
    _next: float = 0.0

    def failed(self, held: float = 0.0) -> float:
        """Return how long to wait after a connection that held for `held` seconds (0: it never
        came).
        """
        base = self.first if held >= self.settled else max(self.first, self._next)
        self._next = min(self.longest, base * 2)
        return base * self.rng.uniform(0.5, 1.0)
