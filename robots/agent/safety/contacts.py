"""What the robot has touched, and which motions that forbids until it has backed away. Pure.

A contact is on one of four sides. Ahead it forbids to drive on, behind to go back; beside the robot
it forbids to turn, which would swing a corner in. Whoever may not turn may drive along, and whoever
may not drive on may go back and turn. Between a contact ahead and one behind the robot may creep,
so that there is a way out of any of them.
"""

import math
from collections.abc import Iterable
from typing import Literal

from robots.api.messages import Velocity

Side = Literal["ahead", "left", "behind", "right"]
SIDES: tuple[Side, ...] = ("ahead", "left", "behind", "right")
BESIDE: frozenset[Side] = frozenset({"left", "right"})
BACKED_AWAY = 0.05  # m
CREEP = 0.05  # m/s


def side_of(bearing: float) -> Side:
    """Return on which side of the robot a direction lies, in quarters about ahead (0 rad), left,
    behind and right.
    """
    return SIDES[round(bearing / (math.pi / 2.0)) % 4]


def sides_of(bearings: Iterable[float]) -> frozenset[Side]:
    """Return the sides of several directions, in radians."""
    return frozenset(map(side_of, bearings))


class Contacts:
    """For each side that was touched, how many metres the robot has to go away from it still."""

    def __init__(self) -> None:
        self._left: dict[Side, float] = {}

    def __bool__(self) -> bool:
        return bool(self._left)

    @property
    def sides(self) -> tuple[Side, ...]:
        """Return what was touched and not left yet."""
        return tuple(side for side in SIDES if side in self._left)

    def felt(self, sides: Iterable[Side]) -> None:
        """Take that something is touched now, there."""
        for side in sides:
            self._left[side] = BACKED_AWAY

    def moved(self, metres: float) -> None:
        """Take that the robot has driven so far ahead, or back where that is negative."""
        away = {"ahead": -metres, "behind": metres, "left": abs(metres), "right": abs(metres)}
        self._left = {
            side: left - max(0.0, away[side])
            for side, left in self._left.items()
            if left > max(0.0, away[side])
        }

    def clamp(self, velocity: Velocity) -> Velocity:
        """Return the velocity without what goes further towards anything that was touched."""
        low = 0.0 if "behind" in self._left else -math.inf
        high = 0.0 if "ahead" in self._left else math.inf
        if low == high == 0.0:
            low, high = -CREEP, CREEP
        turn = 0.0 if BESIDE & self._left.keys() else velocity.angular
        return Velocity(linear=min(max(velocity.linear, low), high), angular=turn)
