"""When a robot moves for its visitor: one rule for live sessions, their records and studies.

It does when a velocity of its driver other than 0 is applied, and when it is under way to a place,
a point or its dock by itself, as its driver requested. Leaving the dock by itself does not count:
the page requests it at the beginning, also for a visitor who does nothing. Between sessions, states
belong to no visitor.
"""

from collections.abc import Sequence
from typing import Protocol

from robots.api.docked import DOCKED

BY_ITSELF = frozenset({"goto", "docking"})  # modes of a robot that drives by itself


class _Velocity(Protocol):
    """m/s and rad/s."""

    @property
    def linear(self) -> float: ...
    @property
    def angular(self) -> float: ...


class _State(Protocol):
    @property
    def seq(self) -> int: ...
    @property
    def mode(self) -> str: ...
    @property
    def docked(self) -> bool: ...
    @property
    def velocity(self) -> _Velocity: ...
    @property
    def applied(self) -> Sequence[_Velocity]: ...


class VisitorMotion:
    """Takes the states of a robot in order. The mode of a robot that leaves its dock is that of one
    that returns; only one that was seen away from the dock just before returns to it.
    """

    def __init__(self) -> None:
        self._last: _State | None = None
        self._returns = False

    def take(self, state: _State) -> bool:
        """Tell whether the robot moves for its visitor in this state."""
        before = self._last
        if before is not None and state.seq != before.seq + 1:
            before = None  # states are missing in between
        if state.mode != "docking":
            self._returns = False
        elif before is None or before.mode != "docking":
            self._returns = before is not None and not (before.docked or state.docked)
        self._last = state
        if any(command.linear or command.angular for command in state.applied):
            return True
        velocity = state.velocity
        is_moving = not DOCKED.is_at_rest(velocity.linear, velocity.angular)
        return is_moving and (state.mode == "goto" or self._returns)
