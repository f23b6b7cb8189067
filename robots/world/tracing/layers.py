"""A map as tracing sees it: cells that are free or occupied, not finer than needed.

Frame of everything in this package: the map's own, metres to the right and up from the lower left
corner of the image. Only `to_world` of `Layers`, which is applied last, considers a turned origin.
"""

import math
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
import numpy.typing as npt
import scipy

from robots.api.geometry import Pose2D
from robots.world.grid import OccupancyGrid
from robots.world.solids import Floats

Bools = npt.NDArray[np.bool_]
Labels = npt.NDArray[np.int32]
Cells = npt.NDArray[np.intp]
Kind = TypeVar("Kind", np.bool_, np.float64)

FINEST = 0.05  # metres: finer maps are coarsened to about this
EVERYWHERE = np.ones((3, 3), dtype=np.bool_)  # neighbours of a cell, diagonal ones included


@dataclass(frozen=True, eq=False)
class Layers:
    """`free` and `occupied` (h, w), row 0 on top; cells that are neither are unknown.

    `resolution` in metres a cell, `world_from_map` the pose of the lower left corner.
    """

    free: Bools
    occupied: Bools
    resolution: float
    world_from_map: Pose2D

    @classmethod
    def of(cls, grid: OccupancyGrid) -> "Layers":
        """Return the layers of a map; a coarse cell is occupied when any of it is, and free when
        at least half of it is and nothing of it is occupied.
        """
        factor = max(1, math.floor(FINEST / grid.transform.resolution + 1e-6))
        occupied: Bools = _blocks(grid.occupied(), factor).max(axis=(1, 3))
        free: Bools = (_blocks(grid.free(), factor).mean(axis=(1, 3)) >= 0.5) & ~occupied
        resolution = grid.transform.resolution * factor
        return cls(free, occupied, resolution, grid.transform.origin)

    @property
    def area(self) -> float:
        """Square metres of a cell."""
        return self.resolution**2

    def cells_in(self, metres: float) -> int:
        """Return a distance in whole cells, at least one."""
        return max(1, round(metres / self.resolution))

    def centres(self, rows: Cells, columns: Cells) -> Floats:
        """Return the centres (n, 2) of cells."""
        right = (columns + 0.5) * self.resolution
        up = (self.free.shape[0] - rows - 0.5) * self.resolution
        return np.column_stack([right, up])

    def at(self, mask: Bools, points: Floats) -> Bools:
        """Return a mask's values (n,) at points (n, 2), False outside of the map."""
        return self._at(mask, points, np.zeros(len(points), dtype=np.bool_))

    def values_at(self, field: Floats, points: Floats, outside: float) -> Floats:
        """Return a field's values (n,) at points (n, 2), and another one outside of the map."""
        return self._at(field, points, np.full(len(points), outside))

    def _at(
        self, field: npt.NDArray[Kind], points: Floats, result: npt.NDArray[Kind]
    ) -> npt.NDArray[Kind]:
        high, wide = field.shape
        columns = np.floor(points[:, 0] / self.resolution).astype(np.intp)
        rows = high - 1 - np.floor(points[:, 1] / self.resolution).astype(np.intp)
        inside = (rows >= 0) & (rows < high) & (columns >= 0) & (columns < wide)
        result[inside] = field[rows[inside], columns[inside]]
        return result

    def to_world(self, point: tuple[float, float]) -> tuple[float, float]:
        """Return a point of the map's frame in the world's, to the millimetre."""
        x, y = self.world_from_map.apply(*point)
        return round(x, 3), round(y, 3)

    def clearance(self, free: Bools) -> Floats:
        """Return (h, w) metres from the centre of each cell to the edge of the nearest cell that is
        not free, the outside of the map included; 0 where not free.
        """
        distance = scipy.ndimage.distance_transform_edt(np.pad(free, 1))[1:-1, 1:-1]
        clearance: Floats = np.maximum(distance - 0.5, 0.0) * self.resolution
        return clearance


def _blocks(mask: Bools, factor: int) -> Bools:
    """Return a mask as (h, factor, w, factor), padded on top and on the right, because the origin
    is the lower left corner.
    """
    high, wide = (math.ceil(side / factor) for side in mask.shape)
    padded = np.zeros((high * factor, wide * factor), dtype=np.bool_)
    padded[high * factor - mask.shape[0] :, : mask.shape[1]] = mask
    return padded.reshape(high, factor, wide, factor)


def disc(radius: int) -> Bools:
    """Return a filled circle of cells, (2 radius + 1) a side."""
    across = np.arange(-radius, radius + 1)
    return np.hypot(across[:, None], across[None, :]) <= radius + 0.5
