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
    reach = max(1, round(REGIONS.reach / layers.resolution))
    about = [
        (row, column)
        for row in range(-reach, reach + 1)
        for column in range(-reach, reach + 1)
        if (row, column) != (0, 0)
    ]
    width = max(REGIONS.half_width / layers.resolution, 1.25)
    open_cells = mask.copy()
    rows, columns = mask.nonzero()
    order = np.argsort(-clearness[rows, columns], kind="stable")
    regions = []
    for seed in zip(rows[order].tolist(), columns[order].tolist(), strict=True):
        if open_cells[seed]:
            cells = np.array(_grown(seed, open_cells, angle, about, width))
            regions.append(layers.centres(cells[:, 0], cells[:, 1]))
    return regions


def _grown(
    seed: tuple[int, int],
    open_cells: Bools,
    angle: Floats,
    about: list[tuple[int, int]],
    width: float,
) -> list[tuple[int, int]]:
    """Take cells along a line from `open_cells`, beginning with a seed. The line is fitted anew
    whenever the region has doubled.
    """
    high, wide = open_cells.shape
    line = (float(seed[1]), float(-seed[0]), float(angle[seed]))
    cells, waiting, refit = [seed], deque([seed]), 8
    open_cells[seed] = False
    while waiting:
        row, column = waiting.popleft()
        for down, right in about:
            at = (row + down, column + right)
            if not (0 <= at[0] < high and 0 <= at[1] < wide and open_cells[at]):
                continue
            x, y, direction = line
            turn = abs((angle[at] - direction + math.pi / 2.0) % math.pi - math.pi / 2.0)
            away = abs(math.cos(direction) * (-at[0] - y) - math.sin(direction) * (at[1] - x))
            if turn <= REGIONS.alike and away <= width:
                open_cells[at] = False
                cells.append(at)
                waiting.append(at)
        if len(cells) >= refit:
            line, refit = _line(cells), 2 * len(cells)
    return cells


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
