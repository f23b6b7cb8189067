"""The shortest way that a robot could have driven: what its own way is compared with.

Not the navigation's planner, which keeps away from walls and pays for it: here every metre counts.
Dijkstra over the cells that are a robot's radius from everything, with the steps of a chess knight
beside those of a king, so that a straight line is at most 3 % too long.
"""

import math
from collections.abc import Iterable
from functools import lru_cache

import msgspec
import numpy as np
import scipy

from experiments.analysis.dataset.records import Floats
from robots.api.floorplan import FloorPlan, Wall
from robots.world.render_plan import rasterise

RADIUS = 0.22  # m: half of the narrower side of the robots that there are
REACH = 1.0  # m: a point nearer to something than RADIUS stands for the nearest cell within this
STEPS = ((0, 1), (1, 0), (1, 1), (1, -1), (1, 2), (2, 1), (1, -2), (2, -1))
Point = tuple[float, float]


class Ways:
    """The shortest ways on one plan with some doors closed."""

    def __init__(self, plan: FloorPlan, closed: Iterable[str] = ()) -> None:
        leaves = tuple(
            Wall(start=door.start, end=door.end, thickness=door.thickness)
            for door in plan.doors
            if door.name in set(closed)
        )
        # The body of a charging station is where the robot docks, not in its way.
        grid = rasterise(msgspec.structs.replace(plan, walls=(*plan.walls, *leaves), docks=()))
        self._resolution = grid.transform.resolution
        self._free = (
            np.asarray(scipy.ndimage.distance_transform_edt(grid.free())) * self._resolution
            >= RADIUS
        )
        self._node = np.full(self._free.shape, -1, dtype=np.intp)
        self._node[self._free] = np.arange(int(self._free.sum()))
        rows, columns = np.nonzero(self._free)
        self._places = np.array(
            [
                grid.transform.to_world(c + 0.5, r + 0.5)
                for r, c in zip(rows.tolist(), columns.tolist(), strict=True)
            ]
        )
        self._places = self._places.reshape(-1, 2)
        self._tree = scipy.spatial.KDTree(self._places)
        self._graph = self._edges()

    def to(self, goal: Point) -> Floats:
        """Return the length in metres of the shortest way to a goal from every place, and a NaN
        behind them; NaN where there is none.
        """
        node = self.nearest(goal)
        if node < 0:
            return np.full(len(self._places) + 1, np.nan)
        found = np.asarray(scipy.sparse.csgraph.dijkstra(self._graph, directed=False, indices=node))
        return np.append(np.where(np.isfinite(found), found, np.nan), np.nan)

    def nearest(self, point: Point) -> int:
        """Return the place nearest to a point, or -1, which the lengths have a NaN for."""
        away, node = self._tree.query(point, distance_upper_bound=REACH)
        return int(node) if math.isfinite(away) else -1

    def _edges(self) -> "scipy.sparse.csr_matrix":
        starts, ends, lengths = [], [], []
        for down, right in STEPS:
            here = self._node[: -down or None, max(0, -right) : -right if right > 0 else None]
            there = self._node[down:, max(0, right) : right if right < 0 else None]
            both = (here >= 0) & (there >= 0)
            starts.append(here[both])
            ends.append(there[both])
            lengths.append(np.full(int(both.sum()), math.hypot(down, right) * self._resolution))
        size = len(self._places)
        return scipy.sparse.csr_matrix(
            (np.concatenate(lengths), (np.concatenate(starts), np.concatenate(ends))),
            shape=(size, size),
        )


@lru_cache(maxsize=32)
def ways(plan: FloorPlan, closed: frozenset[str]) -> Ways:
    """Return the shortest ways of a plan, made once."""
    return Ways(plan, closed)


@lru_cache(maxsize=1024)
def _to(plan: FloorPlan, closed: frozenset[str], goal: Point) -> Floats:
    return ways(plan, closed).to(goal)


def nearer(plan: FloorPlan, closed: frozenset[str], goal: Point, start: Point, end: Point) -> float:
    """Return by how many metres the shortest way to a goal is shorter from `end` than from `start`;
    NaN when there is none.

    By the triangle inequality nobody gets from start to end in less. A checkpoint is passed at its
    rim: what is left to its middle need not be driven, and does not count.
    """
    lengths, places = _to(plan, closed, goal), ways(plan, closed)
    return float(lengths[places.nearest(start)] - lengths[places.nearest(end)])
