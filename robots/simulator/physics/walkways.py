"""The floor where people can walk in a plan, and paths from anywhere to some goals.

The plan becomes a grid of cells; a step costs its length, and more beside a wall, so that people
keep to the middle. The cheapest paths from everywhere to a goal are found once for each state of
the doors, and cached.
"""

import functools
import math

import numpy as np
import numpy.typing as npt
import scipy

from robots.api.floorplan import Door, DoorState, FloorPlan
from robots.world.cell_graph import CellGraph
from robots.world.grid import FREE
from robots.world.render_plan import rasterise
from robots.world.solids import leaf_end

CELL = 0.1
MOST_CELLS = 40_000  # a large site gets larger cells instead
SHOULDERS = 0.25  # metres from the middle of a walking person to the nearest wall
COMFORT = 0.65  # metres beyond which a wall costs nothing
DISLIKE = 1.0  # times the length of a step, directly beside a wall
CACHED_PATHS = 64

Mask = npt.NDArray[np.bool_]
Points = list[tuple[float, float]]
States = tuple[DoorState, ...]  # of the plan's doors, in their order


class Footways:
    """The free floor of a plan. Cells are counted from the lower left corner, row by row."""

    def __init__(self, plan: FloorPlan) -> None:
        corners = np.vstack([np.array(room.polygon) for room in plan.rooms])
        width, height = (corners.max(axis=0) - corners.min(axis=0)).tolist()
        self.cell = max(CELL, math.sqrt(width * height / MOST_CELLS))
        grid = rasterise(plan, self.cell)
        free = np.flipud(grid.image == FREE)
        self._origin = (grid.transform.origin.x, grid.transform.origin.y)
        self._clearance = scipy.ndimage.distance_transform_edt(free) * self.cell - self.cell / 2.0
        self._rows, self._columns = int(free.shape[0]), int(free.shape[1])
        # the doors of the last `is_free`, and the free cells
        self._last: tuple[dict[str, DoorState], bytes] | None = None
        self._plan = plan
        self._graphs: dict[States, CellGraph] = {}
        self._towards = functools.lru_cache(CACHED_PATHS)(self._next_nodes)

    def is_free(self, x: float, y: float, doors: dict[str, DoorState]) -> bool:
        if self._last is None or self._last[0] != doors:
            self._last = dict(doors), (self._graph(tuple(doors.values())).node >= 0).tobytes()
        row, column = self._cell_of(x, y)
        return (
            0 <= row < self._rows
            and 0 <= column < self._columns
            and bool(self._last[1][row * self._columns + column])
        )

    def nearest(
        self, x: float, y: float, doors: dict[str, DoorState]
    ) -> tuple[float, float] | None:
        """Return the middle of the nearest free cell, or None without any floor."""
        graph = self._graph(tuple(doors.values()))
        node = self._nearest_node(x, y, graph)
        return None if node is None else self._middle(graph, node)

    def path(
        self, start: tuple[float, float], goal: tuple[float, float], doors: dict[str, DoorState]
    ) -> Points | None:
        """Return a path's corners without the start, or None; open doors must free the goal."""
        states = tuple(doors.values())
        graph = self._graph(states)
        node, end = self._nearest_node(*start, graph), int(graph.node[self._cell_of(*goal)])
        if node is None:
            return None
        following = self._towards(end, states)
        corners = [start, self._middle(graph, node)]
        while node != end:
            node = int(following[node])
            if node < 0:
                return None
            corners.append(self._middle(graph, node))
        return self._straight(corners, graph)

    def _nearest_node(self, x: float, y: float, graph: CellGraph) -> int | None:
        if not len(graph.rows):
            return None
        row, column = self._cell_of(x, y)
        return int(np.argmin((graph.rows - row) ** 2 + (graph.columns - column) ** 2))

    def _next_nodes(self, goal: int, states: States) -> npt.NDArray[np.intp]:
        """Return each node's next one on the path to a goal, negative where there is no path."""
        graph = self._graph(states)
        clearance = self._clearance[graph.rows, graph.columns]
        near_wall = np.clip((COMFORT - clearance) / (COMFORT - SHOULDERS), 0.0, 1.0)
        return graph.from_node(goal, 1.0 + DISLIKE * near_wall)[1]

    def _straight(self, cells: Points, graph: CellGraph) -> Points:
        """Leave out the corners between which one can walk straight."""
        corners, index = [], 0
        while index < len(cells) - 1:
            ahead = index + 1
            while ahead + 1 < len(cells) and self._sees(cells[index], cells[ahead + 1], graph):
                ahead += 1
            corners.append(cells[ahead])
            index = ahead
        return corners

    def _sees(self, a: tuple[float, float], b: tuple[float, float], graph: CellGraph) -> bool:
        count = math.ceil(2.0 * math.dist(a, b) / self.cell) + 1
        columns = ((np.linspace(a[0], b[0], count) - self._origin[0]) / self.cell).astype(np.intp)
        rows = ((np.linspace(a[1], b[1], count) - self._origin[1]) / self.cell).astype(np.intp)
        return bool((graph.node[rows, columns] >= 0).all())

    def _graph(self, states: States) -> CellGraph:
        """Return the cells where a person can be with the doors in these states."""
        if states not in self._graphs:
            mask = self._clearance >= SHOULDERS
            for door, state in zip(self._plan.doors, states, strict=True):
                mask &= ~self._beside(door, state)
            self._graphs[states] = CellGraph(mask, self.cell)
        return self._graphs[states]

    def _beside(self, door: Door, state: DoorState) -> Mask:
        """Return the cells too near to the leaf of a door."""
        rows, columns = np.indices(self._clearance.shape)
        x = self._origin[0] + (columns + 0.5) * self.cell
        y = self._origin[1] + (rows + 0.5) * self.cell
        (ax, ay), (bx, by) = door.start, leaf_end(door, state)
        share = np.clip(
            ((x - ax) * (bx - ax) + (y - ay) * (by - ay)) / ((bx - ax) ** 2 + (by - ay) ** 2),
            0.0,
            1.0,
        )
        near: Mask = (
            np.hypot(x - ax - share * (bx - ax), y - ay - share * (by - ay))
            < SHOULDERS + door.leaf / 2.0
        )
        return near

    def _cell_of(self, x: float, y: float) -> tuple[int, int]:
        left, low = self._origin
        return math.floor((y - low) / self.cell), math.floor((x - left) / self.cell)

    def _middle(self, graph: CellGraph, node: int) -> tuple[float, float]:
        row, column = int(graph.rows[node]), int(graph.columns[node])
        left, low = self._origin
        return left + (column + 0.5) * self.cell, low + (row + 0.5) * self.cell
