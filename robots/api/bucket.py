"""A token bucket, which limits the rate of a sender. Pure; `now` in monotonic seconds."""

from dataclasses import dataclass


@dataclass
class Bucket:
    """Allows `rate` messages a second on average, and `burst` at once."""

    rate: float
    burst: float
    level: float = -1.0
    at: float = 0.0

    def spend(self, now: float) -> bool:
        """Take a token for one message; False when none is left."""
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
