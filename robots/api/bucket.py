"""How much anybody may say: a token bucket, the same at both ends. Pure; `now` in monotonic
seconds.
"""

from dataclasses import dataclass


@dataclass
class Bucket:
    """Lets `rate` things a second through on average, and `burst` at once."""

    rate: float
    burst: float
    level: float = -1.0
    at: float = 0.0

    def spend(self, now: float) -> bool:
        """Take one thing through; False when there have been too many."""
        self.level = (
            self.burst
            if self.level < 0.0
            else min(self.burst, self.level + (now - self.at) * self.rate)
        )
        self.at = now
        if self.level < 1.0:
            return False
        self.level -= 1.0
        return True
