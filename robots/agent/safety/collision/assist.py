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

A laser that has been silent for `silence` seconds stops the robot, at both levels, with `blind`:
creeping could not keep the level's promise of no collision either, and a driver who prefers to
creep home by the video alone can choose `off`.

A charging station is an obstacle that a robot is meant to touch. Where the caller knows the robot's
pose in its dock, and the robot is close in front of it and turned towards it, points beyond the
docked robot's nose may be touched, at a creep, and nothing is steered.
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
from robots.api.geometry import Pose2D
from robots.api.messages import AssistLevel, Limits, Velocity
from robots.world.sensing import Floats, points_in_frame

Why = Literal["off", "free", "slow", "stop", "steer", "blind"]
Side = Literal["ahead", "left", "behind", "right"]

TELLING = 0.05  # rad/s: a smaller turn that was added is not worth a word
STANDS = 0.02  # m/s at the fastest corner: less is as good as standing
# metres by which a station may stand before the place where the docked robot's nose is
BEYOND = 0.02


@dataclass(frozen=True)
class DockRegion:
    """Where, seen from its dock, a robot may touch the station: at most so far before it and aside
    (m), and turned (rad).
    """

    before: float = 0.5
    aside: float = 0.12
    turned: float = 0.3


@dataclass(frozen=True)
class AssistSettings:
    """All of the assistance; `silence` in seconds."""

    slowing: SlowingSettings = field(default_factory=SlowingSettings)
    steering: SteeringSettings = field(default_factory=SteeringSettings)
    dock: DockRegion = field(default_factory=DockRegion)
    silence: float = 0.5


@dataclass(frozen=True)
class Assisted:
    """A velocity, and why it is not the one that was wanted.

    `point` (x, y) in the robot's frame, metres, is the obstacle that decided, or the nearest; it is
    on `side`, `clearance` metres from the footprint; None where nothing is near. `turn` is what
    steering added, in rad/s. `own` is what of the velocity is the driver's: from there his own ramp
    goes on, or else a turn that was added would count as his the next time.
    """

    velocity: Velocity
    why: Why
    point: tuple[float, float] | None = None
    clearance: float | None = None
    side: Side | None = None
    turn: float = 0.0
    own: Velocity = ZERO


class DriverAssistance:
    """The assistance of one robot. It remembers nothing: the same question has the same answer."""

    def __init__(
        self,
        footprint: tuple[tuple[float, float], ...],
        limits: Limits,
        settings: AssistSettings | None = None,
    ) -> None:
        """Take the footprint (convex, about the robot's centre) and the base's own limits.

        Raises:
            ValueError: not such a footprint.
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
            wanted: what the safety kernel lets pass, ramped from `own` of the last answer.
            current: what the base was last told.
            points: (n, 2) obstacles in the robot's frame, known to `reach` metres from its centre.
            level: how much help the driver gets.
            errors: (n,) metres by which each of points may be nearer than it seems; none without.
            silence: seconds since the laser last saw (`RollingObstacleMap.seen`), `inf` when it
                never has.
            dock: the robot's pose in its dock, seen from the robot; None when unknown or when it is
                nobody's wish to dock.
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
        turned = (
            self.steering.steered(wanted, current, near, dt)
            if level == "steer" and touchable is None
            else wanted
        )
        close = np.flatnonzero(gaps - off <= self.slowing.reach_at(turned, current))
        allowed = np.zeros(len(close), dtype=np.bool_) if touchable is None else touchable[close]
        told, decided = self.slowing.slowed(
            turned, current, near[close], allowed, errors=off[close], dt=dt
        )
        if decided is None and touchable is None:
            decided = self.slowing.minds(turned, near[close], off[close])
        own = Velocity(
            linear=told.linear,
            angular=wanted.angular * (told.angular / turned.angular if turned.angular else 1.0),
        )
        why: Why = "steer" if abs(told.angular - own.angular) >= TELLING else "free"
        if decided is not None:
            why = (
                "stop"
                if abs(told.linear) + self.hull.radius * abs(told.angular) < STANDS
                else "slow"
            )
        found = Assisted(told, why, turn=told.angular - own.angular, own=own)
        return answer(found, near, gaps, None if decided is None else int(close[decided]))

    def _within_reach(self, points: Floats, errors: Floats | None) -> tuple[Floats, Floats]:
        points = np.asarray(points, dtype=np.float64).reshape(-1, 2)
        x, y = points[:, 0], points[:, 1]
        # what is not a number is never close
        close = np.flatnonzero(x * x + y * y <= self.reach**2)
        return points[close], np.zeros(len(close)) if errors is None else errors[close]

    def _touchable(self, points: Floats, dock: Pose2D | None) -> npt.NDArray[np.bool_] | None:
        """Return (n,) which points may be touched by a robot close before its dock, None for one
        that is not.
        """
        region = self.settings.dock
        if dock is None or not (
            0.0 <= dock.x <= region.before
            and abs(dock.y) <= region.aside
            and abs(dock.theta) <= region.turned
        ):
            return None
        return points_in_frame(dock, points)[:, 0] >= self._nose - BEYOND


def answer(assisted: Assisted, points: Floats, gaps: Floats, decided: int | None) -> Assisted:
    """Return the same with the one of points (n, 2), at gaps (n,), that decided, or with the
    nearest.
    """
    if len(points) == 0:
        return assisted
    index = int(gaps.argmin()) if decided is None else decided
    point = float(points[index, 0]), float(points[index, 1])
    return replace(assisted, point=point, clearance=float(gaps[index]), side=side(point))


def side(point: tuple[float, float]) -> Side:
    """Return on which side of the robot a point lies, in quarters about its centre."""
    quarter = round(math.atan2(point[1], point[0]) / (math.pi / 2.0))
    names: tuple[Side, ...] = ("ahead", "left", "behind", "right")
    return names[quarter % 4]
