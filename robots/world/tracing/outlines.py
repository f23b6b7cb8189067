"""The edge of a set of cells as polygons: crack following, then the line simplification of Douglas
and Peucker (1973).
"""

import numpy as np

from robots.world.solids import Floats
from robots.world.tracing.layers import Bools, Layers

MOST_POINTS = 200  # of a room in a plan
Corner = tuple[int, int]


def outlines(mask: Bools) -> list[Floats]:
    """Return the closed outlines of a mask (h, w) as corners (n, 2) of cells, (row, column), the
    mask on the same side of every step; the longest-reaching first is not promised.
    """
    following: dict[Corner, list[Corner]] = {}
    padded = np.pad(mask, 1)
    inner = padded[1:-1, 1:-1]
    # for each side of a cell beyond which there is none of the mask, a step along that side
    for beyond, start, end in (
        (padded[:-2, 1:-1], (0, 0), (0, 1)),
        (padded[1:-1, 2:], (0, 1), (1, 1)),
        (padded[2:, 1:-1], (1, 1), (1, 0)),
        (padded[1:-1, :-2], (1, 0), (0, 0)),
    ):
        for row, column in np.argwhere(inner & ~beyond).tolist():
            at = (row + start[0], column + start[1])
            following.setdefault(at, []).append((row + end[0], column + end[1]))
    return [np.array(loop, dtype=np.float64) for loop in _loops(following)]


def _loops(following: dict[Corner, list[Corner]]) -> list[list[Corner]]:
    loops = []
    while following:
        at = first = next(iter(following))
        loop, before = [], None
        while True:
            loop.append(at)
            after = _next(following, at, before)
            before, at = at, after
            if at == first:
                break
        loops.append(loop)
    return loops


def _next(following: dict[Corner, list[Corner]], at: Corner, before: Corner | None) -> Corner:
    """Take a step; where two cells touch at a corner, turn so that they stay two."""
    steps = following[at]
    chosen = steps[0]
    if len(steps) > 1 and before is not None:
        straight = (at[0] - before[0], at[1] - before[1])
        right = (straight[1], -straight[0])
        chosen = next((s for s in steps if (s[0] - at[0], s[1] - at[1]) == right), chosen)
    steps.remove(chosen)
    if not steps:
        del following[at]
    return chosen


def simplified(loop: Floats, tolerance: float) -> Floats:
    """Return a closed outline (n, 2) with fewer corners, none of the old ones farther than
    `tolerance` from the new outline.
    """
    if len(loop) <= 4:
        return loop
    far = int(np.argmax(((loop - loop[0]) ** 2).sum(axis=1)))
    first = _line(loop[: far + 1], tolerance)
    second = _line(np.vstack([loop[far:], loop[:1]]), tolerance)
    return np.vstack([first[:-1], second[:-1]])


def _line(points: Floats, tolerance: float) -> Floats:
    keep = np.zeros(len(points), dtype=np.bool_)
    keep[0] = keep[-1] = True
    waiting = [(0, len(points) - 1)]
    while waiting:
        start, end = waiting.pop()
        if end - start < 2:
            continue
        away = _distances(points[start + 1 : end], points[start], points[end])
        worst = int(np.argmax(away))
        if away[worst] > tolerance:
            middle = start + 1 + worst
            keep[middle] = True
            waiting += [(start, middle), (middle, end)]
    return points[keep]


def _distances(points: Floats, start: Floats, end: Floats) -> Floats:
    along = end - start
    length = float(np.hypot(*along))
    if length == 0.0:
        away: Floats = np.hypot(*(points - start).T)
        return away
    away = np.abs(along[0] * (points[:, 1] - start[1]) - along[1] * (points[:, 0] - start[0]))
    return away / length


def polygon_of(mask: Bools, layers: Layers, tolerance: float, least_hole: float) -> Floats:
    """Return one polygon (n, 2), metres in the map's frame, around the largest part of a mask.

    Holes of at least `least_hole` m² are cut in: a slit of no width leads to each, which the
    even-odd rule of a plan's rooms does not notice. It has at most `MOST_POINTS` corners.
    """
    loops = outlines(mask)
    areas = [_area(loop) for loop in loops]
    outer = int(np.argmax(np.abs(areas)))
    holes = [
        loop
        for loop, area in zip(loops, areas, strict=True)
        if area * areas[outer] < 0.0 and abs(area) * layers.area >= least_hole
    ]
    corners, coarse = MOST_POINTS + 1, tolerance / layers.resolution
    while corners > MOST_POINTS:
        ring = simplified(loops[outer], coarse)
        for hole in holes:
            ring = _with_hole(ring, simplified(hole, coarse))
        corners, coarse = len(ring), coarse * 1.5
        holes = holes if coarse < 40.0 else []
    return np.column_stack(
        [ring[:, 1] * layers.resolution, (mask.shape[0] - ring[:, 0]) * layers.resolution]
    )


def _with_hole(ring: Floats, hole: Floats) -> Floats:
    apart = np.hypot(ring[:, None, 0] - hole[None, :, 0], ring[:, None, 1] - hole[None, :, 1])
    at, begin = np.unravel_index(int(np.argmin(apart)), apart.shape)
    around = np.roll(hole, -int(begin), axis=0)
    return np.vstack([ring[: at + 1], around, around[:1], ring[at:]])


def _area(loop: Floats) -> float:
    """Return the signed area of a closed outline, its sign that of its direction."""
    after = np.roll(loop, -1, axis=0)
    return float((loop[:, 0] * after[:, 1] - after[:, 0] * loop[:, 1]).sum() / 2.0)
