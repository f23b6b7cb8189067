"""Something that is due every so often, without drifting when it is late."""

from dataclasses import dataclass


@dataclass
class Cadence:
    """Due every `period` seconds of the time that it is asked with."""

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
