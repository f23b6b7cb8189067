"""The shortest path that a robot could have driven, to which its own path is compared.

The navigation's planner keeps away from walls and pays for it; here a path costs its length alone.
"""

import math
from functools import lru_cache

import msgspec
import numpy as np
import scipy

from experiments.dataset.columns import Floats
from robots.api.floorplan import FloorPlan, Wall
from robots.world.cell_graph import KNIGHT, CellGraph
from robots.world.render_plan import rasterise

RADIUS = 0.22  # m: half of the narrower side of the robots that there are
REACH = 1.0  # m: points nearer to an obstacle than RADIUS are moved to a free cell within this
Point = tuple[float, float]


class ShortestPaths:
    def __init__(self, plan: FloorPlan, closed: frozenset[str] = frozenset()) -> None:
        shut = (door for door in plan.doors if door.name in closed)
        leaves = (Wall(start=it.start, end=it.end, thickness=it.thickness) for it in shut)
        # The body of a charging station is where the robot docks, not an obstacle.
        grid = rasterise(msgspec.structs.replace(plan, walls=(*plan.walls, *leaves), docks=()))
        resolution = grid.transform.resolution
        clearance = np.asarray(scipy.ndimage.distance_transform_edt(grid.free())) * resolution
        self._graph = CellGraph(clearance >= RADIUS, resolution, KNIGHT)
        cells = zip(self._graph.columns.tolist(), self._graph.rows.tolist(), strict=True)
        places = [grid.transform.to_world(column + 0.5, row + 0.5) for column, row in cells]
        self._tree = scipy.spatial.KDTree(np.array(places).reshape(-1, 2))
        self._lengths: dict[Point, Floats] = {}  # by goal

    def length(self, start: Point, goal: Point) -> float:
        """Return the length in metres of the shortest path to a goal; NaN where there is none."""
        if goal not in self._lengths:
            node = self.nearest(goal)
            self._lengths[goal] = self._graph.from_node(node)[0] if node >= 0 else np.empty(0)
        node, lengths = self.nearest(start), self._lengths[goal]
        is_known = node >= 0 and lengths.size > 0 and math.isfinite(lengths[node])
        return float(lengths[node]) if is_known else math.nan

    def nearest(self, point: Point) -> int:
        """Return the node nearest to a point, or -1."""
        distance, node = self._tree.query(point, distance_upper_bound=REACH)
        return int(node) if math.isfinite(distance) else -1


_paths = lru_cache(maxsize=32)(ShortestPaths)


def nearer(plan: FloorPlan, closed: frozenset[str], goal: Point, start: Point, end: Point) -> float:
    """Return by how many metres the shortest path to a goal is shorter from `end` than from
    `start`; NaN when there is none. By the triangle inequality, no path between them is shorter.
    Unlike the path to its centre, it ends at a checkpoint's rim, where the robot passes it.
    """
    paths = _paths(plan, closed)
    return paths.length(start, goal) - paths.length(end, goal)
