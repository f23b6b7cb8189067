"""A differential drive: speeds follow their targets within the base's accelerations, the pose
follows the speeds on arcs; and the head, which tilts.
"""

import math
from typing import NamedTuple

import numpy as np

from robots.api.geometry import Pose2D, wrap_angle
from robots.api.messages import Limits, TiltRange

STRAIGHT = 1e-9


class WheelMotion(NamedTuple):
    """The motion of the wheels: m/s ahead, rad/s counter-clockwise."""

    linear: float
    angular: float


STILL = WheelMotion(0.0, 0.0)


def clamp(motion: WheelMotion, limits: Limits) -> WheelMotion:
    linear = min(max(motion.linear, -limits.reverse), limits.linear)
    return WheelMotion(linear, min(max(motion.angular, -limits.angular), limits.angular))


def approach(
    current: float, target: float, acceleration: float, braking: float, dt: float
) -> float:
    """Return the speed after `dt`: towards zero with `braking`, away from it with `acceleration`.

    A change of sign brakes to zero first, and the rest of `dt` accelerates.
    """
    if current * target < 0.0 or abs(target) < abs(current):
        floor = target if current * target > 0.0 else 0.0
        slowed = _towards(current, floor, braking * dt)
        if slowed != 0.0 or floor == target:
            return slowed
        return _towards(0.0, target, acceleration * max(0.0, dt - abs(current) / braking))
    return _towards(current, target, acceleration * dt)


def _towards(current: float, target: float, step: float) -> float:
    return current + min(max(target - current, -step), step)


def follow(current: WheelMotion, target: WheelMotion, limits: Limits, dt: float) -> WheelMotion:
    """Return the speeds after `dt` seconds towards `target`, clamped to the limits."""
    wanted = clamp(target, limits)
    return WheelMotion(
        approach(
            current.linear, wanted.linear, limits.linear_acceleration, limits.linear_braking, dt
        ),
        approach(
            current.angular, wanted.angular, limits.angular_acceleration, limits.angular_braking, dt
        ),
    )


def advance(pose: Pose2D, motion: WheelMotion, dt: float) -> Pose2D:
    """Return the pose after `dt` s (Thrun et al., Probabilistic Robotics, equation 5.9)."""
    turn = motion.angular * dt
    theta = pose.theta + turn
    if abs(turn) < STRAIGHT:
        step = motion.linear * dt
        return Pose2D(
            pose.x + step * math.cos(pose.theta),
            pose.y + step * math.sin(pose.theta),
            wrap_angle(theta),
        )
    radius = motion.linear / motion.angular
    x = pose.x + radius * (math.sin(theta) - math.sin(pose.theta))
    y = pose.y - radius * (math.cos(theta) - math.cos(pose.theta))
    return Pose2D(x, y, wrap_angle(theta))


def slip(
    motion: WheelMotion, separation: float, noise: float, dt: float, rng: np.random.Generator
) -> WheelMotion:
    """Return what the wheels really do when each slips a little; always draws two numbers, so that
    runs stay comparable.

    `noise` is the standard deviation of a wheel's relative error over one metre, `separation` the
    distance of the wheels.
    """
    left = motion.linear - motion.angular * separation / 2.0
    right = motion.linear + motion.angular * separation / 2.0
    first, second = rng.standard_normal(2).tolist()
    if noise == 0.0 or dt == 0.0:
        return motion
    left += noise * math.sqrt(abs(left) / dt) * first
    right += noise * math.sqrt(abs(right) / dt) * second
    return WheelMotion((left + right) / 2.0, (right - left) / separation)


class Encoders(NamedTuple):
    """Dead reckoning's error: shares of the true wheel radii and of their separation."""

    left: float
    right: float
    separation: float


def draw_encoders(
    radius_error: float, separation_error: float, rng: np.random.Generator
) -> Encoders:
    """Return the errors of one robot, from the standard deviations among all of its kind."""
    left, right, separation = rng.standard_normal(3).tolist()
    return Encoders(
        1.0 + radius_error * left, 1.0 + radius_error * right, 1.0 + separation_error * separation
    )


def reckoned(motion: WheelMotion, separation: float, encoders: Encoders) -> WheelMotion:
    """Return the speeds that encoders report; `separation` is the true one, in metres."""
    left = (motion.linear - motion.angular * separation / 2.0) * encoders.left
    right = (motion.linear + motion.angular * separation / 2.0) * encoders.right
    return WheelMotion((left + right) / 2.0, (right - left) / (separation * encoders.separation))


def tilted(angle: float, target: float, tilt: TiltRange, dt: float) -> float:
    """Return the head's angle (radians, positive down) after `dt` s towards `target`."""
    wanted = min(max(target, tilt.minimum), tilt.maximum)
    return _towards(angle, wanted, tilt.speed * dt)
