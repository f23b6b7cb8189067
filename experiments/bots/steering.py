"""Steering by hand, as people do it: towards a point some way ahead, slower in bends, turning on
the spot when it lies aside.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from robots.api.geometry import Pose2D, wrap_angle
from robots.api.messages import Point

AHEAD = 0.55  # metres along the way to the point that is aimed at
SHARP = 0.7  # radians aside from which one turns on the spot
GAIN = 1.6  # rad/s for a radian
CREEP = 0.08  # m/s into a station
ALIGNED = 0.06  # radians
BRAKE = 0.15  # m/s², with which one slows down towards the end of a way


@dataclass(frozen=True)
class SpeedSetting:
    """What is asked of the robot: m/s and rad/s."""

    linear: float = 0.0
    angular: float = 0.0

    @property
    def is_zero(self) -> bool:
        """Tell whether the robot shall stand."""
        return self.linear == 0.0 and self.angular == 0.0


STAND = SpeedSetting()


def rest_of(way: Sequence[Point], x: float, y: float) -> list[Point]:
    """Return the way from the point of it that is nearest, so that what was driven is forgotten; at
    least its end.
    """
    nearest = min(range(len(way)), key=lambda index: math.dist(way[index], (x, y)))
    return list(way[nearest:])


def aim(way: Sequence[Point], x: float, y: float, ahead: float = AHEAD) -> Point:
    """Return the first point of a way that lies so far from the robot, or its end."""
    return next((point for point in way if math.dist(point, (x, y)) >= ahead), way[-1])


def follow(pose: Pose2D, way: Sequence[Point], fastest: SpeedSetting) -> SpeedSetting:
    """Return the speed along a way; `fastest` bounds it."""
    target = aim(way, pose.x, pose.y)
    aside = wrap_angle(math.atan2(target[1] - pose.y, target[0] - pose.x) - pose.theta)
    turn = max(-fastest.angular, min(fastest.angular, GAIN * aside))
    if abs(aside) > SHARP:
        return SpeedSetting(0.0, turn)
    left = math.dist(way[-1], (pose.x, pose.y))
    linear = min(fastest.linear * math.cos(aside) ** 2, math.sqrt(2.0 * BRAKE * left) + CREEP)
    return SpeedSetting(linear, turn)


def turn_to(
    pose: Pose2D, theta: float, fastest: SpeedSetting, within: float = ALIGNED
) -> SpeedSetting:
    """Return the speed of turning on the spot to a heading; zero when it is reached."""
    aside = wrap_angle(theta - pose.theta)
    if abs(aside) <= within:
        return STAND
    least = math.copysign(0.12, aside)
    turn = GAIN * aside if abs(GAIN * aside) > abs(least) else least
    return SpeedSetting(0.0, max(-fastest.angular, min(fastest.angular, turn)))


def into(pose: Pose2D, dock: Pose2D, fastest: SpeedSetting) -> SpeedSetting:
    """Return the speed into a station from before it: along its axis, ever slower, and gently back
    onto the axis.
    """
    seen = dock.inverse().compose(pose)  # x < 0 before the station, y aside of its axis
    to_go = -seen.x
    heading = math.atan2(-seen.y, max(0.35, min(0.8, to_go)))
    turn = max(-0.5, min(0.5, 2.0 * wrap_angle(heading - seen.theta)))
    linear = CREEP if to_go < 0.35 else min(0.25, fastest.linear, CREEP + 0.35 * (to_go - 0.35))
    return SpeedSetting(linear, turn)
