"""Which doors of a plan are closed, as far as the laser has seen.

A beam that ends in a doorway that it would cross has met the leaf; one that goes well behind it has
passed. Beams that end before it or graze it show nothing. A door seen closed counts so until it is
seen open, or for some time.
"""

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from robots.agent.navigation.planning.path import resampled
from robots.api.floorplan import Door, FloorPlan
from robots.api.geometry import Pose2D, wrap_angle
from robots.world.raycaster import cast
from robots.world.sensing import Floats, LaserScan


@dataclass(frozen=True)
class DoorParams:
    """Conditions for a door of the plan to count as closed."""

    memory: float = 120.0  # s for which a door that was seen closed counts so
    near: float = 4.0  # m: doorways farther off are not judged
    in_line: float = 0.15  # m from the leaf's line, within which a beam that ends has met it
    behind: float = 0.3  # m behind it, from which a beam that ends has gone through
    # share of the doorway left out at either side, for frames and open leaves
    frame: float = 0.15
    grazing: float = 0.3  # least sine of the angle between beam and leaf
    votes: int = 4  # beams of one sweep that decide
    seen_beside: float = 1e-6  # rad that a beam may look past the end of a leaf to be asked at all


DOORS = DoorParams()


class DoorWatch:
    """The doors of a plan that were seen closed."""

    def __init__(self, plan: FloorPlan | None) -> None:
        self.doors: tuple[Door, ...] = plan.doors if plan else ()
        self._seen_closed: dict[str, float] = {}

    def look(self, laser: Pose2D, beams: LaserScan, now: float) -> None:
        """Take a sweep; `laser` is the pose of the laser in the map."""
        for door in self.doors:
            middle = ((door.start[0] + door.end[0]) / 2.0, (door.start[1] + door.end[1]) / 2.0)
            if math.dist(middle, (laser.x, laser.y)) <= DOORS.near:
                self._judge(door, laser, beams, now)

    def closed(self, now: float) -> tuple[Door, ...]:
        return tuple(
            door
            for door in self.doors
            if now - self._seen_closed.get(door.name, -math.inf) <= DOORS.memory
        )

    def leaves(self, now: float) -> Floats:
        """Return points (n, 2) along the leaves of the doors that count as closed."""
        lines = [resampled(np.array([door.start, door.end])) for door in self.closed(now)]
        return np.vstack(lines) if lines else np.zeros((0, 2))

    def forget(self) -> None:
        """Take every door for open again."""
        self._seen_closed.clear()

    def _judge(self, door: Door, laser: Pose2D, beams: LaserScan, now: float) -> None:
        closed, opened = votes(door, laser, beams)
        if closed >= DOORS.votes and closed > 2 * opened:
            self._seen_closed[door.name] = now
        elif opened >= DOORS.votes and opened > 2 * closed:
            self._seen_closed.pop(door.name, None)


def votes(door: Door, laser: Pose2D, beams: LaserScan) -> tuple[int, int]:
    """Return how many beams met a door's leaf, and how many went through the doorway."""
    (x0, y0), (x1, y1) = door.start, door.end
    width, height = x1 - x0, y1 - y0
    right, up = DOORS.frame * width, DOORS.frame * height
    leaf = np.array([[x0 + right, y0 + up, x1 - right, y1 - up]])
    towards = _towards(leaf[0], laser, beams)
    if len(towards) == 0:
        return 0, 0
    directions = laser.theta + beams.angles[towards]
    reach, met = cast(leaf, laser.x, laser.y, directions)
    crossing = (
        (met >= 0)
        & (reach <= DOORS.near)
        & (np.abs(np.sin(directions - math.atan2(height, width))) >= DOORS.grazing)
    )
    ranges = np.minimum(beams.ranges[towards[crossing]], beams.range_max)
    beyond = ranges - reach[crossing]
    return int((np.abs(beyond) <= DOORS.in_line).sum()), int((beyond > DOORS.behind).sum())


def _towards(leaf: Floats, laser: Pose2D, beams: LaserScan) -> npt.NDArray[np.intp]:
    """Return the indices of beams between the ends of a leaf (4,), seen from the laser."""
    first = math.atan2(leaf[1] - laser.y, leaf[0] - laser.x)
    opening = wrap_angle(math.atan2(leaf[3] - laser.y, leaf[2] - laser.x) - first)
    turned = (beams.angles + (laser.theta - first - opening / 2.0) + math.pi) % math.tau - math.pi
    return np.flatnonzero(np.abs(turned) <= abs(opening) / 2.0 + DOORS.seen_beside)
