"""Doors that swing: each leaf turns about its hinge at a constant speed once its whole arc is free.

A leaf waits while a person or the robot is in its arc, and turns back when one enters it; it keeps
`KEPT_OFF` metres away from them.

A leaf at rest is open or closed; between the two its opening is a share of its swing, from 0,
closed, to 1, open. Before the first step of the world, doors are set without swinging.
"""

import math

from robots.api.floorplan import Door, DoorState, FloorPlan
from robots.simulator.physics.contact import Shape, shape
from robots.world.solids import Floats, Opening, leaf_solid

SPEED = 1.2  # rad/s: as people close doors behind them
KEPT_OFF = 0.1  # metres from a robot or a person at which a leaf stops
CHECK_EVERY = 0.1  # radians of the arc between two checks whether it is free
RESTS: dict[DoorState, float] = {"closed": 0.0, "open": 1.0}


class Doors:
    """A plan's leaves: `states` at rest, or last at rest; `moving` are those that swing now.

    `obstacles` are outlines (n, 2) of the robot and of people in the world.
    """

    def __init__(self, plan: FloorPlan, states: dict[str, DoorState]) -> None:
        self.plan = plan
        self.states = dict(states)
        self.moving: tuple[Shape, ...] = ()
        self._wanted = dict(states)
        self._swinging: dict[str, float] = {}  # openings

    @property
    def openings(self) -> dict[str, Opening]:
        """The opening of each door: its state at rest, or its share of the swing."""
        return {**self.states, **self._swinging}

    @property
    def resting(self) -> tuple[Door, ...]:
        return tuple(door for door in self.plan.doors if door.name not in self._swinging)

    def want(self, doors: dict[str, DoorState]) -> None:
        """Set wanted states; unknown names are ignored."""
        self._wanted |= {name: state for name, state in doors.items() if name in self.states}

    def set_at_once(self, obstacles: list[Floats]) -> bool:
        """Put every leaf where it is wanted, if that is free; tell whether any moved."""
        before = dict(self.states)
        for door in self.plan.doors:
            leaf = shape(leaf_solid(door, self._wanted[door.name]))
            if all(leaf.gap_to(outline)[0] >= 0.0 for outline in obstacles):
                self.states[door.name] = self._wanted[door.name]
        return self.states != before

    def step(self, dt: float, obstacles: list[Floats]) -> bool:
        """Turn leaves for `dt` seconds; tell whether one has left its rest or reached it.

        No leaf comes near an obstacle; it may move away from one that is too near already.
        """
        before = set(self._swinging)
        turned = [door for door in self.plan.doors if self._turn(door, dt, obstacles)]
        if turned:
            self.moving = tuple(
                shape(leaf_solid(door, self._swinging[door.name]))
                for door in self.plan.doors
                if door.name in self._swinging
            )
        return set(self._swinging) != before

    def is_still(self) -> bool:
        return not self._swinging and self._wanted == self.states

    def _turn(self, door: Door, dt: float, obstacles: list[Floats]) -> bool:
        """Turn one leaf towards its goal, or back when blocked; tell whether it moved."""
        rest, goal = RESTS[self.states[door.name]], RESTS[self._wanted[door.name]]
        here = self._swinging.get(door.name, rest)
        reach = math.dist(door.start, door.end) + KEPT_OFF
        near = [outline for outline in obstacles if _distance(outline, door.start) <= reach]
        if near and here != goal and _comes_near(door, here, goal, near):
            goal = rest
        if here == goal and door.name not in self._swinging:
            return False
        step = SPEED * dt / max(abs(door.swing), SPEED * dt)
        there = min(goal, here + step) if goal > here else max(goal, here - step)
        if near and _comes_near(door, here, there, near):
            return False
        if there == goal:
            self._swinging.pop(door.name, None)
            self.states[door.name] = "open" if goal == RESTS["open"] else "closed"
        else:
            self._swinging[door.name] = there
        return True


def _comes_near(door: Door, here: float, there: float, outlines: list[Floats]) -> bool:
    """Tell whether a leaf gets too near to an outline, and nearer, between two openings."""
    count = max(1, math.ceil(abs((there - here) * door.swing) / CHECK_EVERY))
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
