"""People who walk from place to place, stay a while and walk on.

They keep clear of walls, furniture, doors and, where there is room, of each other. They do not stop
for a robot until they touch it: then they wait until it has left, and after a while turn round and
walk somewhere else. They never push it.
"""

import math
from dataclasses import dataclass, field

import numpy as np

from robots.api.floorplan import DoorState, FloorPlan
from robots.api.geometry import Pose2D, wrap_angle
from robots.simulator.physics.contact import Shape, distance_to, place
from robots.simulator.physics.doors import KEPT_OFF
from robots.simulator.physics.people import BODY, TOUCH, Person
from robots.simulator.physics.walkways import Footways
from robots.world.solids import Floats

PACES = (0.5, 1.2)  # m/s
STAYS = (1.0, 8.0)  # seconds at a goal
PATIENCE = (1.5, 4.0)  # seconds before a person who is blocked turns round
AT_WALL = 5.0  # times sooner a person turns round who is blocked by a wall
SPEEDING_UP = 1.5  # m/s²
TURNING = 3.0  # rad/s
ARRIVED = 0.12
TWO_STEPS = 1.3  # metres in which the legs come round
SPREAD = 3  # random goals in each room, beside the plan's places
FROM_DOCK = 1.0  # metres that people keep from charging stations when they stop somewhere
FROM_ROBOT = 1.2  # metres from a robot that are free of people at the start
WIDE = 1.1  # metres ahead at which people go round each other
ASIDE = 0.7  # radians they turn for it
NEAR = 0.75  # metres from the robot's middle within which a person may touch it
APART = 0.45  # metres between two people's middles


@dataclass
class _Walker:
    x: float
    y: float
    heading: float
    look: int
    pace: float
    speed: float = 0.0
    stride: float = 0.0
    stay: float = 0.0
    held: float = 0.0
    patience: float = 2.0
    touching: bool = False
    since_bump: float = math.inf
    path: list[tuple[float, float]] = field(default_factory=list)

    def seen(self) -> Person:
        return Person(self.x, self.y, self.heading, self.stride, self.look, self.speed)


class Pedestrians:
    """Up to `count` people in a plan, moved by `step`, if there is floor. They start away from
    the `robot` (x, y). `bumped` is how often one has walked into it.
    """

    def __init__(
        self,
        plan: FloorPlan,
        count: int,
        doors: dict[str, DoorState],
        robot: tuple[float, float],
        rng: np.random.Generator,
    ) -> None:
        self._rng = rng
        self._footways = Footways(plan)
        self._goals = _goals(plan, self._footways, rng)
        self._leaves: tuple[Floats, ...] = ()
        self.bumped = 0
        free = [
            goal
            for goal in self._goals
            if math.dist(goal, robot) > FROM_ROBOT and self._footways.is_free(*goal, doors)
        ]
        chosen = rng.permutation(len(free))[:count]
        self._walkers = [self._walker(free[index], look) for look, index in enumerate(chosen)]
        self.people: tuple[Person, ...] = tuple(walker.seen() for walker in self._walkers)

    def just_bumped(self, look: int, seconds: float) -> bool:
        """Tell whether a person walked into the robot within the last seconds."""
        return any(walker.look == look and walker.since_bump < seconds for walker in self._walkers)

    def step(
        self,
        dt: float,
        doors: dict[str, DoorState],
        footprint: Floats,
        robot: Pose2D,
        leaves: tuple[Shape, ...] = (),
    ) -> None:
        """Let all people walk for `dt` seconds.

        `footprint` (n, 2) is the robot's outline in its own frame, `robot` its pose; `leaves` are
        those of doors that are moving.
        """
        self._leaves = tuple(leaf.solid.outline for leaf in leaves)
        for walker in self._walkers:
            walker.since_bump += dt
            if walker.stay > 0.0:
                walker.stay, walker.speed = walker.stay - dt, 0.0
            elif not walker.path:
                self._set_out(walker, doors)
            else:
                near = math.hypot(walker.x - robot.x, walker.y - robot.y) < NEAR
                self._walk(walker, dt, doors, place(footprint, robot) if near else None)
        self.people = tuple(walker.seen() for walker in self._walkers)

    def _walker(self, place: tuple[float, float], look: int) -> _Walker:
        heading, pace, stay = (
            float(self._rng.uniform(*limits))
            for limits in ((-math.pi, math.pi), PACES, (0.0, STAYS[0]))
        )
        return _Walker(*place, heading, look, pace, stay=stay)

    def _set_out(self, walker: _Walker, doors: dict[str, DoorState]) -> None:
        """Choose a goal; a person who is shut in stays a while and tries again."""
        goal = self._goals[int(self._rng.integers(len(self._goals)))]
        walker.pace = float(self._rng.uniform(*PACES))
        walker.patience = float(self._rng.uniform(*PATIENCE))
        if self._footways.is_free(*goal, doors):
            walker.path = self._footways.path((walker.x, walker.y), goal, doors) or []
        if not walker.path:
            walker.stay = STAYS[0]

    def _walk(
        self, walker: _Walker, dt: float, doors: dict[str, DoorState], robot: Floats | None
    ) -> None:
        target = walker.path[0]
        distance = math.hypot(target[0] - walker.x, target[1] - walker.y)
        if distance < ARRIVED:
            walker.path.pop(0)
            if not walker.path:
                walker.stay = float(self._rng.uniform(*STAYS))
            return
        bearing = math.atan2(target[1] - walker.y, target[0] - walker.x)
        course = self._round_others(walker, bearing, doors)
        turn = wrap_angle(course - walker.heading)
        walker.heading = wrap_angle(walker.heading + min(max(turn, -TURNING * dt), TURNING * dt))
        wanted = walker.pace * max(0.0, math.cos(turn))
        walker.speed = min(wanted, walker.speed + SPEEDING_UP * dt)
        length = walker.speed * dt
        x, y = self._along_walls(
            walker, length * math.cos(course), length * math.sin(course), doors
        )
        if (
            self._bumps(walker, x, y, robot)
            or self._meets_leaf(walker, x, y)
            or self._meets_another(walker, x, y)
            or (x, y) == (walker.x, walker.y)
        ):
            walker.speed = 0.0
            self._lose_patience(walker, dt)
            return
        walker.stride = (walker.stride + walker.speed * dt * math.tau / TWO_STEPS) % math.tau
        straight = math.hypot(x - walker.x, y - walker.y) > 0.5 * length
        walker.x, walker.y = x, y
        if straight:
            walker.held = 0.0
        else:
            self._lose_patience(walker, AT_WALL * dt)

    def _along_walls(
        self, walker: _Walker, dx: float, dy: float, doors: dict[str, DoorState]
    ) -> tuple[float, float]:
        """Return where a step ends: along a wall if it is blocked, or where it began."""
        x, y = walker.x, walker.y
        ends = ((x + dx, y + dy), (x + dx, y), (x, y + dy))
        if not self._footways.is_free(x, y, doors):  # a door has moved: leave its arc
            return ends[0]
        return next((end for end in ends if self._footways.is_free(*end, doors)), (x, y))

    def _lose_patience(self, walker: _Walker, seconds: float) -> None:
        walker.held += seconds
        if walker.held > walker.patience:
            walker.path, walker.held = [], 0.0

    def _bumps(self, walker: _Walker, x: float, y: float, robot: Floats | None) -> bool:
        """Tell whether a step ends at the robot and not away from it; count the first."""
        gap = math.inf if robot is None else distance_to(x, y, robot) - TOUCH
        if robot is None or gap >= 0.0 or gap > distance_to(walker.x, walker.y, robot) - TOUCH:
            walker.touching = walker.touching and gap < APART - 2.0 * TOUCH
            return False
        if not walker.touching:
            self.bumped += 1
            walker.touching, walker.since_bump = True, 0.0
        return True

    def _meets_leaf(self, walker: _Walker, x: float, y: float) -> bool:
        """Tell whether a step leads nearer to a moving leaf that is at arm's length."""
        return any(
            (apart := distance_to(x, y, leaf)) < BODY + KEPT_OFF
            and apart < distance_to(walker.x, walker.y, leaf)
            for leaf in self._leaves
        )

    def _meets_another(self, walker: _Walker, x: float, y: float) -> bool:
        """Tell whether a step leads nearer to a person who is too near already."""
        return any(
            (apart := math.hypot(other.x - x, other.y - y)) < APART
            and other is not walker
            and apart < math.hypot(other.x - walker.x, other.y - walker.y)
            for other in self._walkers
        )

    def _round_others(self, walker: _Walker, course: float, doors: dict[str, DoorState]) -> float:
        """Return a direction that passes people ahead on their right, where there is floor."""
        for other in self._walkers:
            dx, dy = other.x - walker.x, other.y - walker.y
            if abs(dx) > WIDE or abs(dy) > WIDE or other is walker:
                continue
            if math.hypot(dx, dy) < WIDE and abs(wrap_angle(math.atan2(dy, dx) - course)) < ASIDE:
                aside = wrap_angle(course - ASIDE)
                x, y = walker.x + 0.3 * math.cos(aside), walker.y + 0.3 * math.sin(aside)
                if self._footways.is_free(x, y, doors):
                    return aside
        return course


def _goals(
    plan: FloorPlan, footways: Footways, rng: np.random.Generator
) -> list[tuple[float, float]]:
    """Return goals: the plan's places and random points of rooms, none before a station."""
    doors: dict[str, DoorState] = {door.name: "open" for door in plan.doors}
    wanted = [(place.x, place.y) for place in (*plan.places, *plan.starts)]
    for room in plan.rooms:
        low, high = np.min(room.polygon, axis=0), np.max(room.polygon, axis=0)
        wanted += [(float(x), float(y)) for x, y in rng.uniform(low, high, (SPREAD, 2))]
    found = [footways.nearest(x, y, doors) for x, y in wanted]
    free = [goal for goal in found if goal is not None]
    return [
        goal
        for goal in dict.fromkeys(free)
        if all(math.dist(goal, (dock.x, dock.y)) > FROM_DOCK for dock in plan.docks)
    ] or free
