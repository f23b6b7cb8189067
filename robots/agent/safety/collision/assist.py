"""Assisted driving: shapes a driver's velocity near obstacles. The collision monitor calls it as a
stage of the safety kernel, between limits and ramp.

Three levels. `off` changes nothing. `slow` slows the robot down and stops it before obstacles.
`steer` also turns it a little, around obstacles and into the middle of doorways, before it slows
down.

A velocity is safe when the robot can hold it for its reaction time, then brake, and no known point
comes closer to the footprint than a margin on the way. The margin grows with the speed. For a robot
that turns or reverses it also grows with the error of a point: points in view have none, remembered
points count as a little nearer. Ahead of a driving robot it includes what its corners need to turn
in place, so that a robot in front of a wall can turn away. A point that is already within the
margin must not come closer: this lets a robot leave any contact, but not go further into it.

**The commanded side.** With `wanted` = (v, w), and S the turn that steering may add
(`SteeringSettings.turn` at `full` m/s and above, falling with the speed to zero; zero for a robot
that stands, goes back or only turns), the result (v', w') keeps:

- v' lies between 0 and v: never the opposite direction, never faster; zero stays zero;
- without steering, w' lies between 0 and w;
- with it, w' never turns faster than the larger of |w| and S. Against the side of w goes at most S,
  and the less the firmer the driver turns, until at |w| = `firm` x S nothing of it: a firm turn to
  one side never becomes one to the other. Of what |w| is beyond that, at least half is kept, and
  all of it by a robot at rest: a firm turn towards a wall still turns towards the wall.

A laser that has been silent for `silence` seconds stops the robot at both levels, with `blind`,
because creeping would not prevent collisions either. A driver who prefers to creep home by the
video alone can choose `off`.

A charging station is an obstacle that a robot is meant to touch. Where the caller knows the robot's
pose in its dock, and the robot is close in front of it and turned towards it, points beyond the
docked robot's nose may be touched, at a creep, without steering.
"""

import math
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
import numpy.typing as npt

from robots.agent.ramp import ZERO
from robots.agent.safety.collision.slowing import Slowing, SlowingSettings
from robots.agent.safety.collision.steering import Steering, SteeringSettings
from robots.agent.safety.collision.swept import hull, outside
from robots.agent.safety.contacts import Side, side_of
from robots.api.geometry import Pose2D
from robots.api.messages import AssistLevel, Limits, Velocity
from robots.world.sensing import Floats, points_in_frame

Why = Literal["off", "free", "slow", "stop", "steer", "blind"]

REPORTED_TURN = 0.05  # rad/s: a smaller added turn is not reported
AT_REST = 0.02  # m/s at the fastest corner, below which the robot counts as at rest
BEYOND = 0.02  # metres by which a station may be before the docked robot's nose


@dataclass(frozen=True)
class DockRegion:
    """The region in which a robot may touch its station, seen from the dock: at most so far before
    it and aside (m), and turned (rad).
    """

    before: float = 0.5
    aside: float = 0.12
    turned: float = 0.3


@dataclass(frozen=True)
class AssistSettings:
    slowing: SlowingSettings = field(default_factory=SlowingSettings)
    steering: SteeringSettings = field(default_factory=SteeringSettings)
    dock: DockRegion = field(default_factory=DockRegion)
    silence: float = 0.5


@dataclass(frozen=True)
class Assisted:
    """A velocity, and why it differs from the wanted one.

    `point` (x, y) in the robot's frame, metres, is the obstacle that decided, or the nearest; it is
    on `side`, `clearance` metres from the footprint; None without a near obstacle. `turn` is the
    turn that steering added, in rad/s. The driver's ramp continues from `own`, the velocity without
    it; otherwise an added turn would count as the driver's next time.
    """

    velocity: Velocity
    why: Why
    point: tuple[float, float] | None = None
    clearance: float | None = None
    side: Side | None = None
    turn: float = 0.0
    own: Velocity = ZERO


class DriverAssistance:
    """The assistance of one robot, without state: the same input has the same result."""

    def __init__(
        self,
        footprint: tuple[tuple[float, float], ...],
        limits: Limits,
        settings: AssistSettings | None = None,
    ) -> None:
        """Take the footprint and the base's own limits. Raises ValueError unless the footprint is
        convex and around the robot's centre.
        """
        self.limits, self.settings = limits, settings or AssistSettings()
        self.hull = hull(footprint)
        self.slowing = Slowing(self.hull, limits, self.settings.slowing)
        self.steering = Steering(self.hull, limits, self.settings.steering)
        self._nose = float(max(x for x, _ in footprint))
        self.reach = self.hull.radius + max(
            self.slowing.reach, self.settings.steering.horizon + self.settings.steering.room
        )

    def shape(
        self,
        wanted: Velocity,
        current: Velocity,
        points: Floats,
        level: AssistLevel,
        *,
        errors: Floats | None = None,
        silence: float = 0.0,
        dock: Pose2D | None = None,
        dt: float = 0.02,
    ) -> Assisted:
        """Return what to send to the base instead of `wanted`.

        Args:
            wanted: what the safety kernel allows, ramped from `own` of the last result.
            current: what the base was last sent.
            points: (n, 2) obstacles in the robot's frame, known to `reach` metres from its centre.
            level: how much help the driver gets.
            errors: (n,) metres by which each point may be nearer than it seems.
            silence: seconds since the laser's last valid scan, `inf` before the first.
            dock: the docked robot's pose in the robot's frame, None when unknown or not wanted.
            dt: seconds until the next call.
        """
        if level == "off":
            return Assisted(wanted, "off", own=wanted)
        if not silence <= self.settings.silence:
            return Assisted(ZERO, "blind")
        near, off = self._within_reach(points, errors)
        gaps = outside(self.hull, near)
        if wanted == ZERO:
            return answer(Assisted(ZERO, "free"), near, gaps, None)
        touchable = self._touchable(near, dock)
        turned = wanted
        if level == "steer" and touchable is None:
            turned = self.steering.steered(wanted, current, near, dt)
        close = np.flatnonzero(gaps - off <= self.slowing.reach_at(turned, current))
        allowed = np.zeros(len(close), dtype=np.bool_) if touchable is None else touchable[close]
        slowed, decided = self.slowing.slowed(
            turned, current, near[close], allowed, errors=off[close], dt=dt
        )
        if decided is None and touchable is None:
            decided = self.slowing.limiting_point(turned, near[close], off[close])
        share = slowed.angular / turned.angular if turned.angular else 1.0
        own = Velocity(linear=slowed.linear, angular=wanted.angular * share)
        turn = slowed.angular - own.angular
        why: Why = "steer" if abs(turn) >= REPORTED_TURN else "free"
        if decided is not None:
            corner = abs(slowed.linear) + self.hull.radius * abs(slowed.angular)
            why = "stop" if corner < AT_REST else "slow"
        found = Assisted(slowed, why, turn=turn, own=own)
        return answer(found, near, gaps, None if decided is None else int(close[decided]))

    def _within_reach(self, points: Floats, errors: Floats | None) -> tuple[Floats, Floats]:
        points = np.asarray(points, dtype=np.float64).reshape(-1, 2)
        x, y = points[:, 0], points[:, 1]
        # NaN is never close
        close = np.flatnonzero(x * x + y * y <= self.reach**2)
        return points[close], np.zeros(len(close)) if errors is None else errors[close]

    def _touchable(self, points: Floats, dock: Pose2D | None) -> npt.NDArray[np.bool_] | None:
        """Return (n,) which points a robot close before its dock may touch, None for any other."""
        region = self.settings.dock
        if dock is None or not (
            0.0 <= dock.x <= region.before
            and abs(dock.y) <= region.aside
            and abs(dock.theta) <= region.turned
        ):
            return None
        return points_in_frame(dock, points)[:, 0] >= self._nose - BEYOND


def answer(assisted: Assisted, points: Floats, gaps: Floats, decided: int | None) -> Assisted:
    """Return the same with the point (of (n, 2), at gaps (n,)) that decided, or the nearest."""
    if len(points) == 0:
        return assisted
    index = int(gaps.argmin()) if decided is None else decided
    point = float(points[index, 0]), float(points[index, 1])
    side = side_of(math.atan2(point[1], point[0]))
    return replace(assisted, point=point, clearance=float(gaps[index]), side=side)
