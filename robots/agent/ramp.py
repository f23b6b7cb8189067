"""Speed ramps: how fast a velocity may change, and how large it may be. Pure, per axis, in SI
units.
"""

import math
from dataclasses import dataclass
from functools import partial

from robots.api.messages import AssistLevel, LeaseLimits, Limits, Velocity

ZERO = Velocity(linear=0.0, angular=0.0)

# How long a robot may go on without commands, in seconds.
LONGEST_DEADMAN = 1.0
LONGEST_WATCHDOG = 2.0
# With assistance the robot keeps this much room (m) and never asks the visitor to creep slower than
# this (m/s).
ASSIST_MARGIN = 0.05
ASSIST_CREEP = 0.1


@dataclass(frozen=True)
class Caps:
    """The largest speeds now: forward and backward in m/s, turning in rad/s, not negative."""

    linear: float
    reverse: float
    angular: float

    def clamp(self, velocity: Velocity, scale: float = 1.0) -> Velocity:
        """Return the velocity inside these caps, each multiplied by `scale` (0 to 1)."""
        return Velocity(
            linear=min(max(velocity.linear, -self.reverse * scale), self.linear * scale),
            angular=min(max(velocity.angular, -self.angular * scale), self.angular * scale),
        )


def caps(limits: Limits, lease: LeaseLimits | None, assist_linear: float | None = None) -> Caps:
    """Return the smallest of what the robot, the lease and the assistance allow."""
    linear = min(
        (limit for limit in (lease.linear if lease else None, assist_linear) if limit is not None),
        default=math.inf,
    )
    angular = math.inf if lease is None or lease.angular is None else lease.angular
    return Caps(
        min(limits.linear, linear), min(limits.reverse, linear), min(limits.angular, angular)
    )


def assist_speed(level: AssistLevel, clearance: float | None, limits: Limits) -> float | None:
    """Return the speed in m/s from which the robot can stop within its clearance, None when "off".

    Without a measured clearance (m) half of the robot's own limit.
    """
    if level == "off":
        return None
    if clearance is None:
        return limits.linear / 2
    return max(
        ASSIST_CREEP,
        float((2 * limits.linear_braking * max(0.0, clearance - ASSIST_MARGIN)) ** 0.5),
    )


def ramp(
    current: Velocity, target: Velocity, limits: Limits, *, dt: float, dt_up: float
) -> Velocity:
    """Return the velocity `dt` seconds after `current` on the way to `target`.

    Getting slower is bounded by the braking limits over `dt`, getting faster by the acceleration
    limits over `dt_up` <= `dt`.
    """
    axis = partial(approach, dt=dt, dt_up=dt_up)
    linear, angular = limits.linear_acceleration, limits.angular_acceleration
    return Velocity(
        linear=axis(current.linear, target.linear, linear, limits.linear_braking),
        angular=axis(current.angular, target.angular, angular, limits.angular_braking),
    )


def no_faster(velocity: Velocity, motion: Velocity) -> Velocity:
    """Return the velocity with no axis faster than in `motion`, and none the other way."""

    def least(one: float, other: float) -> float:
        return 0.0 if one * other <= 0.0 else math.copysign(min(abs(one), abs(other)), one)

    return Velocity(
        linear=least(velocity.linear, motion.linear),
        angular=least(velocity.angular, motion.angular),
    )


def is_within(velocity: Velocity, largest: Velocity) -> bool:
    """Tell whether no axis is faster than in `largest`, in either direction."""
    return abs(velocity.linear) <= largest.linear and abs(velocity.angular) <= largest.angular


def approach(
    value: float, target: float, acceleration: float, braking: float, *, dt: float, dt_up: float
) -> float:
    """Return one axis of `ramp`."""
    sign = 1.0 if value > 0 or (value == 0 and target >= 0) else -1.0
    speed, goal = abs(value), max(0.0, target * sign)
    if goal < speed:
        slower = max(goal, speed - braking * dt)
        if slower > goal or goal == target * sign:
            return sign * slower + 0.0  # never -0.0, which JSON would show
        # Reversing: the time that remains after the stop goes into the other direction.
        return approach(
            0.0, target, acceleration, braking, dt=dt, dt_up=max(0.0, dt_up - speed / braking)
        )
    return sign * min(goal, speed + acceleration * dt_up)


def check_times(watchdog: float, limits: Limits) -> None:
    """Check that a robot without a driver stops soon: by the agent's deadman, then by the base's
    `watchdog` (seconds). Raises ValueError with one sentence.
    """
    deadman = limits.deadman
    if not deadman <= LONGEST_DEADMAN:
        raise ValueError(
            f"a deadman of {deadman:g} s is too long: the agent must brake at "
            f"most {LONGEST_DEADMAN:g} s after the last command"
        )
    if not watchdog <= LONGEST_WATCHDOG:
        raise ValueError(
            f"a watchdog of {watchdog:g} s is too long: the base must stop at "
            f"most {LONGEST_WATCHDOG:g} s after the last velocity"
        )
    if not watchdog >= deadman:
        raise ValueError(
            f"a watchdog of {watchdog:g} s is shorter than the deadman of {deadman:g} s: the base"
            " would stop between two commands"
        )
