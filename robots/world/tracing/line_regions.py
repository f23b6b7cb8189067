"""Line-support regions: occupied cells of like direction that hang together along one line.

1. The direction of each cell is that of the occupied cells about it (the principal axis of their
   second moments in a Gaussian window).
2. Cells of like direction are grown together along one line (Burns, Hanson and Riseman, "Extracting
   straight lines", 1986; grown as in von Gioi et al., "LSD: a line segment detector", 2012).
"""

import math
from collections import deque
from dataclasses import dataclass

import numpy as np
import scipy

from robots.world.solids import Floats
from robots.world.tracing.layers import Bools, Layers


@dataclass(frozen=True)
class RegionParams:
    """Which cells hang together; metres and radians."""

    window: float = 0.15  # standard deviation of the window in which a cell finds its direction
    alike: float = math.radians(25.0)  # between the directions of a cell and of its region
    reach: float = 0.2  # between cells of one region
    half_width: float = 0.14  # from the line of a region to its cells


REGIONS = RegionParams()


def directions(mask: Bools, sigma: float) -> tuple[Floats, Floats]:
    """Return (h, w) in which direction the cells of a mask lie about each, in [0, pi), and how
    clearly, from 0 to 1.
    """
    weight = mask.astype(np.float64)
    grid: Floats = np.array(np.indices(mask.shape), dtype=np.float64)
    y, x = -grid[0, :, :], grid[1, :, :]

    def blurred(values: Floats) -> Floats:
        result: Floats = scipy.ndimage.gaussian_filter(values * weight, sigma, truncate=2.5)
        return result

    total: Floats = np.maximum(blurred(weight), 1e-12)
    mean_x, mean_y = blurred(x) / total, blurred(y) / total
    xx: Floats = blurred(np.square(x)) / total - np.square(mean_x)
    yy: Floats = blurred(np.square(y)) / total - np.square(mean_y)
    xy: Floats = blurred(np.multiply(x, y, dtype=np.float64)) / total - mean_x * mean_y
    angle = 0.5 * np.arctan2(2.0 * xy, xx - yy) % math.pi
    clearness = np.hypot(xx - yy, 2.0 * xy) / np.maximum(xx + yy, 1e-9)
    return angle, clearness


def line_regions(mask: Bools, layers: Layers) -> list[Floats]:
    """Return the line-support regions of a mask as points (n, 2); clear cells begin."""
    angle, clearness = directions(mask, max(REGIONS.window / layers.resolution, 1.2))
    field = _Field(mask, angle, layers)
    rows, columns = mask.nonzero()
    order = np.argsort(-clearness[rows, columns], kind="stable")
    regions = []
    for seed in zip(rows[order].tolist(), columns[order].tolist(), strict=True):
        if field.is_open(seed):
            cells = np.array(field.grown(seed))
            regions.append(layers.centres(cells[:, 0], cells[:, 1]))
    return regions


class _Field:
    """The cells that belong to no region yet, in one row with a margin about the map, so that every
    cell has all of its neighbours.
    """

    def __init__(self, mask: Bools, angle: Floats, layers: Layers) -> None:
        self._reach = reach = max(1, round(REGIONS.reach / layers.resolution))
        self._across = across = int(mask.shape[1]) + 2 * reach
        self._open = bytearray(np.pad(mask, reach).tobytes())
        self._angle: list[float] = np.pad(angle, reach).ravel().tolist()
        self._width = max(REGIONS.half_width / layers.resolution, 1.25)
        self._about = [
            row * across + column
            for row in range(-reach, reach + 1)
            for column in range(-reach, reach + 1)
            if (row, column) != (0, 0)
        ]

    def is_open(self, cell: tuple[int, int]) -> bool:
        """Tell whether a cell belongs to no region yet."""
        return bool(self._open[self._place(cell)])

    def _place(self, cell: tuple[int, int]) -> int:
        return (cell[0] + self._reach) * self._across + cell[1] + self._reach

    def grown(self, seed: tuple[int, int]) -> list[tuple[int, int]]:
        """Take cells along a line, beginning with a seed. The line is fitted again whenever the
        region has doubled.
        """
        line = (float(seed[1]), float(-seed[0]), self._angle[self._place(seed)])
        cells, waiting, refit = [seed], deque([self._place(seed)]), 8
        self._open[self._place(seed)] = False
        while waiting:
            here = waiting.popleft()
            for place in self._fitting(here, line):
                self._open[place] = False
                row, column = divmod(place, self._across)
                cells.append((row - self._reach, column - self._reach))
                waiting.append(place)
            if len(cells) >= refit:
                line, refit = _line(cells), 2 * len(cells)
        return cells

    def _fitting(self, here: int, line: tuple[float, float, float]) -> list[int]:
        """Return the open places about one that lie along a line and in its direction."""
        x, y, direction = line
        cosine, sine = math.cos(direction), math.sin(direction)
        found = []
        for place in (here + step for step in self._about if self._open[here + step]):
            turn = (self._angle[place] - direction + math.pi / 2.0) % math.pi - math.pi / 2.0
            if abs(turn) > REGIONS.alike:
                continue
            row, column = divmod(place, self._across)
            away = cosine * (self._reach - row - y) - sine * (column - self._reach - x)
            if abs(away) <= self._width:
                found.append(place)
        return found


def _line(cells: list[tuple[int, int]]) -> tuple[float, float, float]:
    points = np.array(cells, dtype=np.float64)[:, ::-1] * (1.0, -1.0)
    middle, direction = principal_axis(points)
    return float(middle[0]), float(middle[1]), direction


def principal_axis(points: Floats) -> tuple[Floats, float]:
    """Return the middle (2,) of points (n, 2) and the direction in which they lie: the line with
    the least sum of squared distances.
    """
    middle = points.mean(axis=0)
    x, y = (points - middle).T
    direction = 0.5 * math.atan2(2.0 * float(x @ y), float(x @ x) - float(y @ y))
    return middle, direction % math.pi
