"""A driver whose angular velocity grows by a step every 50 ms, and so tells its age."""

import time

STEP = 0.05  # s
# rad/s a step: three digits behind the point are enough for OpenMORA to tell two steps apart
TURN = 0.0005
FIRST = -0.25
LINEAR = 0.12
OLD = 0.3
TOGETHER = 0.1  # s


class DatedOrders:
    """Good for fifty seconds; ages are exact to two steps and the clocks."""

    def __init__(self, began=None):
        self.began = time.monotonic() if began is None else began

    def now(self):
        """Return the order of this moment, linear and angular."""
        return LINEAR, FIRST + TURN * int((time.monotonic() - self.began) / STEP)

    def age(self, at, linear, angular):
        """Return how old an order was that reached the robot at a monotonic time; None for one that
        does not move or was not at full speed.
        """
        if abs(linear - LINEAR) > 1e-3:
            return None
        return at - self.began - (round((angular - FIRST) / TURN) + 1) * STEP


def caught_at_most_one(old, commands):
    """Tell whether at most one order was obeyed late, at the given times, together with a zero.

    An architecture that hangs between its answer and reading the order that this answer released
    gets that order late; without a clock at the other end that cannot be avoided
    (velocity_gate.py).
    """
    return len(old) <= 1 and all(
        any(
            at <= then < at + TOGETHER and linear == angular == 0.0
            for then, linear, angular in commands
        )
        for at in old
    )
