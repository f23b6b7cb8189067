"""The middle of narrow places, finer than the cells of the map.

In a gap hardly wider than the robot, half a cell and a few centimetres of pose error decide whether
it touches. There each point of a path is moved across it to where the least distance to obstacles
on both sides is largest: the ridge of the clearance. An obstacle on one side only moves nothing. A
plan is centred between the squares of the occupied cells, and once more, while it is driven,
between what the laser sees.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from robots.agent.navigation.planning.costmap import Cells, CostMap
from robots.world.sensing import Floats


@dataclass(frozen=True)
class CentringParams:
    """Limits on moving a path towards the middle."""

    tight: float = 0.15  # m of room beside the robot, below which a place is narrow
    too_tight: float = 0.06  # m that a place may seem too narrow and be driven into nevertheless
    aside: float = 0.14  # m that a point is moved at most
    step: float = 0.01  # m between two places that are tried
    alike: float = 0.001  # m of room that are worth no move
    blend: float = 0.2  # m along the path over which moves are made alike
    fade: float = 0.5  # m before and behind a narrow place over which the path returns
    from_end: float = 0.5  # m over which it leaves its ends, which stay where they are
    along: int = 3  # points to both sides from which the direction is taken


CENTRING = CentringParams()
NEAREST = 4  # cells by their centres, one of which has the nearest edge
Distances = Callable[[Floats], Floats]


def centred_on_map(line: Floats, along: Floats, clearance: Floats, costmap: CostMap) -> Floats:
    """Return a line (n, 2), `along` (n,) metres along, centred in its narrow places."""
    enough = costmap.inscribed + CENTRING.tight
    narrow = np.flatnonzero(costmap.sample(clearance, line) < enough)
    cells = _occupied_about(line[narrow], enough + CENTRING.aside, clearance, costmap)
    if len(cells) == 0:
        return line
    return _centred(line, along, narrow, _to_squares(cells, costmap), costmap.inscribed)


def centred_between(line: Floats, along: Floats, points: Floats, half_width: float) -> Floats:
    """Return the same between points (m, 2) for a robot of that half width, metres."""
    enough = half_width + CENTRING.tight
    reach = enough + CENTRING.aside
    low, high = line.min(axis=0) - reach, line.max(axis=0) + reach
    near = points[((points >= low) & (points <= high)).all(axis=1)]
    if len(near) == 0:
        return line
    tree = cKDTree(near)

    def distances(tried: Floats) -> Floats:
        found: Floats = tree.query(tried)[0]
        return found

    narrow = np.flatnonzero(distances(line) < enough)
    return _centred(line, along, narrow, distances, half_width)


def _centred(
    line: Floats, along: Floats, narrow: Cells, distances: Distances, half_width: float
) -> Floats:
    """Return the line with its `narrow` points (k,) between obstacles on both sides moved to the
    middle, and their neighbours a part of that distance.
    """
    params = CENTRING
    if len(narrow) == 0 or len(line) < 3:
        return line
    across = _normals(line, narrow, params.along)
    count = round(params.aside / params.step)
    offsets = params.step * np.arange(-count, count + 1)
    tried = line[narrow, None, :] + offsets[:, None] * across[:, None, :]
    enough = half_width + params.tight
    rooms = np.minimum(distances(tried.reshape(-1, 2)), enough).reshape(len(narrow), -1)
    most = rooms.max(axis=1)
    # an obstacle that leaves no room in the middle is before the robot, not beside it
    shut = along[narrow][most <= half_width - params.too_tight]
    gap = _nearest(along[narrow], shut) > params.fade
    # with an obstacle on one side only, room grows with the distance
    gap &= np.maximum(rooms[:, 0], rooms[:, -1]) < most - params.alike
    if not gap.any():
        return line
    good = rooms >= most[:, None] - params.alike
    best = offsets[np.where(good, np.abs(offsets), math.inf).argmin(axis=1)]
    at = along[narrow][gap]
    # the tighter a place, the more it says about those beside it: where there is just enough room,
    # the least move that finds it ends at once
    weight = np.clip(1.0 - np.abs(at[:, None] - at) / params.blend, 0.0, 1.0)
    weight *= (enough - most[gap] + params.alike) ** 2
    moves = weight @ (best[:, None] * across)[gap] / weight.sum(axis=1, keepdims=True)
    share = np.clip(1.0 - _nearest(along, at) / params.fade, 0.0, 1.0)
    share *= np.clip(np.minimum(along - along[0], along[-1] - along) / params.from_end, 0.0, 1.0)
    moved = [np.interp(along, at, moves[:, axis]) * share for axis in (0, 1)]
    result: Floats = line + np.column_stack(moved)
    return result


def _nearest(along: Floats, others: Floats) -> Floats:
    """Return (n,) metres along the line from points (n,) to the nearest of others (k,)."""
    apart: Floats = np.abs(along[:, None] - others).min(axis=1, initial=math.inf)
    return apart


def _normals(line: Floats, which: Cells, along: int) -> Floats:
    """Return (k, 2) the unit vectors to the left of the line at some of its points."""
    ahead = line[np.minimum(which + along, len(line) - 1)]
    behind = line[np.maximum(which - along, 0)]
    direction = ahead - behind
    length = np.maximum(np.hypot(direction[:, 0], direction[:, 1]), 1e-9)
    return np.column_stack([-direction[:, 1], direction[:, 0]]) / length[:, None]


def _occupied_about(spots: Floats, reach: float, clearance: Floats, costmap: CostMap) -> Floats:
    """Return (k, 2) centres of the occupied cells within `reach` metres of (m, 2) points."""
    rows, columns, _ = costmap.cells(spots)
    high, wide = costmap.shape
    size = math.ceil(reach / costmap.transform.resolution)
    down, right = np.indices((2 * size + 1, 2 * size + 1)).reshape(2, -1) - size
    rows, columns = (rows[:, None] + down).ravel(), (columns[:, None] + right).ravel()
    inside = (rows >= 0) & (rows < high) & (columns >= 0) & (columns < wide)
    places = np.unique(rows[inside] * wide + columns[inside])
    places = places[clearance.ravel()[places] <= 0.0]
    return costmap.centres(*np.divmod(places, wide))


def _to_squares(cells: Floats, costmap: CostMap) -> Distances:
    """Return the distance function to the squares about cell centres (k, 2)."""
    tree = cKDTree(cells)
    half, theta = costmap.transform.resolution / 2.0, costmap.transform.origin.theta
    cosine, sine = math.cos(theta), math.sin(theta)

    def distances(points: Floats) -> Floats:
        _, nearest = tree.query(points, k=min(NEAREST, len(cells)))
        away = points[:, None, :] - cells[nearest.reshape(len(points), -1)]
        right = np.abs(cosine * away[..., 0] + sine * away[..., 1]) - half
        up = np.abs(cosine * away[..., 1] - sine * away[..., 0]) - half
        found: Floats = np.hypot(np.maximum(right, 0.0), np.maximum(up, 0.0)).min(axis=1)
        return found

    return distances
