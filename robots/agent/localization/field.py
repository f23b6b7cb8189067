"""The localizer's map: the distance of every place from the nearest surface.

The signed distance is positive in the open, negative inside of things and zero on their surface,
half a cell from the centres of the cells on both sides. All is in the field's own frame: metres to
the right and up from the lower left corner of the map's image less a margin, so that places off the
map are far from everything on it.
"""

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from robots.api.geometry import Pose2D
from robots.world.grid import MapError, OccupancyGrid
from robots.world.sensing import Floats

Bools = npt.NDArray[np.bool_]
STEPS = 80  # of a ray; most end after a dozen
ROUNDING = 1e-9  # by which a ray ends before the map does, so that its last step lies on it
MARGIN = 1.0  # metres; no beam that ends so far from everything says anything


@dataclass(frozen=True, eq=False)
class DistanceField:
    """`signed` (h, w) metres and `free` (h, w), row 0 at the bottom, cells of `resolution` metres.
    `world_from_field` is the field's pose in the world, turned maps included.
    """

    signed: Floats
    free: Bools
    resolution: float
    world_from_field: Pose2D

    def cells(self, x: Floats, y: Floats) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]:
        """Return row and column of the cells at points of any shape; off the map, at its edge."""
        rows, columns = self.signed.shape
        row = np.minimum(np.maximum(y / self.resolution, 0.0), rows - 1).astype(np.intp)
        column = np.minimum(np.maximum(x / self.resolution, 0.0), columns - 1).astype(np.intp)
        return row, column

    def look_up(self, layer: Floats, x: Floats, y: Floats) -> Floats:
        """Return a layer's (h, w) values at points of any shape; off the map, at its edge."""
        row, column = self.cells(x, y)
        row *= layer.shape[1]
        row += column
        return layer.ravel().take(row)

    def inside(self, x: Floats, y: Floats) -> Bools:
        """Tell which points, of any shape, are on the map."""
        high, wide = self.signed.shape[0] * self.resolution, self.signed.shape[1] * self.resolution
        on_map: Bools = (x >= 0.0) & (y >= 0.0) & (x < wide) & (y < high)
        return on_map

    def is_free(self, x: Floats, y: Floats) -> Bools:
        """Tell which points, of any shape, are free; none is off the map."""
        free: Bools = self.free[self.cells(x, y)] & self.inside(x, y)
        return free

    def distances(self, x: Floats, y: Floats) -> tuple[Floats, Floats, Floats]:
        """Return the interpolated signed distance and its slopes along x and y, any shape."""
        rows, columns = self.signed.shape
        across = np.minimum(np.maximum(x / self.resolution - 0.5, 0.0), columns - 1.001)
        up = np.minimum(np.maximum(y / self.resolution - 0.5, 0.0), rows - 1.001)
        column, row = across.astype(np.intp), up.astype(np.intp)
        right, above = across - column, up - row
        corner = row * columns + column
        flat = self.signed.ravel()
        here, north = flat.take(corner), flat.take(corner + columns)
        eastwards = flat.take(corner + 1) - here
        along_north = flat.take(corner + (columns + 1)) - north
        low, high = here + right * eastwards, north + right * along_north
        northwards = high - low
        slope_x = (eastwards + above * (along_north - eastwards)) / self.resolution
        return low + above * northwards, slope_x, northwards / self.resolution

    def cast(self, x: Floats, y: Floats, angles: Floats, reach: float | Floats) -> Floats:
        """Return how far rays from (x, y) go to a surface, at most `reach`; all of one shape.

        Each step is as long as the distance field is free (sphere tracing); an end may lie up to a
        cell in the wall. Rays that leave the map meet nothing, so no step checks its edge. A
        shorter reach needs fewer steps.
        """
        cosine, sine = np.cos(angles), np.sin(angles)
        columns, signed = self.signed.shape[1], self.signed.ravel()
        edge = np.minimum(self._leaves(x, y, cosine, sine), reach)
        x, y, cosine, sine = (part / self.resolution for part in (x, y, cosine, sine))  # in cells
        travelled, ahead = np.zeros(edge.shape), np.ones(edge.shape)
        for _ in range(STEPS):
            cell = (y + travelled * sine).astype(np.intp) * columns
            cell += (x + travelled * cosine).astype(np.intp)
            ahead = signed.take(cell, mode="clip")
            going = (ahead > 0.0) & (travelled < edge)
            if not going.any():
                break
            travelled += ahead * going
        return np.where((ahead <= 0.0) & (travelled < edge), travelled, reach)

    def _leaves(self, x: Floats, y: Floats, cosine: Floats, sine: Floats) -> Floats:
        """Return how far rays (n,) go before they leave the map, negative from outside of it."""
        high, wide = self.signed.shape[0] * self.resolution, self.signed.shape[1] * self.resolution
        with np.errstate(divide="ignore", invalid="ignore"):
            across = np.maximum(-x / cosine, (wide - x) / cosine)
            up = np.maximum(-y / sine, (high - y) / sine)
        edge: Floats = np.fmin(across, up) * (1.0 - ROUNDING)
        return np.where(self.inside(x, y), edge, -1.0)


def field_of(grid: OccupancyGrid) -> DistanceField:
    """Return the field of a map; MapError without free space, or without obstacles."""
    free, occupied = grid.free()[::-1], grid.occupied()[::-1]
    if not free.any():
        raise MapError("the map has no free space for a robot")
    if not occupied.any():
        raise MapError("the map has no obstacles: a laser cannot tell places apart")
    resolution = grid.transform.resolution
    margin = math.ceil(MARGIN / resolution)
    corner = grid.transform.origin.compose(Pose2D(-margin * resolution, -margin * resolution, 0.0))
    signed = signed_distance(np.pad(occupied, margin), resolution)
    return DistanceField(signed, np.pad(free, margin), resolution, corner)


def signed_distance(occupied: Bools, resolution: float) -> Floats:
    """Return (h, w) metres from cell centres to the nearest surface, negative inside."""
    outside = ndimage.distance_transform_edt(~occupied)
    within = np.full(occupied.shape, float(max(occupied.shape)))
    if not occupied.all():
        within = ndimage.distance_transform_edt(occupied)
    signed: Floats = np.where(occupied, 0.5 - within, outside - 0.5) * resolution
    return signed
