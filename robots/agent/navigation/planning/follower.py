"""Driving along a path: pursuit of a point ahead, turning on the spot where that is better, slower
where it is narrow.

Pure pursuit (Coulter, "Implementation of the Pure Pursuit Path Tracking Algorithm",
CMU-RI-TR-92-01): the arc to a point at distance L and bearing a has the curvature 2 sin a / L.
`BrakeCheck` checks each velocity.
"""

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from robots.agent.navigation.planning.centring import centred_between
from robots.agent.navigation.planning.path import SPACING, PlannedPath
from robots.agent.ramp import ZERO
from robots.agent.safety.collision.braking import BrakeCheck, Checked, Hazards
from robots.api.geometry import Pose2D, wrap_angle
from robots.api.messages import Limits, Velocity
from robots.world.sensing import points_in_frame


@dataclass(frozen=True)
class FollowerParams:
    """Parameters of following a path."""

    ahead: float = 0.32  # m: the point pursued
    ahead_per_speed: float = 0.5  # m more for each m/s
    preview: float = 0.7  # m ahead, for whose bends the robot slows down
    turn_from: float = 0.9  # rad of bearing at which it turns on the spot
    turn_to: float = 0.12  # rad at which that is done
    lateral_use: float = 0.6  # share of the turning speed that bends may use up
    easing: float = 0.25  # m/s² of deceleration towards the end
    turn_easing: float = 0.6  # rad/s², the same for turns on the spot
    slowest_turn: float = 0.1  # rad/s
    last_speed: float = 0.04  # m/s with which the end is reached
    narrow_speed: float = 0.12  # m/s with no room at all
    narrow_gain: float = 0.9  # m/s more for each metre of room
    looks_at: tuple[float, float] = (-0.3, 1.2)  # m along the path where it looks to both sides
    arrived: float = 0.06  # m from the end
    nearly: float = 0.15  # m from the end of a path that is used up, or that something blocks
    drifted: float = 0.25  # m from the end, beyond which the robot has left it again
    heading: float = 0.04  # rad from the heading wanted
    keeps_side: float = 2.5  # rad beyond which a turn keeps its side
    settled: float = 0.06  # m/s or rad/s that count as standing


FOLLOWER = FollowerParams()


State = Literal["driving", "held", "arrived"]


@dataclass(frozen=True)
class Followed:
    """The velocity for the base; `why` it is held: "thing" or "walker"."""

    velocity: Velocity
    state: State
    why: str = ""


class Follower:
    """A base with limits, and the path it is on."""

    def __init__(
        self, check: BrakeCheck, limits: Limits, params: FollowerParams = FOLLOWER
    ) -> None:
        self.check, self.limits, self._params = check, limits, params
        self.path = PlannedPath(np.zeros((1, 2)))
        self.along = 0.0
        self._heading: float | None = None
        self._side = 0.0  # of the turn on the spot that is going on, 0 without one
        self._turns_long = False  # the near side is blocked
        self._at_end = False

    def take(self, path: PlannedPath, heading: float | None) -> None:
        """Follow a path from its start and end with a heading, or with any."""
        self.path, self.along, self._heading = path, 0.0, heading
        self._at_end, self._side, self._turns_long = False, 0.0, False

    @property
    def remaining(self) -> float:
        """The way left in metres."""
        return self.path.length - self.along

    def off_path(self, pose: Pose2D) -> float:
        """Return how far in metres the robot is from where it should be on the path."""
        return math.dist(self.path.at(self.along), (pose.x, pose.y))

    def step(self, pose: Pose2D, velocity: Velocity, hazards: Hazards) -> Followed:
        """Return what to ask of the base at `pose` on the map, moving with `velocity`."""
        params = self._params
        self.along = self.path.nearest(pose.x, pose.y, self.along - 0.2, self.along + 0.6)
        left = math.dist(self.path.end, (pose.x, pose.y))
        if left <= params.arrived or (self.remaining < params.arrived and left <= params.nearly):
            self._at_end = True
        if self._at_end and left <= params.drifted:
            return self._finish(pose, velocity, hazards)
        self._at_end = False
        return self._pursue(pose, velocity, hazards, left)

    def rest(self, pose: Pose2D) -> bool:
        """End the path here because of an obstacle in its last centimetres; return False when its
        end is too far away or the robot already rests there.
        """
        if self._at_end or math.dist(self.path.end, (pose.x, pose.y)) > self._params.nearly:
            return False
        self._at_end = True
        return True

    def turn(
        self, error: float, velocity: Velocity, hazards: Hazards, tolerance: float
    ) -> Followed:
        """Turn in place by `error` radians to within `tolerance`, the long way if blocked."""
        params = self._params
        if abs(error) <= tolerance:
            self._side, self._turns_long = 0.0, False
            is_settled = abs(velocity.angular) <= params.settled
            return Followed(ZERO, "arrived" if is_settled else "driving")
        keeps = self._side != 0.0 and (self._turns_long or abs(error) > params.keeps_side)
        self._side = self._side if keeps else math.copysign(1.0, error)
        done = self._turned(self._side, error, velocity, hazards)
        is_blocked = done.velocity == ZERO and done.why == "thing"
        if is_blocked and not self._turns_long and abs(error) > 2.0 * tolerance:
            self._side, self._turns_long = -self._side, True
            done = self._turned(self._side, error, velocity, hazards)
        return Followed(done.velocity, "held" if done.velocity == ZERO else "driving", done.why)

    def _turned(self, side: float, error: float, velocity: Velocity, hazards: Hazards) -> Checked:
        params = self._params
        left = error * side if error * side > 0.0 else math.tau - abs(error)
        eased = math.sqrt(2.0 * params.turn_easing * left) - 0.1
        speed = min(self.limits.angular, max(params.slowest_turn, eased))
        return self.check.fastest(velocity, Velocity(linear=0.0, angular=side * speed), hazards)

    def _finish(self, pose: Pose2D, velocity: Velocity, hazards: Hazards) -> Followed:
        params = self._params
        if self._heading is None:
            speed = max(abs(velocity.linear), abs(velocity.angular))
            return Followed(ZERO, "arrived" if speed <= params.settled else "driving")
        return self.turn(wrap_angle(self._heading - pose.theta), velocity, hazards, params.heading)

    def _pursue(self, pose: Pose2D, velocity: Velocity, hazards: Hazards, left: float) -> Followed:
        params = self._params
        ahead = params.ahead + params.ahead_per_speed * max(0.0, velocity.linear)
        local = self._ahead(pose, self.along + ahead, hazards)
        distance = max(math.hypot(*local), 0.05)
        bearing = math.atan2(local[1], local[0])
        turn_from = params.turn_from if left > params.ahead else params.turn_from / 2.0
        if self._side or abs(bearing) > turn_from:
            turned = self.turn(bearing, velocity, hazards, params.turn_to)
            if turned.state != "arrived":
                return turned
        curvature = 2.0 * math.sin(bearing) / max(distance, 0.15)
        wanted = self._wanted(bearing, curvature, velocity, hazards)
        done = self.check.fastest(velocity, wanted, hazards)
        if done.velocity == ZERO and done.why == "thing" and abs(bearing) > params.turn_to:
            return self.turn(bearing, velocity, hazards, params.turn_to)
        return Followed(done.velocity, "held" if done.velocity == ZERO else "driving", done.why)

    def _ahead(self, pose: Pose2D, along: float, hazards: Hazards) -> tuple[float, float]:
        """Return the path's point `along` metres from its start, in the robot's frame; in a tight
        place in the middle of what the robot sees, because its pose is too inexact for the path.
        """
        start, stop = self._params.looks_at
        distances = np.arange(max(self.along + start, 0.0), self.along + stop, SPACING)
        distances = np.append(distances[distances < self.path.length], self.path.length)
        line = points_in_frame(pose, self.path.interpolated(distances))
        seen = np.concatenate([hazards.things, hazards.strangers])
        line = centred_between(line, distances, seen, self.check.half_width)
        return float(np.interp(along, distances, line[:, 0])), float(
            np.interp(along, distances, line[:, 1])
        )

    def _wanted(
        self, bearing: float, curvature: float, velocity: Velocity, hazards: Hazards
    ) -> Velocity:
        params = self._params
        sharpest = self.path.sharpest_bend(self.along, self.along + params.preview)
        bend = max(abs(curvature), 0.7 * sharpest)
        gaps = np.concatenate([self.check.gaps(hazards.things), self.check.gaps(hazards.strangers)])
        room = max(0.0, float(gaps.min())) if len(gaps) else 1.0
        left = max(0.0, self.remaining - params.arrived / 2.0)
        speed = min(
            self.limits.linear,
            math.sqrt(2.0 * params.easing * left) + params.last_speed,
            params.lateral_use * self.limits.angular / max(bend, 1e-6),
            params.narrow_speed + params.narrow_gain * room,
            self.limits.linear * max(0.15, 1.0 - abs(bearing)),
        )
        rolling = min(max(velocity.linear, 0.08), speed)
        angular = min(max(rolling * curvature, -self.limits.angular), self.limits.angular)
        return Velocity(linear=speed, angular=angular)
