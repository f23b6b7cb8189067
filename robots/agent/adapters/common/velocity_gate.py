"""Whether a velocity may be sent to a robot now. Pure: times are given.

A sent velocity cannot be taken back. Socket buffers here and at the peer keep what a hung peer does
not read, and deliver it when the peer resumes; on Linux even a reset leaves the peer what has
arrived. Many robots obey a velocity however late it arrives. So nothing that moves is sent to a
peer that may not read it:

- A probe goes first (in each protocol's terms), and the velocity follows its answer. At most one
  probe is open. A hung peer finds only that probe and a zero in its buffer when it resumes.
- The robot behind the peer must report, too: each of its readings permits a few velocities, and an
  old reading none. An unchanged velocity waits for a new reading.
- A zero is always sent at once, and so is the zero that follows when the gate shuts.

One case remains: a peer that hangs between its answer and the velocity, a fraction of a millisecond
on one computer, gets that velocity late, and the zero behind it at once.
"""

import math
from dataclasses import dataclass

from robots.agent.ramp import ZERO
from robots.api.messages import Velocity


@dataclass(frozen=True)
class GateParams:
    """All in seconds, but for `orders`."""

    patience: float = 0.25  # for an answer; then the gate is shut until it arrives
    oldest: float = 0.25  # that a velocity may wait for an answer
    repeat: float = 0.08  # after which an unchanged velocity is due again, with the next reading
    at_latest: float = 0.25  # after which it is due without one
    freshest: float = 0.4  # that a reading counts, or twice the usual period
    longest: float = 1.0  # the longest that a reading counts
    orders: int = 3  # velocities that move, for each reading


class VelocityGate:
    """One connection's. `now` is monotonic time in seconds."""

    def __init__(self, params: GateParams, now: float) -> None:
        self._params = params
        self._last_received_at = now
        self._usual = 0.0
        self._left = params.orders
        self._asked_at: float | None = None
        self._wanted: tuple[Velocity, float] | None = None
        self._sent = ZERO
        self._sent_at = -math.inf

    @property
    def usual(self) -> float:
        """The smoothed time between two readings, in seconds."""
        return self._usual

    @property
    def sent(self) -> Velocity:
        return self._sent

    @property
    def moving(self) -> bool:
        return self._sent != ZERO

    def received(self, now: float) -> None:
        """Note a reading of the robot."""
        self._usual += 0.2 * (now - self._last_received_at - self._usual)
        self._last_received_at, self._left = now, self._params.orders

    def want(self, velocity: Velocity, now: float) -> None:
        self._wanted = velocity, now

    def stood(self, now: float) -> None:
        """Note that a zero was sent."""
        self._wanted, self._sent, self._sent_at = None, ZERO, now

    def ask(self, now: float) -> bool:
        """Return whether to send a probe now, and take it as sent."""
        if self._asked_at is not None or not self._due(now) or self.shut(now):
            return False
        self._asked_at = now
        return True

    def answered(self, now: float) -> Velocity | None:
        """Take the peer's answer; return the velocity to send, None when none is due any more."""
        late = self._asked_at is None or now - self._asked_at > self._params.patience
        self._asked_at = None
        if late or not self._due(now) or self.shut(now) or self._wanted is None:
            return None
        self._sent, self._sent_at = self._wanted[0], now
        self._left -= 1
        return self._sent

    def shut(self, now: float) -> str:
        """Return why no velocity is sent now, "" when the gate is open."""
        if self.unanswered(now) > self._params.patience:
            return "does not answer"
        fresh = max(self._params.freshest, 2.0 * self._usual)
        if now - self._last_received_at > min(fresh, self._params.longest):
            return "does not report its state"
        return ""

    def unanswered(self, now: float) -> float:
        return 0.0 if self._asked_at is None else now - self._asked_at

    def _due(self, now: float) -> bool:
        if self._wanted is None or now - self._wanted[1] > self._params.oldest or self._left < 1:
            return False
        if self._wanted[0] != self._sent:
            return True
        due = self._sent_at + self._params.repeat
        return self._last_received_at > due or now > self._sent_at + self._params.at_latest
