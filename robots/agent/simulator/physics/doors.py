"""Doors that swing: each leaf turns about its hinge at a steady speed, once all of its way is free.

A leaf waits while a person is in its way, and turns back when one steps into it, so that it catches
no one. It never comes nearer to them than a hand.

A leaf at rest is open or closed; between the two it has a share of its swing, from 0, closed, to 1,
open. Before the world has begun to move, doors are set at once: they were so from the beginning.
"""

import math

from robots.agent.simulator.physics.contact import Shape, shape
from robots.api.floorplan import Door, DoorState, FloorPlan
from robots.world.solids import Floats, Opening, leaf_solid

SPEED = 1.2  # rad/s: as people close doors behind them
# metres from a robot or a person at which a leaf stops
KEPT_OFF = 0.1
LOOKS = 0.1  # radians of the way between two looks whether it is free
RESTS: dict[DoorState, float] = {"closed": 0.0, "open": 1.0}


class Doors:
    """A plan's leaves: `states` at rest, or last at rest; `moving` are those under way."""

    def __init__(self, plan: FloorPlan, states: dict[str, DoorState]) -> None:
        self.plan = plan
        self.states = dict(states)
        self.moving: tuple[Shape, ...] = ()
        self._wanted = dict(states)
        self._on_the_way: dict[str, float] = {}

    @property
    def openings(self) -> dict[str, Opening]:
        """How each door stands now: its state at rest, or its share of the swing."""
        return {**self.states, **self._on_the_way}

    @property
    def resting(self) -> tuple[Door, ...]:
        """The doors whose leaves are open or closed."""
        return tuple(door for door in self.plan.doors if door.name not in self._on_the_way)

    def want(self, doors: dict[str, DoorState]) -> None:
        """Take wanted states; unknown names are ignored."""
        self._wanted |= {name: state for name, state in doors.items() if name in self.states}

    def set_at_once(self, in_the_way: list[Floats]) -> bool:
        """Put every leaf where it is wanted, if that is free; tell whether any moved."""
        changed = [
            door for door in self.plan.doors if self._wanted[door.name] != self.states[door.name]
        ]
        moved = [
            door
            for door in changed
            if not self._hits(door, RESTS[self._wanted[door.name]], in_the_way)
        ]
        self.states |= {door.name: self._wanted[door.name] for door in moved}
        return bool(moved)

    def step(self, dt: float, in_the_way: list[Floats]) -> bool:
        """Turn leaves for `dt` seconds; tell whether one has left its rest or come to it.

        `in_the_way` are outlines (n, 2) that no leaf may come near to; it may go away from one that
        is too near already.
        """
        before = set(self._on_the_way)
        turned = [door for door in self.plan.doors if self._turn(door, dt, in_the_way)]
        if turned:
            self.moving = tuple(
                shape(leaf_solid(door, self._on_the_way[door.name]))
                for door in self.plan.doors
                if door.name in self._on_the_way
            )
        return set(self._on_the_way) != before

    def is_still(self) -> bool:
        return not self._on_the_way and self._wanted == self.states

    def _turn(self, door: Door, dt: float, in_the_way: list[Floats]) -> bool:
        """Turn one leaf towards its goal, or back when blocked; tell whether it moved."""
        rest, goal = RESTS[self.states[door.name]], RESTS[self._wanted[door.name]]
        here = self._on_the_way.get(door.name, rest)
        near = _within_reach(door, in_the_way)
        if near and here != goal and _comes_near(door, here, goal, near):
            goal = rest
        if here == goal and door.name not in self._on_the_way:
            return False
        step = SPEED * dt / max(abs(door.swing), SPEED * dt)
        there = min(goal, here + step) if goal > here else max(goal, here - step)
        if near and _comes_near(door, here, there, near):
            return False
        if there == goal:
            self._on_the_way.pop(door.name, None)
            self.states[door.name] = "open" if goal == RESTS["open"] else "closed"
        else:
            self._on_the_way[door.name] = there
        return True

    @staticmethod
    def _hits(door: Door, opening: float, in_the_way: list[Floats]) -> bool:
        leaf = shape(leaf_solid(door, opening))
        return any(leaf.gap_to(outline)[0] < 0.0 for outline in in_the_way)


def _within_reach(door: Door, in_the_way: list[Floats]) -> list[Floats]:
    """Return the outlines that a leaf can come near to at all."""
    reach = math.dist(door.start, door.end) + KEPT_OFF
    return [outline for outline in in_the_way if _distance(outline, door.start) <= reach]


def _comes_near(door: Door, here: float, there: float, outlines: list[Floats]) -> bool:
    """Tell whether a leaf, between two openings, gets too near to an outline, and nearer."""
    count = max(1, math.ceil(abs((there - here) * door.swing) / LOOKS))
    now = shape(leaf_solid(door, here))
    least = [(outline, min(now.gap_to(outline)[0], KEPT_OFF)) for outline in outlines]
    for number in range(1, count + 1):
        then = shape(leaf_solid(door, here + (there - here) * number / count))
        if any(then.gap_to(outline)[0] < gap for outline, gap in least):
            return True
    return False


def _distance(outline: Floats, point: tuple[float, float]) -> float:
    """Return a lower bound of metres from a point to an outline: to its bounding circle."""
    middle = outline.mean(axis=0)
    radius = math.sqrt(float(((outline - middle) ** 2).sum(axis=1).max()))
    return math.dist((float(middle[0]), float(middle[1])), point) - radius
