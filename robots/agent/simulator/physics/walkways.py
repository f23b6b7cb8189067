"""Where people can walk in a plan, and the way from anywhere to some goals.

The plan becomes a grid of cells; a step costs its length, and more beside a wall, so that people
keep to the middle. For each goal the least costs from everywhere are found once (Dijkstra) for each
state of the doors, and kept.
"""

import math
from collections import OrderedDict

import numpy as np
import numpy.typing as npt
import scipy

from robots.api.floorplan import Door, DoorState, FloorPlan
from robots.world.grid import FREE
from robots.world.render_plan import rasterise
from robots.world.solids import leaf_end

CELL = 0.1
MOST_CELLS = 40_000  # a large site gets larger cells instead
SHOULDERS = 0.25  # metres from the middle of a walking person to the nearest wall
COMFORT = 0.65  # metres beyond which a wall costs nothing
DISLIKE = 1.0  # times the length of a step, directly beside a wall
KEPT = 64
STEPS = ((0, 1), (1, 0), (1, 1), (1, -1))

Mask = npt.NDArray[np.bool_]
Points = list[tuple[float, float]]


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
        # the doors that were asked about last, and the free cells
        self._asked: tuple[dict[str, DoorState], bytes] | None = None
        self._plan = plan
        self._masks: dict[tuple[DoorState, ...], Mask] = {}
        self._ways: OrderedDict[tuple[tuple[DoorState, ...], int], npt.NDArray[np.int32]] = (
            OrderedDict()
        )

    def is_free(self, x: float, y: float, doors: dict[str, DoorState]) -> bool:
        if self._asked is None or self._asked[0] != doors:
            self._asked = dict(doors), self._mask(doors).tobytes()
        row, column = self._cell_of(x, y)
        return (
            0 <= row < self._rows
            and 0 <= column < self._columns
            and bool(self._asked[1][row * self._columns + column])
        )

    def nearest(
        self, x: float, y: float, doors: dict[str, DoorState]
    ) -> tuple[float, float] | None:
        """Return the middle of the nearest free cell, or None without any floor."""
        rows, columns = self._mask(doors).nonzero()
        if not len(rows):
            return None
        row, column = self._cell_of(x, y)
        best = int(np.argmin((rows - row) ** 2 + (columns - column) ** 2))
        return self._middle(int(rows[best]), int(columns[best]))

    def path(
        self, start: tuple[float, float], goal: tuple[float, float], doors: dict[str, DoorState]
    ) -> Points | None:
        """Return a path's corners without the start, or None; open doors must free the goal."""
        here = self.nearest(*start, doors)
        if here is None:
            return None
        index, end = self._index(*here), self._index(*goal)
        towards = self._towards(end, doors)
        cells = [index]
        while index != end:
            index = int(towards[index])
            if index < 0:
                return None
            cells.append(index)
        return self._straight(
            [start, *(self._middle(*divmod(cell, self._clearance.shape[1])) for cell in cells)],
            doors,
        )

    def _towards(self, goal: int, doors: dict[str, DoorState]) -> npt.NDArray[np.int32]:
        """Return each cell's next one on the way to the goal, negative where there is none."""
        key = (tuple(doors.values()), goal)
        if key not in self._ways:
            found = scipy.sparse.csgraph.dijkstra(
                self._graph(self._mask(doors)),
                directed=False,
                indices=goal,
                return_predecessors=True,
            )[1]
            self._ways[key] = found
            if len(self._ways) > KEPT:
                self._ways.popitem(last=False)
        self._ways.move_to_end(key)
        return self._ways[key]

    def _graph(self, mask: Mask) -> "scipy.sparse.csr_array":
        number = np.arange(mask.size).reshape(mask.shape)
        price = 1.0 + DISLIKE * np.clip(
            (COMFORT - self._clearance) / (COMFORT - SHOULDERS), 0.0, 1.0
        )
        starts, ends, costs = [], [], []
        for down, right in STEPS:
            here = (
                slice(None, -down or None),
                slice(max(0, -right), -right if right > 0 else None),
            )
            there = (slice(down, None), slice(max(0, right), right if right < 0 else None))
            both = mask[here] & mask[there]
            starts.append(number[here][both])
            ends.append(number[there][both])
            costs.append(math.hypot(down, right) * (price[here][both] + price[there][both]))
        shape = (mask.size, mask.size)
        return scipy.sparse.csr_array(
            (np.concatenate(costs), (np.concatenate(starts), np.concatenate(ends))), shape=shape
        )

    def _straight(self, cells: Points, doors: dict[str, DoorState]) -> Points:
        """Leave out the corners between which one can walk straight."""
        corners, index = [], 0
        while index < len(cells) - 1:
            ahead = index + 1
            while ahead + 1 < len(cells) and self._sees(cells[index], cells[ahead + 1], doors):
                ahead += 1
            corners.append(cells[ahead])
            index = ahead
        return corners

    def _sees(
        self, a: tuple[float, float], b: tuple[float, float], doors: dict[str, DoorState]
    ) -> bool:
        count = math.ceil(2.0 * math.dist(a, b) / self.cell) + 1
        columns = ((np.linspace(a[0], b[0], count) - self._origin[0]) / self.cell).astype(np.intp)
        rows = ((np.linspace(a[1], b[1], count) - self._origin[1]) / self.cell).astype(np.intp)
        return bool(self._mask(doors)[rows, columns].all())

    def _mask(self, doors: dict[str, DoorState]) -> Mask:
        """Return the cells where a person can be with the doors as they are."""
        key = tuple(doors.values())
        if key not in self._masks:
            mask = self._clearance >= SHOULDERS
            for door in self._plan.doors:
                mask &= ~self._beside(door, doors[door.name])
            self._masks[key] = mask
        return self._masks[key]

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

    def _index(self, x: float, y: float) -> int:
        row, column = self._cell_of(x, y)
        return row * int(self._clearance.shape[1]) + column

    def _middle(self, row: int, column: int) -> tuple[float, float]:
        return self._origin[0] + (column + 0.5) * self.cell, self._origin[1] + (
            row + 0.5
        ) * self.cell
