"""Steering by hand, as people do it: towards a point ahead on the route, slower in bends, turning
on the spot when the point is aside.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from robots.api.geometry import Pose2D, wrap_angle
from robots.api.messages import Point

AHEAD = 0.55  # metres along the route to the point that is aimed at
SHARP = 0.7  # radians aside from which one turns on the spot
GAIN = 1.6  # rad/s for a radian
CREEP = 0.08  # m/s into a station
ALIGNED = 0.06  # radians
BRAKE = 0.15  # m/s², with which one slows down towards the end of a route


@dataclass(frozen=True)
class SpeedSetting:
    """A speed in m/s and rad/s."""

    linear: float = 0.0
    angular: float = 0.0

    @property
    def is_zero(self) -> bool:
        return self.linear == 0.0 and self.angular == 0.0


STAND = SpeedSetting()


def rest_of(route: Sequence[Point], x: float, y: float) -> list[Point]:
    """Return a route from its point nearest to the robot on; at least its end."""
    nearest = min(range(len(route)), key=lambda index: math.dist(route[index], (x, y)))
    return list(route[nearest:])


def follow(pose: Pose2D, route: Sequence[Point], fastest: SpeedSetting) -> SpeedSetting:
    """Return the speed along a route; `fastest` bounds it."""
    here = (pose.x, pose.y)
    target = next((point for point in route if math.dist(point, here) >= AHEAD), route[-1])
    aside = wrap_angle(math.atan2(target[1] - pose.y, target[0] - pose.x) - pose.theta)
    turn = max(-fastest.angular, min(fastest.angular, GAIN * aside))
    if abs(aside) > SHARP:
        return SpeedSetting(0.0, turn)
    left = math.dist(route[-1], here)
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
    dock_from_robot = dock.inverse().compose(pose)  # x < 0 before the station, y aside of its axis
    to_go = -dock_from_robot.x
    heading = math.atan2(-dock_from_robot.y, max(0.35, min(0.8, to_go)))
    turn = max(-0.5, min(0.5, 2.0 * wrap_angle(heading - dock_from_robot.theta)))
    linear = CREEP if to_go < 0.35 else min(0.25, fastest.linear, CREEP + 0.35 * (to_go - 0.35))
    return SpeedSetting(linear, turn)
