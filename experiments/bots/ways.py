"""RouteGrid over a floor plan, from what a page is given of it: walls, doors, furniture. Short ones
that keep off everything.

A raster of the floor, the distance of each cell to the nearest thing, and Dijkstra's way through
what is left, dearer near things.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt
from scipy import ndimage
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

from robots.api.floorplan import Door, FloorPlan
from robots.api.geometry import Pose2D
from robots.api.messages import Point

CELL = 0.08  # metres
CLEARANCE = 0.36  # metres from the robot's middle to anything
TIGHT = 0.30  # where no way keeps the clearance
SHUN = 0.35  # how much dearer a metre is at a metre's distance of a thing
STEPS = ((0, 1, 1.0), (1, 0, 1.0), (1, 1, math.sqrt(2.0)), (1, -1, math.sqrt(2.0)))

Cells = npt.NDArray[np.float64]


class NoRouteError(Exception):
    """No way leads there."""


@dataclass(frozen=True)
class _Raster:
    x: float
    y: float
    rows: int
    columns: int

    def centres(self) -> tuple[Cells, Cells]:
        return np.meshgrid(
            self.x + (np.arange(self.columns) + 0.5) * CELL,
            self.y + (np.arange(self.rows) + 0.5) * CELL,
        )


class RouteGrid:
    """RouteGrid between points of one plan.

    Args:
        plan: the site.
        closed: names of doors that are taken to be closed.
        series: the robot, whose own station is no obstacle on the way to it.
    """

    def __init__(self, plan: FloorPlan, closed: Iterable[str] = ()) -> None:
        self.plan, self.closed = plan, frozenset(closed)
        self._raster = _raster(plan)
        self._room = _room(plan, self.closed, self._raster)

    def way(self, start: Point, goal: Point) -> list[Point]:
        """Return points from start to goal, in metres, each about a cell from the one before.

        Raises:
            NoWayError: there is none, even with little clearance.
        """
        for clearance in (CLEARANCE, TIGHT):
            found = self._way(start, goal, clearance)
            if found is not None:
                return [*found[:-1], goal] if len(found) > 1 else [goal]
        raise NoRouteError(
            f"no route from {start[0]:.1f}, {start[1]:.1f} to {goal[0]:.1f}, {goal[1]:.1f}"
        )

    def _way(self, start: Point, goal: Point, clearance: float) -> list[Point] | None:
        free = self._room > clearance
        cells = np.argwhere(free)
        if not len(cells):
            return None
        number = np.full(free.shape, -1)
        number[free] = np.arange(len(cells))
        here, there = self._nearest(cells, start), self._nearest(cells, goal)
        costs, towards = dijkstra(
            _graph(cells, number, self._room),
            indices=there,
            return_predecessors=True,
            directed=False,
        )
        if not math.isfinite(costs[here]):
            return None
        found = [here]
        while found[-1] != there:
            found.append(int(towards[found[-1]]))
        return [self._point(cells[index]) for index in found]

    def _nearest(self, cells: npt.NDArray[np.int64], point: Point) -> int:
        column, row = (
            (point[0] - self._raster.x) / CELL - 0.5,
            (point[1] - self._raster.y) / CELL - 0.5,
        )
        return int(np.argmin((cells[:, 0] - row) ** 2 + (cells[:, 1] - column) ** 2))

    def _point(self, cell: npt.NDArray[np.int64]) -> Point:
        return self._raster.x + (float(cell[1]) + 0.5) * CELL, self._raster.y + (
            float(cell[0]) + 0.5
        ) * CELL

    def door_on(self, way: Sequence[Point], within: float) -> str | None:
        """Return the first open door that a way comes to within so many metres of driving; None
        when there is none.
        """
        driven = 0.0
        for before, after in pairwise(way):
            driven += math.dist(before, after)
            if driven > within:
                return None
            for door in self.plan.doors:
                middle = ((door.start[0] + door.end[0]) / 2.0, (door.start[1] + door.end[1]) / 2.0)
                if (
                    door.name not in self.closed
                    and math.dist(middle, after) < math.dist(door.start, door.end) / 2.0
                ):
                    return door.name
        return None


def _raster(plan: FloorPlan) -> _Raster:
    corners = np.array([corner for room in plan.rooms for corner in room.polygon])
    low, high = corners.min(axis=0) - 0.5, corners.max(axis=0) + 0.5
    columns, rows = np.ceil((high - low) / CELL).astype(int)
    return _Raster(float(low[0]), float(low[1]), int(rows), int(columns))


def _room(plan: FloorPlan, closed: frozenset[str], raster: _Raster) -> Cells:
    """Return metres from each cell to the nearest thing; 0 on things and where
    there is no floor.
    """
    x, y = raster.centres()
    free = np.zeros(x.shape, bool)
    for room in plan.rooms:
        free |= _inside(room.polygon, x, y)
    for opening in plan.openings:
        free |= _strip(opening.start, opening.end, opening.thickness / 2.0 + CELL, x, y)
    taken = _walls(plan, x, y) | _furniture(plan, x, y) | _stations(plan, x, y)
    for door in plan.doors:
        taken |= (
            _strip(door.start, door.end, CELL, x, y) if door.name in closed else _leaf(door, x, y)
        )
    distances: Cells = ndimage.distance_transform_edt(free & ~taken) * CELL
    return distances


def _walls(plan: FloorPlan, x: Cells, y: Cells) -> npt.NDArray[np.bool_]:
    taken = np.zeros(x.shape, bool)
    for wall in plan.walls:
        taken |= _strip(wall.start, wall.end, wall.thickness / 2.0, x, y)
    return taken


def _furniture(plan: FloorPlan, x: Cells, y: Cells) -> npt.NDArray[np.bool_]:
    taken = np.zeros(x.shape, bool)
    for piece in plan.furniture:
        if piece.shape == "cylinder":
            taken |= np.hypot(x - piece.x, y - piece.y) <= piece.width / 2.0
        else:
            taken |= _box(
                Pose2D(piece.x, piece.y, piece.theta), piece.width / 2.0, piece.depth / 2.0, x, y
            )
    return taken


def _stations(plan: FloorPlan, x: Cells, y: Cells) -> npt.NDArray[np.bool_]:
    taken = np.zeros(x.shape, bool)
    for dock in plan.docks:
        ahead = dock.station.distance + dock.station.depth / 2.0
        middle = Pose2D(dock.x, dock.y, dock.theta).compose(Pose2D(ahead, 0.0, 0.0))
        taken |= _box(middle, dock.station.depth / 2.0, dock.station.width / 2.0, x, y)
    return taken


def _leaf(door: Door, x: Cells, y: Cells) -> npt.NDArray[np.bool_]:
    """An open door stands in the room, turned about its hinge."""
    dx, dy = door.end[0] - door.start[0], door.end[1] - door.start[1]
    cosine, sine = math.cos(door.swing), math.sin(door.swing)
    end = door.start[0] + cosine * dx - sine * dy, door.start[1] + sine * dx + cosine * dy
    return _strip(door.start, end, door.leaf, x, y)


def _strip(start: Point, end: Point, half: float, x: Cells, y: Cells) -> npt.NDArray[np.bool_]:
    """Cells within `half` metres of a line."""
    dx, dy = end[0] - start[0], end[1] - start[1]
    share = np.clip(
        ((x - start[0]) * dx + (y - start[1]) * dy) / max(dx * dx + dy * dy, 1e-9), 0.0, 1.0
    )
    near: npt.NDArray[np.bool_] = np.hypot(
        x - start[0] - share * dx, y - start[1] - share * dy
    ) <= max(half, CELL / 2.0)
    return near


def _box(at: Pose2D, half_x: float, half_y: float, x: Cells, y: Cells) -> npt.NDArray[np.bool_]:
    cosine, sine = math.cos(at.theta), math.sin(at.theta)
    along, across = (x - at.x) * cosine + (y - at.y) * sine, (y - at.y) * cosine - (x - at.x) * sine
    inside: npt.NDArray[np.bool_] = (np.abs(along) <= half_x) & (np.abs(across) <= half_y)
    return inside


def _inside(polygon: Sequence[Point], x: Cells, y: Cells) -> npt.NDArray[np.bool_]:
    """Even-odd rule, for all cells at once."""
    inside = np.zeros(x.shape, bool)
    for (ax, ay), (bx, by) in zip(polygon, (*polygon[1:], polygon[0]), strict=True):
        if ay != by:
            inside ^= ((ay > y) != (by > y)) & (x < ax + (y - ay) / (by - ay) * (bx - ax))
    return inside


def _graph(cells: npt.NDArray[np.int64], number: npt.NDArray[np.int64], room: Cells) -> coo_array:
    padded = np.pad(number, 1, constant_values=-1)
    dear = 1.0 + SHUN / room[tuple(cells.T)]
    origins, ends, costs = [], [], []
    for down, right, length in STEPS:
        end = padded[cells[:, 0] + down + 1, cells[:, 1] + right + 1]
        origin = np.flatnonzero(end >= 0)
        origins.append(origin)
        ends.append(end[origin])
        costs.append(length * CELL * dear[origin])
    return coo_array(
        (np.concatenate(costs), (np.concatenate(origins), np.concatenate(ends))),
        shape=(len(cells), len(cells)),
    ).tocsr()
