"""The largest share of a wanted velocity after which the robot can still stop before every
obstacle.

Only velocities that the base can reach within one tick are weighed: a speed that braking cannot
reach in time counts as the one that it can, so that a slow command is not mistaken for a slow
robot.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from robots.agent.safety.collision.swept import Hull, distances, stops
from robots.api.messages import Limits, Velocity
from robots.world.sensing import Floats

POSES = 7
SPEEDS, TURNS = 3, 2
UNBENT = 0.5  # cost of straightening a wanted turn, where the cost of a stop is 2
SLACK = 1e-5  # metres: a point that stays where it is does not come closer


@dataclass(frozen=True)
class SlowingSettings:
    reaction: float = 0.12  # s before it brakes
    near: float = 0.035  # m kept off obstacles by a robot that hardly moves
    fast: float = 0.06  # m kept at `fast_speed` and above
    fast_speed: float = 0.3  # m/s
    turning_room: float = 0.015  # m ahead, beyond what the corners need to turn in place
    crawl: float = 0.1  # m/s at most, along an obstacle that is too near already
    creep: float = 0.06  # m/s at most, with which a station is touched
    probe: float = 0.15  # m/s that tell whether something is in the way of a stopped robot


class Slowing:
    """The slowing of a robot with this footprint."""

    def __init__(self, shape: Hull, limits: Limits, settings: SlowingSettings) -> None:
        self.shape, self.limits, self.settings = shape, limits, settings
        room = np.maximum(shape.radius - shape.offsets, 0.0) + settings.turning_room
        self._room_ahead = room * np.maximum(shape.normals[:, 0], 0.0)
        self._room_behind = room * np.maximum(-shape.normals[:, 0], 0.0)
        braking = (
            limits.linear**2 / (2.0 * limits.linear_braking) + limits.linear * settings.reaction
        )
        # a quarter turn sweeps no more than the circle about the centre, which `radius` includes
        corners = max(self._room_ahead.max(), self._room_behind.max())
        self._most_room = settings.fast + float(corners)
        self.reach = braking + self._most_room

    def reach_at(self, wanted: Velocity, current: Velocity) -> float:
        """Return from what distance to the footprint points matter to a robot at `current` that is
        to move as wanted; at most `reach`, in metres.
        """
        linear = max(abs(wanted.linear), abs(current.linear), self.settings.probe)
        probe = self.settings.probe / self.shape.radius
        angular = max(abs(wanted.angular), abs(current.angular), probe)
        braking = linear * self.settings.reaction + linear**2 / (2.0 * self.limits.linear_braking)
        turn = angular * self.settings.reaction + angular**2 / (2.0 * self.limits.angular_braking)
        return min(self.reach, braking + self.shape.radius * turn + self._most_room)

    def margins(self, velocities: Floats) -> Floats:
        """Return (c, e): the distances that each side of the footprint keeps at (c, 2)."""
        return self._ease(velocities)[:, None] + self._room(velocities[:, 0])

    def _room(self, linear: Floats) -> Floats:
        """Return (c, e) the margins for the corners at (c,) m/s."""
        forward, back = (linear > 0.0)[:, None], (linear < 0.0)[:, None]
        room: Floats = forward * self._room_ahead + back * self._room_behind
        return room

    def _ease(self, velocities: Floats) -> Floats:
        """Return (c,) the margin all round; half of the least for a robot that only turns, so that
        one that came so near can turn away.
        """
        s = self.settings
        speeds = np.abs(velocities[:, 0]) + self.shape.radius * np.abs(velocities[:, 1]) / 2.0
        ease = s.near + (s.fast - s.near) * np.minimum(speeds / s.fast_speed, 1.0)
        eased: Floats = np.where(velocities[:, 0] == 0.0, ease - s.near / 2.0, ease)
        return eased

    def spare(
        self, velocities: Floats, points: Floats, touchable: npt.NDArray[np.bool_], errors: Floats
    ) -> Floats:
        """Return (c, n): the room of points beyond the required one, in metres, while velocities
        (c, 2) are held for the reaction time and then braked.

        Points may be nearer than they seem by `errors` (n,), which counts for a robot that turns or
        reverses into what it does not see; ahead of one that drives the margins include it. A point
        within the margins must not come closer, otherwise the robot could never leave. A crawling
        robot may pass other points as near as the nearest is, so that it can continue along a wall.
        A creeping robot needs no room to a `touchable` point.
        """
        ease = self._ease(velocities)
        poses = stops(velocities, self.limits, self.settings.reaction, POSES, stand=True)
        beyond = distances(self.shape, poses, points, ease[:, None] + self._room(velocities[:, 0]))
        now, nearest = beyond[:, 0].astype(np.float64), beyond.min(axis=1).astype(np.float64)
        speeds = np.abs(velocities[:, 0])
        least = self.settings.near / 2.0 - ease
        crawls = speeds <= self.settings.crawl
        like_nearest = np.where(crawls, np.maximum(now.min(axis=1), least), 0.0)
        off = np.where(velocities[:, :1] > 0.0, 0.0, errors)
        required = np.minimum(np.minimum(now - off, 0.0), np.minimum(like_nearest, 0.0)[:, None])
        touches = touchable & (speeds <= self.settings.creep)[:, None]
        return np.where(touches, np.inf, nearest - off - (required - SLACK))

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
        """Return the safe share of `wanted`, and which of points (n, 2), each off by at most
        `errors` (n,), limited it; None for all of it.
        """
        if len(points) == 0:
            return wanted, None
        soonest = self._soonest(np.array([[wanted.linear, wanted.angular]]), current, dt)
        first = self.spare(soonest, points, touchable, errors)[0]
        if first.min() >= 0.0:
            return wanted, None
        decided = int(first.argmin())
        shares = self._shares(wanted, current, dt, touching=bool(touchable.any()))
        tried = shares * (wanted.linear, wanted.angular)
        spare = self.spare(self._soonest(tried, current, dt), points, touchable, errors)
        safe = spare.min(axis=1) >= 0.0
        if not safe.any():
            # Brake: with a slower command the base could brake no harder, and would start again
            # from less than its speed.
            least = self._soonest(np.zeros((1, 2)), current, dt)[0]
            linear = least[0] if wanted.linear * current.linear > 0.0 else 0.0
            angular = least[1] if wanted.angular * current.angular > 0.0 else 0.0
            return Velocity(
                linear=_within(linear, wanted.linear), angular=_within(angular, wanted.angular)
            ), decided
        costs = (1.0 - shares).sum(axis=1) + UNBENT * (shares[:, 0] > shares[:, 1])
        best = tried[int(np.argmin(np.where(safe, costs, np.inf)))]
        return Velocity(linear=float(best[0]), angular=float(best[1])), decided

    def limiting_point(self, wanted: Velocity, points: Floats, errors: Floats) -> int | None:
        """Return which of points (n, 2) would slow a robot on the wanted arc at `probe` m/s, or
        None.

        A stopped robot starts again from a speed that no point forbids; what stops it is still the
        same.
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
        """Return the velocities of the base one tick after commands (c, 2): it slows down no faster
        than it brakes.
        """
        now = np.array([current.linear, current.angular])
        braking = np.array([self.limits.linear_braking, self.limits.angular_braking])
        least = np.maximum(np.abs(now) - braking * dt, 0.0)
        slower = (np.abs(velocities) < least) & (velocities * now >= 0.0)
        soonest: Floats = np.where(slower, np.sign(now) * least, velocities)
        return soonest


def _within(value: float, wanted: float) -> float:
    """Return the value limited to `wanted` of the same sign."""
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
