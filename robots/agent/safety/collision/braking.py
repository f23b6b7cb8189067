"""Whether the robot touches anything if it follows a velocity and then brakes: footprint, base and
points, without a map.

A wanted velocity is followed for the reaction time, within the base's accelerations, and then
braked to rest. On that whole course no thing may come nearer to the footprint than a margin, or
nearer than it already is, and no walker may be able to reach the robot before it is at rest.
Distances to the footprint are taken along the normals of its sides, which never overestimates.
"""

import math
from dataclasses import dataclass

import numpy as np

from robots.agent.ramp import ZERO, approach
from robots.agent.safety.collision.swept import along, hull
from robots.api.messages import Limits, Velocity
from robots.world.sensing import Floats


@dataclass(frozen=True)
class BrakeParams:
    # s from the world to the wheels: age of a sweep, of a step, of a command
    reaction: float = 0.25
    walking: float = 1.25  # m/s: how fast people are
    margin: float = 0.025  # m of room kept
    margin_per_speed: float = 0.12  # m more for each m/s
    slices: int = 14  # of the course to the stand
    # of the velocity, tried in this order
    shares: tuple[float, ...] = (1.0, 0.8, 0.6, 0.45, 0.3, 0.2, 0.1)
    crawl: float = 0.02  # m/s and rad/s below which the robot may as well stand
    closer: float = 0.005  # m by which a point within the margin may come nearer
    touch: float = 0.015  # m, but not nearer than this
    body: float = 0.1  # m by which people are nearer than their legs, which a laser sees


BRAKING = BrakeParams()


@dataclass(frozen=True, eq=False)
class Hazards:
    """Points (n, 2) around the robot, in its frame, metres: `things` of the map, `strangers` that
    are not on it and may be standing people, and `walkers` that may be walking.
    """

    things: Floats
    strangers: Floats
    walkers: Floats


@dataclass(frozen=True)
class Checked:
    """The fastest safe velocity on the wanted curve, its share of the wanted one, and what is in
    the way: "", "near", "thing" or "walker".
    """

    velocity: Velocity
    share: float
    why: str


class BrakeCheck:
    """Checks for a footprint (n, 2), counter-clockwise, on a base."""

    def __init__(self, footprint: Floats, limits: Limits, params: BrakeParams = BRAKING) -> None:
        self.limits = limits
        self._params = params
        self._hull = hull(tuple(map(tuple, footprint)))
        self.half_width = float(np.abs(footprint[:, 1]).max())

    def gaps(self, points: Floats) -> Floats:
        """Return the distances of points (..., 2) in the robot's frame from the footprint, metres;
        negative inside.
        """
        gaps: Floats = (points @ self._hull.normals.T - self._hull.offsets).max(axis=-1)
        return gaps

    def fastest(self, current: Velocity, wanted: Velocity, hazards: Hazards) -> Checked:
        """Return `wanted`, or the safe share of it, on the same curve."""
        params = self._params
        why = ""
        for share in params.shares:
            slower = Velocity(linear=wanted.linear * share, angular=wanted.angular * share)
            if abs(slower.linear) < params.crawl and abs(slower.angular) < params.crawl:
                break
            why = self.obstacle(current, slower, hazards)
            if not why:
                return Checked(slower, share, "" if share == 1.0 else "near")
        return Checked(ZERO, 0.0, why)

    def obstacle(self, current: Velocity, wanted: Velocity, hazards: Hazards) -> str:
        """Return what is in the way of a velocity: "thing", "walker" or ""."""
        params = self._params
        poses, times = stop_course(current, wanted, self.limits, self._params)
        speed = max(abs(current.linear), abs(wanted.linear))
        margin = params.margin + params.margin_per_speed * speed
        travelled = abs(float(poses[-1, 0])) + abs(float(poses[-1, 1]))
        room = self._hull.radius + margin + travelled + 0.1
        walked = params.walking * float(times[-1])
        walkers = _within(hazards.walkers, room + params.body + walked)
        if self._touches_walker(poses, times, margin, walkers):
            return "walker"
        strangers = _within(hazards.strangers, room + params.body)
        things = _within(hazards.things, room)
        touches = self._touches_thing(poses, margin, params.body, strangers) or self._touches_thing(
            poses, margin, 0.0, things
        )
        return "thing" if touches else ""

    def room_after(self, motion: Velocity, seconds: float, hazards: Hazards) -> float:
        """Return the distance in metres to the nearest point after a motion, `inf` if none."""
        points = np.vstack([hazards.things, hazards.strangers, hazards.walkers])
        half = motion.angular * seconds / 2.0
        travelled = motion.linear * seconds
        pose = np.array([[travelled * math.cos(half), travelled * math.sin(half), 2.0 * half]])
        return float(self.gaps(_seen_from(pose, points)).min()) if len(points) else math.inf

    def _touches_thing(self, poses: Floats, margin: float, unseen: float, points: Floats) -> bool:
        """Tell whether a course comes too near to points behind which things extend for `unseen`
        metres.
        """
        params = self._params
        if len(points) == 0:
            return False
        now = self.gaps(points) - unseen
        least = self.gaps(_seen_from(poses, points)).min(axis=0) - unseen
        closer = np.maximum(params.touch, now - params.closer)
        near = np.where(now > params.touch, closer, now - 0.2 * params.closer)
        return bool((least < np.where(now >= margin, margin, near)).any())

    def _touches_walker(self, poses: Floats, times: Floats, margin: float, points: Floats) -> bool:
        params = self._params
        if len(points) == 0:
            return False
        nearest = self.gaps(_seen_from(poses, points)).min(axis=1)
        return bool((nearest < margin + params.body + params.walking * times).any())


def stop_course(
    current: Velocity, wanted: Velocity, limits: Limits, params: BrakeParams = BRAKING
) -> tuple[Floats, Floats]:
    """Return poses (k, 3) and times (k,) from now to rest, in the robot's present frame."""
    fastest = max(abs(current.linear), abs(wanted.linear))
    turning = max(abs(current.angular), abs(wanted.angular))
    stop = max(fastest / limits.linear_braking, turning / limits.angular_braking)
    dt = (params.reaction + stop) / params.slices
    up, down = limits.linear_acceleration, limits.linear_braking
    turn_up, turn_down = limits.angular_acceleration, limits.angular_braking
    steps = np.zeros((1, params.slices + 1, 2))
    linear, angular = current.linear, current.angular
    for number in range(1, params.slices + 1):
        target = wanted if number * dt <= params.reaction + dt / 2.0 else ZERO
        if linear != target.linear:
            linear = approach(linear, target.linear, up, down, dt=dt)
        if angular != target.angular:
            angular = approach(angular, target.angular, turn_up, turn_down, dt=dt)
        steps[0, number] = linear * dt, angular * dt
    return along(steps.cumsum(axis=1))[0], dt * np.arange(1, params.slices + 1, dtype=np.float64)


def _seen_from(poses: Floats, points: Floats) -> Floats:
    """Return (k, n, 2): points (n, 2) as they are seen from poses (k, 3)."""
    cosine, sine = np.cos(poses[:, 2:3]), np.sin(poses[:, 2:3])
    x, y = points[None, :, 0] - poses[:, 0:1], points[None, :, 1] - poses[:, 1:2]
    return np.stack([cosine * x + sine * y, cosine * y - sine * x], axis=-1)


def _within(points: Floats, reach: float) -> Floats:
    chosen: Floats = points[(points**2).sum(axis=1) <= reach * reach]
    return chosen
