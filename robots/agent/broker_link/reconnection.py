"""When an agent that lost its broker reconnects: pure.

Exponential back-off with full jitter (Brooker, "Exponential Backoff And Jitter", AWS Architecture
Blog, 2015): each pause is drawn between zero and a bound that doubles. The first one counts most:
after a broker has restarted, all robots lose it in the same second. Robots that are not in use are
spread over SPREAD.first, so that the few that are driven, which try at once, find it free.
"""

import random
from dataclasses import dataclass

from robots.agent.timing import Backoff


@dataclass(frozen=True)
class SpreadParams:
    """Bounds of the pauses of a robot that is not in use, in seconds; with one failed attempt well
    below the minute in which all robots must be online again.
    """

    first: float = 10.0
    longest: float = 20.0
    settled: float = 10.0  # a shorter connection counts as another failure
    # that a robot counts as in use after its last use: a disconnected one cannot learn of a new one
    needed_for: float = 120.0


SPREAD = SpreadParams()


class Reconnection:
    """The pauses of one robot; `rng` spreads many. `now` is monotonic seconds."""

    def __init__(self, rng: random.Random, params: SpreadParams = SPREAD) -> None:
        self._rng, self._params = rng, params
        # much shorter than a lease, which a restart of the broker must not end
        self._at_once = Backoff(rng, longest=1.0)
        self._bound = params.first
        self._needed_at = float("-inf")

    def needed(self, now: float) -> None:
        self._needed_at = now

    def pause(self, held: float, now: float) -> float:
        """Return seconds to wait after a connection that held for `held` seconds (0: none)."""
        params, soon = self._params, self._at_once.failed(held)
        bound = params.first if held >= params.settled else self._bound
        self._bound = min(params.longest, 2.0 * bound)
        if now - self._needed_at < params.needed_for:
            return soon
        return self._rng.uniform(0.0, bound)
