"""Limits and ramps of velocities. Pure, per axis, in SI units."""

import math
from dataclasses import dataclass

from robots.api.messages import AssistLevel, LeaseLimits, Limits, Velocity

ZERO = Velocity(linear=0.0, angular=0.0)

LONGEST_DEADMAN = 1.0  # s
LONGEST_WATCHDOG = 2.0  # s
ASSIST_MARGIN = 0.05  # m that an assisted robot keeps
ASSIST_CREEP = 0.1  # m/s that assistance always allows


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
    """Return the speed in m/s from which the robot can stop within its clearance (m), half of its
    limit without a measured clearance, None when "off".
    """
    if level == "off":
        return None
    if clearance is None:
        return limits.linear / 2
    room = max(0.0, clearance - ASSIST_MARGIN)
    return max(ASSIST_CREEP, math.sqrt(2 * limits.linear_braking * room))


def ramp(current: Velocity, target: Velocity, limits: Limits, *, dt: float) -> Velocity:
    """Return the velocity `dt` seconds after `current` on the ramp to `target`."""
    up, down = limits.linear_acceleration, limits.linear_braking
    turn_up, turn_down = limits.angular_acceleration, limits.angular_braking
    return Velocity(
        linear=approach(current.linear, target.linear, up, down, dt=dt),
        angular=approach(current.angular, target.angular, turn_up, turn_down, dt=dt),
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
    value: float, target: float, acceleration: float, braking: float, *, dt: float
) -> float:
    """Return one axis of `ramp`."""
    sign = 1.0 if value > 0 or (value == 0 and target >= 0) else -1.0
    speed, goal = abs(value), max(0.0, target * sign)
    if goal < speed:
        slower = max(goal, speed - braking * dt)
        if slower > goal or goal == target * sign:
            return sign * slower + 0.0  # never -0.0, which JSON would show
        # Reversing: the time that remains after the stop is for the other direction.
        left = max(0.0, dt - speed / braking)
        return approach(0.0, target, acceleration, braking, dt=left)
    return sign * min(goal, speed + acceleration * dt)


def check_times(watchdog: float, limits: Limits) -> None:
    """Check that a robot without a driver stops soon: by the agent's deadman, then by the base's
    `watchdog` (seconds). Raises ValueError with one sentence.
    """
    deadman = limits.deadman
    if not deadman <= LONGEST_DEADMAN:
        problem = f"too long: the agent must brake at most {LONGEST_DEADMAN:g} s after the last"
        raise ValueError(f"a deadman of {deadman:g} s is {problem} command")
    if not watchdog <= LONGEST_WATCHDOG:
        problem = f"too long: the base must stop at most {LONGEST_WATCHDOG:g} s after the last"
        raise ValueError(f"a watchdog of {watchdog:g} s is {problem} velocity")
    if not watchdog >= deadman:
        problem = f"shorter than the deadman of {deadman:g} s: the base would stop between two"
        raise ValueError(f"a watchdog of {watchdog:g} s is {problem} commands")
