"""The way a robot believes to have gone, without gaps: jumps are taken out, and past moments can be
asked for.

A wheel counter that starts again at zero, or a base that was restarted, moves the odometry by
metres within a tick. Nothing was driven then: the track goes on from where it was and counts the
jump, so that the filter can open up a little.
"""

import math
from collections import deque
from dataclasses import dataclass, field

from robots.api.geometry import Pose2D, wrap_angle
from robots.world.sensing import CENTRE

KEPT = 200  # readings: 10 s at 20 Hz


@dataclass
class OdometryTrack:
    """Readings so far; a step is a jump when it is faster than `speed` m/s or `turning` rad/s,
    beyond a little that is always granted.
    """

    speed: float = 3.0
    turning: float = 6.0
    slack: float = 0.1
    jumps: int = 0
    _steady_from_odometry: Pose2D = CENTRE
    _past: deque[tuple[float, Pose2D]] = field(default_factory=lambda: deque(maxlen=KEPT))

    def add(self, stamp: float, odometry: Pose2D) -> Pose2D:
        """Take a reading and return it in the steady frame; what is no number counts as standing
        still.

        A clock that steps back begins the past anew, at the same place.
        """
        if not all(map(math.isfinite, (stamp, *odometry))):
            return self.newest()
        steady = self._steady_from_odometry.compose(odometry)
        if self._past:
            before, last = self._past[-1]
            if self._is_jump(
                last.distance(steady), wrap_angle(steady.theta - last.theta), stamp - before
            ):
                self.jumps += 1
                self._steady_from_odometry = last.compose(odometry.inverse())
                steady = last
            if stamp < before:
                self._past.clear()
        self._past.append((stamp, steady))
        return steady

    def newest(self) -> Pose2D:
        """Return where the robot was last, in the steady frame."""
        return self._past[-1][1] if self._past else CENTRE

    def at(self, stamp: float) -> Pose2D:
        """Return where the robot was at `stamp`, in the steady frame: between readings
        interpolated, beyond them the nearest one.
        """
        if not self._past:
            return CENTRE
        later = self._past[-1]
        if stamp >= later[0]:
            return later[1]
        for earlier in reversed(self._past):
            if earlier[0] <= stamp:
                share = (
                    (stamp - earlier[0]) / (later[0] - earlier[0]) if later[0] > earlier[0] else 1.0
                )
                return _between(earlier[1], later[1], share)
            later = earlier
        return later[1]

    def _is_jump(self, way: float, turn: float, seconds: float) -> bool:
        seconds = max(seconds, 0.0)
        return (
            way > self.speed * seconds + self.slack
            or abs(turn) > self.turning * seconds + self.slack
        )


def _between(first: Pose2D, second: Pose2D, share: float) -> Pose2D:
    return Pose2D(
        first.x + share * (second.x - first.x),
        first.y + share * (second.y - first.y),
        wrap_angle(first.theta + share * wrap_angle(second.theta - first.theta)),
    )
