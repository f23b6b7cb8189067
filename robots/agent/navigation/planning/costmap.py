"""Where a robot with a footprint may be on a map, and at what cost.

The clearance of a cell is the distance from its centre to the nearest thing. A robot's centre can
never be where the clearance is below the footprint's inscribed radius; above it the cost falls with
more room, until there is plenty.
"""

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.ndimage import distance_transform_edt

from robots.api.geometry import MapTransform
from robots.world.grid import OccupancyGrid
from robots.world.sensing import Floats

Bools = npt.NDArray[np.bool_]
Cells = npt.NDArray[np.intp]


@dataclass(frozen=True)
class CostMapParams:
    """What it costs to be near things."""

    resolution: float = 0.05  # m: finer maps are coarsened to this
    spare: float = 0.02  # m kept beyond the inscribed radius, half the error of a cell
    plenty: float = 0.3  # m beyond the circumscribed radius, from which more room is of no use
    narrow: float = 3.0  # times dearer is the narrowest place than the open floor


COSTMAP = CostMapParams()


class NoWayError(ValueError):
    """There is no way or place to go to; the message is the reason."""


class CostMap:
    """A map for one footprint, (n, 2) in the robot's frame.

    `clearance` (h, w) is in metres to the nearest thing, 0 inside of things and in unknown cells.
    `inscribed` and `circumscribed` are the least and largest distance from the robot's centre to
    the edge of its footprint, metres.
    """

    def __init__(self, grid: OccupancyGrid, footprint: Floats) -> None:
        self.free, self.transform = _coarsened(grid)
        self.footprint = np.asarray(footprint, dtype=np.float64)
        self.inscribed, self.circumscribed = _radii(self.footprint)
        self.clearance = room(self.free, self.transform.resolution)
        self.least = self.inscribed + COSTMAP.spare
        if not (self.clearance >= self.least).any():
            raise NoWayError("the map has no free space large enough for the robot")

    @property
    def shape(self) -> tuple[int, int]:
        return self.free.shape[0], self.free.shape[1]

    def cells(self, points: Floats) -> tuple[Cells, Cells, Bools]:
        """Return rows and columns (clipped) of points (n, 2) in metres, and which are inside."""
        origin, resolution = self.transform.origin, self.transform.resolution
        x, y = points[:, 0] - origin.x, points[:, 1] - origin.y
        cosine, sine = math.cos(origin.theta) / resolution, math.sin(origin.theta) / resolution
        columns = np.floor(cosine * x + sine * y).astype(np.intp)
        rows = np.floor(self.transform.height + sine * x - cosine * y).astype(np.intp)
        high, wide = self.shape
        inside = (rows >= 0) & (rows < high) & (columns >= 0) & (columns < wide)
        if not inside.all():
            rows = np.minimum(np.maximum(rows, 0), high - 1)
            columns = np.minimum(np.maximum(columns, 0), wide - 1)
        return rows, columns, inside

    def centres(self, rows: Cells, columns: Cells) -> Floats:
        """Return (n, 2) the centres of cells in metres."""
        origin, resolution = self.transform.origin, self.transform.resolution
        right, up = (columns + 0.5) * resolution, (self.transform.height - rows - 0.5) * resolution
        cosine, sine = math.cos(origin.theta), math.sin(origin.theta)
        return np.column_stack(
            [origin.x + cosine * right - sine * up, origin.y + sine * right + cosine * up]
        )

    def sample(self, layer: Floats, points: Floats) -> Floats:
        """Return the values (n,) of a layer (h, w) at points (n, 2); 0 outside of the map."""
        rows, columns, inside = self.cells(points)
        values: Floats = np.where(inside, layer[rows, columns], 0.0)
        return values

    def clearance_with(self, live: Bools) -> Floats:
        """Return the clearance (h, w) when `live` cells are occupied too."""
        if not live.any():
            return self.clearance
        return np.minimum(self.clearance, room(~live, self.transform.resolution))

    def cost(self, clearance: Floats) -> Floats:
        """Return (h, w) the price of a metre: 1 with plenty of room, `inf` without enough."""
        plenty = self.circumscribed + COSTMAP.plenty
        tightness = np.clip((plenty - clearance) / (plenty - self.least), 0.0, 1.0)
        return np.where(clearance >= self.least, 1.0 + COSTMAP.narrow * tightness**2, math.inf)


def room(free: Bools, resolution: float) -> Floats:
    """Return (h, w) metres from each cell to the nearest that is not free, less half a cell."""
    distance: Floats = np.asarray(distance_transform_edt(np.pad(free, 1)))[1:-1, 1:-1] * resolution
    return np.maximum(distance - resolution / 2.0, 0.0)


def _coarsened(grid: OccupancyGrid) -> tuple[Bools, MapTransform]:
    """Return free cells and transform at about COSTMAP.resolution; free means wholly free."""
    free = grid.free()
    factor = max(1, round(COSTMAP.resolution / grid.transform.resolution))
    if factor == 1:
        return free, grid.transform
    high, wide = (math.ceil(side / factor) for side in free.shape)
    padded = np.zeros((high * factor, wide * factor), dtype=np.bool_)
    # the origin is the lower left corner
    padded[high * factor - free.shape[0] :, : free.shape[1]] = free
    blocks: Bools = padded.reshape(high, factor, wide, factor).min(axis=(1, 3))
    return blocks, MapTransform(grid.transform.resolution * factor, grid.transform.origin, high)


def _radii(footprint: Floats) -> tuple[float, float]:
    """Return the inscribed and the circumscribed radius of a convex polygon about the origin."""
    after = np.roll(footprint, -1, axis=0)
    across = footprint[:, 0] * after[:, 1] - footprint[:, 1] * after[:, 0]
    sides = np.hypot(*(after - footprint).T)
    return float((np.abs(across) / sides).min()), float(np.hypot(*footprint.T).max())
