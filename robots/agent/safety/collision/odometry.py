"""Odometry without jumps, interpolated at past moments, and how late it arrives.

A wheel counter that restarts at zero, or a restarted base, moves the odometry by metres within a
tick although nothing was driven. The track then continues from where it was and counts the jump, so
that the particle filter can spread.
"""

import math
from collections import deque
from dataclasses import dataclass, field

from robots.api.geometry import Pose2D, wrap_angle
from robots.api.messages import Velocity
from robots.world.sensing import CENTRE

KEPT = 200  # readings: 10 s at 20 Hz


@dataclass
class OdometryTrack:
    """Past readings. A step faster than `speed` m/s or `turning` rad/s, beyond the always allowed
    `slack`, is a jump.
    """

    speed: float = 3.0
    turning: float = 6.0
    slack: float = 0.1
    jumps: int = 0
    _steady_from_odometry: Pose2D = CENTRE
    _past: deque[tuple[float, Pose2D]] = field(default_factory=lambda: deque(maxlen=KEPT))

    def add(self, stamp: float, odometry: Pose2D) -> Pose2D:
        """Take a reading and return it in the steady frame; a non-finite one counts as no motion. A
        clock that steps back clears the past and keeps the place.
        """
        if not all(map(math.isfinite, (stamp, *odometry))):
            return self.newest()
        steady = self._steady_from_odometry.compose(odometry)
        if self._past:
            before, last = self._past[-1]
            turn = wrap_angle(steady.theta - last.theta)
            if self._is_jump(last.distance(steady), turn, stamp - before):
                self.jumps += 1
                self._steady_from_odometry = last.compose(odometry.inverse())
                steady = last
            if stamp < before:
                self._past.clear()
        self._past.append((stamp, steady))
        return steady

    def newest(self) -> Pose2D:
        """Return the last pose in the steady frame."""
        return self._past[-1][1] if self._past else CENTRE

    def at(self, stamp: float) -> Pose2D:
        """Return the pose at `stamp` in the steady frame, interpolated between readings, beyond
        them the nearest.
        """
        if not self._past:
            return CENTRE
        return interpolated(self._past, stamp)

    def _is_jump(self, distance: float, turn: float, seconds: float) -> bool:
        seconds = max(seconds, 0.0)
        too_far = distance > self.speed * seconds + self.slack
        return too_far or abs(turn) > self.turning * seconds + self.slack


@dataclass
class Delay:
    """How much later readings arrive than the fastest recent one. The robot's clock may differ from
    ours, so that a constant delay looks like that difference.

    `forgets` is how fast a fast reading is forgotten, in seconds per second.
    """

    forgets: float = 0.005
    _fastest: float = math.inf
    _stamp: float = -math.inf
    _taken_at: float = -math.inf

    def of(self, stamp: float, now: float) -> float:
        """Take a reading's stamp, the robot's time, and return its delay at `now`, monotonic time;
        in seconds. After a clock has stepped back, the next reading counts as the fastest.
        """
        took = now - stamp
        forgotten = self._fastest + self.forgets * (now - self._taken_at)
        self._fastest = took if stamp < self._stamp else min(took, forgotten)
        self._stamp, self._taken_at = stamp, now
        return took - self._fastest


def carried(pose: Pose2D, velocity: Velocity, seconds: float) -> Pose2D:
    """Return the pose after a velocity has been held for so long."""
    turn, travelled = velocity.angular * seconds, velocity.linear * seconds
    step = Pose2D(travelled * math.cos(turn / 2.0), travelled * math.sin(turn / 2.0), turn)
    return pose.compose(step)


def interpolated(past: deque[tuple[float, Pose2D]], stamp: float) -> Pose2D:
    """Return the pose at `stamp` between poses by their times; outside of them the nearest."""
    later_at, later = past[-1]
    if stamp >= later_at:
        return later
    for at, earlier in reversed(past):
        if at <= stamp:
            return between(earlier, later, (stamp - at) / (later_at - at))
        later_at, later = at, earlier
    return later


def between(first: Pose2D, second: Pose2D, share: float) -> Pose2D:
    """Return the pose at a share of the distance from the first to the second."""
    return Pose2D(
        first.x + share * (second.x - first.x),
        first.y + share * (second.y - first.y),
        wrap_angle(first.theta + share * wrap_angle(second.theta - first.theta)),
    )
