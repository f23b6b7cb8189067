"""The largest share of a wanted velocity after which the robot can still stop before every
obstacle.

Only velocities that the base can have one tick from now are weighed: a speed that braking cannot
reach in time counts as the speed that it can, so that a promise to be slow is never mistaken for
being slow.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from robots.agent.safety.collision.swept import Hull, distances, stops
from robots.api.messages import Limits, Velocity
from robots.world.sensing import Floats

POSES = 7
SPEEDS, TURNS = 3, 2
# what it costs to straighten a turn that was asked for, where the cost of standing still is 2
UNBENT = 0.5
SLACK = 1e-5  # metres: a point that stays where it is does not come closer


@dataclass(frozen=True)
class SlowingSettings:
    """How much room an assisted robot keeps, and what it expects of its base."""

    reaction: float = 0.12  # s before it brakes
    near: float = 0.035  # m kept off obstacles by a robot that hardly moves
    fast: float = 0.06  # m kept at `fast_speed` and above
    fast_speed: float = 0.3  # m/s
    turning_room: float = 0.015  # m ahead, beyond what the corners need to turn in place
    crawl: float = 0.1  # m/s at most, along what is too near already
    creep: float = 0.06  # m/s at most, with which a station is touched
    probe: float = 0.15  # m/s that tell whether something is in the way of a stopped robot


class Slowing:
    """What a robot with this footprint can stop before."""

    def __init__(self, shape: Hull, limits: Limits, settings: SlowingSettings) -> None:
        self.shape, self.limits, self.settings = shape, limits, settings
        room = np.maximum(shape.radius - shape.offsets, 0.0) + settings.turning_room
        self._room_ahead = room * np.maximum(shape.normals[:, 0], 0.0)
        self._room_behind = room * np.maximum(-shape.normals[:, 0], 0.0)
        braking = (
            limits.linear**2 / (2.0 * limits.linear_braking) + limits.linear * settings.reaction
        )
        # Turning a quarter sweeps no more than the circle about the centre, which `radius` holds
        # already.
        self._most_room = settings.fast + float(
            max(self._room_ahead.max(), self._room_behind.max())
        )
        self.reach = braking + self._most_room

    def reach_at(self, wanted: Velocity, current: Velocity) -> float:
        """Return how far off the footprint points can matter to a robot that moves so, and is to
        move as wanted; at most `reach`, in metres.
        """
        linear = max(abs(wanted.linear), abs(current.linear), self.settings.probe)
        angular = max(
            abs(wanted.angular), abs(current.angular), self.settings.probe / self.shape.radius
        )
        way = linear * self.settings.reaction + linear**2 / (2.0 * self.limits.linear_braking)
        turn = angular * self.settings.reaction + angular**2 / (2.0 * self.limits.angular_braking)
        return min(self.reach, way + self.shape.radius * turn + self._most_room)

    def margins(self, velocities: Floats) -> Floats:
        """Return (c, e): how far off each side of the footprint obstacles are kept at (c, 2) m/s,
        rad/s.
        """
        return self._ease(velocities)[:, None] + self._room(velocities[:, 0])

    def _room(self, linear: Floats) -> Floats:
        """Return (c, e) the margins for the corners at (c,) m/s."""
        room: Floats = (linear > 0.0)[:, None] * self._room_ahead + (linear < 0.0)[
            :, None
        ] * self._room_behind
        return room

    def _ease(self, velocities: Floats) -> Floats:
        """Return (c,) the margin all round; a robot that only turns is given half of the least: it
        was let so near, now it is let away.
        """
        s = self.settings
        speeds = np.abs(velocities[:, 0]) + self.shape.radius * np.abs(velocities[:, 1]) / 2.0
        ease = s.near + (s.fast - s.near) * np.minimum(speeds / s.fast_speed, 1.0)
        eased: Floats = np.where(velocities[:, 0] == 0.0, ease - s.near / 2.0, ease)
        return eased

    def spare(
        self, velocities: Floats, points: Floats, touchable: npt.NDArray[np.bool_], errors: Floats
    ) -> Floats:
        """Return (c, n): by how much points stay beyond what is asked of them while (c, 2) is held
        and then braked.

        Points may be nearer than they seem by `errors` (n,), which counts for a robot that turns or
        goes back into what it does not see; ahead of one that drives the margins hold that already.
        A point within the margins already is asked to come no closer, or else nothing would ever
        come free. A robot that crawls may pass other points as near as the nearest is, so that it
        can go on along a wall. A `touchable` point is asked nothing of one that creeps.
        """
        ease = self._ease(velocities)
        poses = stops(velocities, self.limits, self.settings.reaction, POSES, stand=True)
        beyond = distances(self.shape, poses, points, ease[:, None] + self._room(velocities[:, 0]))
        now, nearest = beyond[:, 0].astype(np.float64), beyond.min(axis=1).astype(np.float64)
        speeds = np.abs(velocities[:, 0])
        least = self.settings.near / 2.0 - ease
        like_nearest = np.where(
            speeds <= self.settings.crawl, np.maximum(now.min(axis=1), least), 0.0
        )
        off = np.where(velocities[:, :1] > 0.0, 0.0, errors)
        asked = (
            np.minimum(np.minimum(now - off, 0.0), np.minimum(like_nearest, 0.0)[:, None]) - SLACK
        )
        return np.where(
            touchable & (speeds <= self.settings.creep)[:, None], np.inf, nearest - off - asked
        )

    def slowed(
        self,
        wanted: Velocity,
        current: Velocity,
        points: Floats,
        touchable: npt.NDArray[np.bool_],
        *,
        errors: Floats,
        dt: float,
    ) -> tuple[Velocity, int | None]:
        """Return what is left of `wanted`, and which of points (n, 2), each off by at most `errors`
        (n,), decided; None where all of it is left.
        """
        if len(points) == 0:
            return wanted, None
        first = self.spare(
            self._soonest(np.array([[wanted.linear, wanted.angular]]), current, dt),
            points,
            touchable,
            errors,
        )[0]
        if first.min() >= 0.0:
            return wanted, None
        decided = int(first.argmin())
        shares = self._shares(wanted, current, dt, touching=bool(touchable.any()))
        tried = shares * (wanted.linear, wanted.angular)
        safe = (
            self.spare(self._soonest(tried, current, dt), points, touchable, errors).min(axis=1)
            >= 0.0
        )
        if not safe.any():
            # Brake: told less than that, the base could do no more, and would start again from less
            # than it moves at.
            least = self._soonest(np.zeros((1, 2)), current, dt)[0] * (
                wanted.linear * current.linear > 0.0,
                wanted.angular * current.angular > 0.0,
            )
            return Velocity(
                linear=_within(least[0], wanted.linear), angular=_within(least[1], wanted.angular)
            ), decided
        costs = (1.0 - shares).sum(axis=1) + UNBENT * (shares[:, 0] > shares[:, 1])
        best = tried[int(np.argmin(np.where(safe, costs, np.inf)))]
        return Velocity(linear=float(best[0]), angular=float(best[1])), decided

    def minds(self, wanted: Velocity, points: Floats, errors: Floats) -> int | None:
        """Return which of points (n, 2) would slow a robot that went the wanted way at `probe` m/s,
        None where it could.

        Whoever was stopped starts again from a speed that nothing forbids, and is stopped again:
        what stands in his way is the same.
        """
        speed = abs(wanted.linear) + self.shape.radius * abs(wanted.angular)
        if len(points) == 0 or not 0.0 < speed < self.settings.probe:
            return None
        faster = self.settings.probe / max(speed, 1e-6)
        asked = np.array([[wanted.linear * faster, wanted.angular * faster]])
        spare = self.spare(asked, points, np.zeros(len(points), dtype=np.bool_), errors)[0]
        return int(spare.argmin()) if spare.min() < 0.0 else None

    def _shares(self, wanted: Velocity, current: Velocity, dt: float, *, touching: bool) -> Floats:
        """Return (c, 2) shares of the wanted speed and turn: from all of it down to what braking
        leaves in a tick, and nothing.
        """
        up = self.limits.linear_acceleration * dt, self.limits.angular_acceleration * dt
        down = self.limits.linear_braking * dt, self.limits.angular_braking * dt
        creep = self.settings.creep if touching else 0.0
        linear = shares(
            wanted.linear, abs(current.linear) - down[0], abs(current.linear) + up[0], SPEEDS, creep
        )
        angular = shares(
            wanted.angular, abs(current.angular) - down[1], abs(current.angular) + up[1], TURNS
        )
        return np.array([(a, b) for a in linear for b in angular])

    def _soonest(self, velocities: Floats, current: Velocity, dt: float) -> Floats:
        """Return what the base can be doing one tick after it was told (c, 2): it slows down no
        faster than it brakes.
        """
        now = np.array([current.linear, current.angular])
        least = np.maximum(
            np.abs(now) - np.array([self.limits.linear_braking, self.limits.angular_braking]) * dt,
            0.0,
        )
        slower = (np.abs(velocities) < least) & (velocities * now >= 0.0)
        soonest: Floats = np.where(slower, np.sign(now) * least, velocities)
        return soonest


def _within(value: float, wanted: float) -> float:
    """Return the value, no larger than what was wanted of the same sign."""
    return float(min(max(value, min(wanted, 0.0)), max(wanted, 0.0)))


def shares(
    wanted: float, slowest: float, fastest: float, count: int, besides: float = 0.0
) -> list[float]:
    """Return shares of a wanted speed, the largest first: `count` from the fastest to the slowest
    reachable one, `besides`, and none.
    """
    if wanted == 0.0:
        return [1.0]
    most, least = min(fastest / abs(wanted), 1.0), min(max(slowest / abs(wanted), 0.0), 1.0)
    found = {most + (least - most) * step / count for step in range(count + 1)} | {0.0}
    if 0.0 < besides < most * abs(wanted):
        found.add(besides / abs(wanted))
    return sorted(found, reverse=True)
