"""A site as it really is, doors and all, to judge what a robot did in it by: where it could stand,
and the shortest way.
"""

import math

import numpy as np

from robots.agent.navigation.planning.costmap import CostMap, NoWayError
from robots.agent.navigation.planning.planner import Planner
from robots.api.floorplan import DoorState
from robots.world.grid import OCCUPIED, OccupancyGrid
from robots.world.robot_models import RobotModel
from robots.world.sensing import Floats
from robots.world.sites import Site
from robots.world.solids import inside, leaf_solid

ROOM = 0.05  # metres beyond the circumscribed radius that a start needs
APART = 2.0  # metres between start and goal, at least
Spot = tuple[float, float]
LEAF_ROOM = 0.03  # a leaf is thinner than a cell: metres


class _Flat(CostMap):
    """A cost map on which only the way counts."""

    def cost(self, clearance: Floats) -> Floats:
        return np.where(clearance >= self.least, 1.0, math.inf)


class TrueWorld:
    """One site for one robot."""

    def __init__(self, site: Site, model: RobotModel) -> None:
        self.site, self.model = site, model
        self._planners: dict[tuple[tuple[str, str], ...], Planner] = {}

    def shortest(self, start: Spot, goal: Spot, doors: dict[str, DoorState]) -> float | None:
        """Return the length in metres of the shortest way with the doors so, None when there is
        none or the goal is not free.
        """
        try:
            planner = self._planner(doors)
            path = planner.plan(start, goal, planner.costmap.clearance)
        except NoWayError:
            return None
        return path.length if path else None

    def start(
        self, rng: np.random.Generator, doors: dict[str, DoorState]
    ) -> tuple[float, float, float]:
        """Return a random pose at which the robot can stand and turn."""
        costmap = self._planner(doors).costmap
        rows, columns = np.nonzero(costmap.clearance > costmap.circumscribed + ROOM)
        while True:
            index = int(rng.integers(len(rows)))
            x, y = (
                float(value)
                for value in costmap.centres(rows[index : index + 1], columns[index : index + 1])[0]
            )
            if self.site.plan.room_at(x, y) is not None:  # a doorway is no room
                return x, y, float(rng.uniform(-math.pi, math.pi))

    def goal(self, rng: np.random.Generator, start: Spot, doors: dict[str, DoorState]) -> Spot:
        """Return another place, not too near, that can be reached while the doors are so."""
        while True:
            x, y, _ = self.start(rng, doors)
            if (
                math.dist((x, y), start) >= APART
                and self.shortest(start, (x, y), doors) is not None
            ):
                return x, y

    def _planner(self, doors: dict[str, DoorState]) -> Planner:
        key = tuple(sorted(doors.items()))
        if key not in self._planners:
            self._planners[key] = Planner(_Flat(self._grid(doors), np.array(self.model.footprint)))
        return self._planners[key]

    def _grid(self, doors: dict[str, DoorState]) -> OccupancyGrid:
        grid = self.site.grid
        image = grid.image.copy()
        rows, columns = np.indices(image.shape)
        transform = grid.transform
        x = transform.origin.x + (columns + 0.5) * transform.resolution
        y = transform.origin.y + (transform.height - rows - 0.5) * transform.resolution
        for door in self.site.plan.doors:
            leaf = leaf_solid(door, doors.get(door.name, door.state)).outline
            thicker = leaf + LEAF_ROOM * np.sign(leaf - leaf.mean(axis=0))
            image[inside(thicker, x, y)] = OCCUPIED
        return OccupancyGrid(image, transform, grid.negate, grid.occupied_thresh, grid.free_thresh)
