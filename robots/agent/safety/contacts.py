"""Contacts, and the motions that they forbid until the robot has backed away. Pure.

A contact is on one of four sides. Ahead it forbids to drive on, behind to reverse; beside the robot
it forbids to turn, which would swing a corner in, but not to drive along. Between contacts ahead
and behind the robot may creep, so that it can always leave.
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
    """Return the side of a direction, in quarters about ahead (0 rad), left, behind and right."""
    return SIDES[round(bearing / (math.pi / 2.0)) % 4]


def sides_of(bearings: Iterable[float]) -> frozenset[Side]:
    return frozenset(map(side_of, bearings))


class Contacts:
    """For each side that was touched, the metres that the robot still has to move away."""

    def __init__(self) -> None:
        self._left: dict[Side, float] = {}

    def __bool__(self) -> bool:
        return bool(self._left)

    @property
    def sides(self) -> tuple[Side, ...]:
        """The sides that were touched and not yet left."""
        return tuple(side for side in SIDES if side in self._left)

    def felt(self, sides: Iterable[Side]) -> None:
        """Take contacts that are measured now."""
        for side in sides:
            self._left[side] = BACKED_AWAY

    def moved(self, metres: float) -> None:
        """Take how far the robot has driven ahead; negative is back."""
        away = {"ahead": -metres, "behind": metres, "left": abs(metres), "right": abs(metres)}
        self._left = {
            side: left - max(0.0, away[side])
            for side, left in self._left.items()
            if left > max(0.0, away[side])
        }

    def clamp(self, velocity: Velocity) -> Velocity:
        """Return the velocity without motion towards a contact."""
        low = 0.0 if "behind" in self._left else -math.inf
        high = 0.0 if "ahead" in self._left else math.inf
        if low == high == 0.0:
            low, high = -CREEP, CREEP
        turn = 0.0 if BESIDE & self._left.keys() else velocity.angular
        return Velocity(linear=min(max(velocity.linear, low), high), angular=turn)
