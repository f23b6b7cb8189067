"""How fast one user may go on: a token bucket that may be overdrawn by the one thing that is being
done. Pure; `now` is monotonic seconds.
"""

import math


class TokenBucket:
    """Fills with `rate` tokens a second up to `size`; what costs more than is there is allowed, and
    paid for by waiting afterwards.
    """

    def __init__(self, rate: float, size: float, now: float) -> None:
        self._rate, self._size, self._level, self._at = rate, size, size, now

    def take(self, cost: float, now: float) -> None:
        """Pay for something."""
        if not math.isinf(self._rate):
            self._fill(now)
            self._level -= cost

    def wait(self, now: float, least: float = 1.0) -> float:
        """Return 0 while a token is there, and otherwise the seconds until there are `least`."""
        if math.isinf(self._rate):
            return 0.0
        self._fill(now)
        return 0.0 if self._level >= 1.0 else (least - self._level) / self._rate

    def _fill(self, now: float) -> None:
        self._level = min(self._size, self._level + (now - self._at) * self._rate)
        self._at = now
