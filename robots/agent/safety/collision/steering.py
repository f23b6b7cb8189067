"""Chooses the turn that assistance adds: of some arcs near the driver's own, the one that leads on
with room on both sides.

The arcs are simulated for `horizon` metres, with the turn changing as fast as the base can. An arc
costs what it loses of its length, how little room it leaves (least in the middle of a doorway), its
difference from the driver's, and a little for each change. In the open no other arc is cheaper than
the driver's own.
"""

from dataclasses import dataclass

import numpy as np

from robots.agent.safety.collision.swept import Hull, arcs, distances
from robots.api.messages import Limits, Velocity
from robots.world.sensing import Floats

POSES = 8
ARCS = 7
SHARES = np.linspace(0.0, 1.0, ARCS)
MAXIMUM = 3.0  # rad/s
AT_REST = 1e-3  # m/s


@dataclass(frozen=True)
class SteeringSettings:
    """Limits of steering, and the weights of arcs. Differences of turns are shares: 1 is as large
    as the turn and `turn` together.
    """

    turn: float = 0.35  # rad/s that may be added at `full` and above, less below
    full: float = 0.2  # m/s
    firm: float = 0.6  # times `turn`: steering adds nothing against a firmer turn of the driver
    kept: float = 0.5  # of what a turn is beyond that, and more of it the slower the robot
    horizon: float = 1.5  # m, the length of an arc
    seconds: float = 3.0  # s, the longest that an arc may take
    room: float = 0.35  # m on both sides, from which more gains nothing
    near: float = 0.04  # m before an obstacle, where an arc ends
    cell: float = 0.07  # m: one point in such a square is enough to weigh an arc
    weight_length: float = 2.0  # for a whole arc lost
    weight_room: float = 1.0  # for no room at all
    weight_driver: float = 0.12  # for the difference from the driver's turn
    weight_last: float = 0.04  # for the difference from the last turn


def helping_turn(wanted: Velocity, settings: SteeringSettings) -> float:
    """Return the turn in rad/s that may be added: none for a robot at rest, in reverse or only
    turning.
    """
    if wanted.linear <= AT_REST:
        return 0.0
    return settings.turn * min(1.0, wanted.linear / settings.full)


def bounds(wanted: Velocity, settings: SteeringSettings) -> tuple[float, float]:
    """Return the least and the largest turn, rad/s, on the commanded side (see assist.py)."""
    turn, help_ = abs(wanted.angular), helping_turn(wanted, settings)
    if help_ == 0.0:
        return wanted.angular, wanted.angular
    beyond = turn - settings.firm * help_
    kept = 1.0 - (1.0 - settings.kept) * help_ / settings.turn
    least = beyond / settings.firm if beyond < 0.0 else kept * beyond
    largest = max(turn, help_)
    return (least, largest) if wanted.angular >= 0.0 else (-largest, -least)


def ahead(points: Floats, shape: Hull, settings: SteeringSettings) -> Floats:
    """Return the points (m, 2) that an arc can meet, one a cell."""
    x, y = points[:, 0], points[:, 1]
    reach = settings.horizon + shape.radius + settings.room
    met = points[(x > -shape.radius) & (x * x + y * y < reach**2)]
    cells = np.floor(met / settings.cell).astype(np.intp)
    cells -= cells.min(axis=0, initial=0)
    places = cells[:, 0] * (int(cells[:, 1].max(initial=0)) + 1) + cells[:, 1]
    numbers = np.arange(len(cells))
    table = np.empty(int(places.max(initial=0)) + 1, dtype=np.intp)
    # of several points in a cell the first one is written last, and stays
    table[places[::-1]] = numbers[::-1]
    thinned: Floats = met[table[places] == numbers]
    return thinned


class Steering:
    """The steering of a robot with this footprint and base."""

    def __init__(self, shape: Hull, limits: Limits, settings: SteeringSettings) -> None:
        self.shape, self.limits, self.settings = shape, limits, settings
        self._flush = np.zeros((ARCS + 1, len(shape.offsets)))

    def steered(self, wanted: Velocity, current: Velocity, points: Floats, dt: float) -> Velocity:
        """Return the wanted velocity with the best turn that the base can reach in `dt` seconds.
        `points` (n, 2) are in the robot's frame; the base was last sent `current`.
        """
        low, high = bounds(wanted, self.settings)
        near = ahead(points, self.shape, self.settings)
        if low >= high or len(near) == 0:
            return wanted
        turns = np.append(low + (high - low) * SHARES, wanted.angular)
        turn = float(turns[np.argmin(self.costs(wanted, current, turns, near))])
        step = self.limits.angular_acceleration * dt
        reached = min(max(turn, min(current.angular, 0.0) - step), max(current.angular, 0.0) + step)
        return Velocity(linear=wanted.linear, angular=min(max(reached, low), high))

    def costs(self, wanted: Velocity, current: Velocity, turns: Floats, points: Floats) -> Floats:
        """Return the cost of each of turns (c,) in rad/s at the wanted speed among points."""
        s = self.settings
        poses = self._arcs(wanted, current, turns)
        room = distances(self.shape, poses, points, self._flush).min(axis=2)
        on = np.logical_and.accumulate(room > s.near, axis=1)
        lost = 1.0 - on.sum(axis=1) / POSES
        narrow = np.where(on, 1.0 - np.minimum(np.maximum(room / s.room, 0.0), 1.0), 1.0)
        tight = (narrow**2).sum(axis=1) / POSES
        scale = s.turn + abs(wanted.angular)
        away = ((turns - wanted.angular) / scale) ** 2
        changed = ((turns - current.angular) / scale) ** 2
        costs: Floats = (
            s.weight_length * lost
            + s.weight_room * tight
            + s.weight_driver * away
            + s.weight_last * changed
        )
        return costs

    def _arcs(self, wanted: Velocity, current: Velocity, turns: Floats) -> Floats:
        """Return poses (c, k, 3); a robot that starts is weighed on the same arcs as one that
        drives.
        """
        linear = max(wanted.linear, self.settings.full)
        faster = linear / wanted.linear
        seconds = min(self.settings.seconds, self.settings.horizon / linear)
        turn = min(max(current.angular * faster, -MAXIMUM), MAXIMUM)
        start = Velocity(linear=linear, angular=turn)
        acceleration = self.limits.angular_acceleration * faster
        return arcs(start, turns * faster, acceleration, seconds, POSES)
