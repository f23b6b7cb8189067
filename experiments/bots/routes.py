"""Routes over a floor plan, from what a page is given of it: walls, doors, furniture. A route keeps
its distance from all of them where there is room.
"""

import math
from collections.abc import Iterable, Sequence
from itertools import pairwise

import msgspec
import numpy as np
from scipy import ndimage

from robots.api.floorplan import Door, FloorPlan, Wall
from robots.api.messages import Point
from robots.world.cell_graph import CellGraph
from robots.world.render_plan import rasterise
from robots.world.solids import leaf_end

CELL = 0.08  # metres
LEAF = 0.12  # metres: thick enough for the leaf of a door to fill half of the cells on it
CLEARANCE = 0.36  # metres from the robot's middle to anything
TIGHT = 0.30  # where no route keeps the clearance
SHUN = 0.35  # how much dearer a metre is at a metre's distance of a thing


class NoRouteError(Exception):
    """There is no route."""


class RouteGrid:
    """Routes between points of one plan. `closed` are the names of doors that are taken to be
    closed; the leaf of an open one is an obstacle, too.
    """

    def __init__(self, plan: FloorPlan, closed: Iterable[str] = ()) -> None:
        self.plan, self.closed = plan, frozenset(closed)

        def leaf(door: Door) -> Wall:
            end = leaf_end(door, "closed" if door.name in self.closed else "open")
            return Wall(start=door.start, end=end, thickness=LEAF)

        leaves = map(leaf, plan.doors)
        grid = rasterise(msgspec.structs.replace(plan, walls=(*plan.walls, *leaves)), CELL)
        self._transform = grid.transform
        self._clearance = np.asarray(ndimage.distance_transform_edt(grid.free())) * CELL
        self._graphs: dict[float, CellGraph] = {}

    def route(self, start: Point, goal: Point) -> list[Point]:
        """Return points from start to goal, in metres, each about a cell from the one before; a
        NoRouteError when there is no route, even with little clearance.
        """
        for clearance in (CLEARANCE, TIGHT):
            if found := self._route(start, goal, clearance):
                return [*found[:-1], goal]
        raise NoRouteError(
            f"no route from {start[0]:.1f}, {start[1]:.1f} to {goal[0]:.1f}, {goal[1]:.1f}"
        )

    def _route(self, start: Point, goal: Point, clearance: float) -> list[Point]:
        if clearance not in self._graphs:  # bots plan again every few seconds
            self._graphs[clearance] = CellGraph(self._clearance > clearance, CELL)
        graph = self._graphs[clearance]
        if not len(graph.rows):
            return []
        price = 1.0 + SHUN / self._clearance[graph.rows, graph.columns]
        nodes = graph.path(self._nearest(graph, start), self._nearest(graph, goal), price)
        middles = zip(graph.columns[nodes] + 0.5, graph.rows[nodes] + 0.5, strict=True)
        return [self._transform.to_world(float(x), float(y)) for x, y in middles]

    def _nearest(self, graph: CellGraph, point: Point) -> int:
        column, row = self._transform.to_pixel(*point)
        away = np.hypot(graph.rows + 0.5 - row, graph.columns + 0.5 - column)
        return int(np.argmin(away))

    def door_on(self, route: Sequence[Point], within: float) -> Door | None:
        """Return the first open door that a route reaches within so many metres of driving; None
        when there is none.
        """
        distance = 0.0
        for before, after in pairwise(route):
            distance += math.dist(before, after)
            if distance > within:
                return None
            for door in self.plan.doors:
                middle = ((door.start[0] + door.end[0]) / 2.0, (door.start[1] + door.end[1]) / 2.0)
                near = math.dist(middle, after) < math.dist(door.start, door.end) / 2.0
                if near and door.name not in self.closed:
                    return door
        return None
