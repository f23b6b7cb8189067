"""Finds a charging station in one scan: its known shape is fitted to the points where it is
expected.

To a robot that comes to dock, a station is a flat front of known width that stands out before
whatever is behind it. First many poses around the expected one are scored: points on the front
count for a pose; points before it, behind it or in line with it beyond its edges count against it.
Then a straight line through the points on the front gives distance and heading (total least
squares), and its two ends, halfway to the next beam, give the middle.
"""

import math
from dataclasses import dataclass

import numpy as np

from robots.api.floorplan import Station
from robots.api.geometry import Pose2D
from robots.world.sensing import Floats, LaserScan, points_in_frame


@dataclass(frozen=True)
class StationParams:
    """Parameters of recognizing a station's shape in a sweep."""

    on_front: float = 0.035  # m from the line that count as on it
    beyond_edges: float = 0.5  # m beyond either edge, up to which points count
    least_points: int = 8  # on the front
    least_share: float = 0.75  # of the front's width that must have been seen
    against: float = 1.0  # weight of a point that speaks against a pose
    continues_within: float = 0.25  # m beyond the ends of a front, in which points may continue it
    most_continuing: int = 2  # such points: with more it is a wall
    # m by which the seen width may differ, beyond the distance of two beams
    edge_tolerance: float = 0.03


STATION = StationParams()


@dataclass(frozen=True)
class SearchWindow:
    """The range of the search around the expected pose: metres along, aside, radians, and steps."""

    along: float
    aside: float
    turned: float
    step: float = 0.04
    turn_step: float = 0.05


WIDE = SearchWindow(along=0.36, aside=0.4, turned=0.3)
NARROW = SearchWindow(along=0.08, aside=0.08, turned=0.1)


@dataclass(frozen=True)
class Sighting:
    """The middle of a station's front in the robot's frame, and how many `points` lie on it."""

    front: Pose2D
    points: int


def find(
    beams: LaserScan, expected: Pose2D, station: Station, window: SearchWindow
) -> Sighting | None:
    """Return the front of a station in a scan, or None. `expected` is its middle's pose in the
    robot's frame at the scan, `window` how far from there it may be.
    """
    points = beams.points()
    reach = station.width / 2.0 + window.aside + window.along + STATION.beyond_edges
    points = points[np.hypot(points[:, 0] - expected.x, points[:, 1] - expected.y) <= reach]
    if len(points) < STATION.least_points:
        return None
    return _refined(points, _best(points, expected, station, window), station)


def _best(points: Floats, expected: Pose2D, station: Station, window: SearchWindow) -> Pose2D:
    """Return the pose with the best score of a grid about the expected one."""
    local = points_in_frame(expected, points)
    along, aside = (
        np.arange(-size, size + 1e-9, window.step) for size in (window.along, window.aside)
    )
    best, best_score = expected, -math.inf
    for turned in np.arange(-window.turned, window.turned + 1e-9, window.turn_step):
        cosine, sine = math.cos(turned), math.sin(turned)
        u = cosine * local[:, 0] + sine * local[:, 1]
        v = cosine * local[:, 1] - sine * local[:, 0]
        scores = _scores(u, v, along, aside, station)
        index = np.unravel_index(int(np.argmax(scores)), scores.shape)
        score = float(scores[index]) - abs(float(turned))
        if score > best_score:
            x, y = float(along[index[0]]), float(aside[index[1]])
            best = expected.compose(
                Pose2D(cosine * x - sine * y, sine * x + cosine * y, float(turned))
            )
            best_score = score
    return best


def _scores(u: Floats, v: Floats, along: Floats, aside: Floats, station: Station) -> Floats:
    """Return scores (a, s) of fronts at `along` x `aside` for points (u, v) from expected."""
    depth = u[None, :] - along[:, None]
    off = np.abs(v[None, :] - aside[:, None]) - station.width / 2.0
    on_line = (np.abs(depth) <= STATION.on_front).astype(np.float64)
    sticks_out = ((depth < -STATION.on_front) & (depth > -STATION.beyond_edges)).astype(np.float64)
    through = (depth > STATION.on_front).astype(np.float64)
    within = (off <= 0.0).astype(np.float64)
    beyond = ((off > STATION.on_front) & (off <= STATION.beyond_edges)).astype(np.float64)
    speaks: Floats = (
        on_line - STATION.against * (sticks_out + through)
    ) @ within.T - STATION.against * on_line @ beyond.T
    return speaks


def _goes_on(
    points: Floats, direction: Floats, normal: Floats, offset: float, ends: tuple[float, float]
) -> bool:
    """Tell whether points go on beyond a line's ends: those of a wall do, a station's not."""
    along, off = points @ direction, np.abs(points @ normal - offset)
    beyond = (
        (off <= STATION.on_front)
        & ((along < ends[0] - STATION.edge_tolerance) | (along > ends[1] + STATION.edge_tolerance))
        & (along > ends[0] - STATION.continues_within)
        & (along < ends[1] + STATION.continues_within)
    )
    return int(beyond.sum()) > STATION.most_continuing


def _refined(points: Floats, rough: Pose2D, station: Station) -> Sighting | None:
    """Return the pose fitted to the points on the front; None when too few are seen."""
    local = points_in_frame(rough, points)
    on_front = (np.abs(local[:, 0]) <= STATION.on_front) & (
        np.abs(local[:, 1]) <= station.width / 2.0 + STATION.on_front
    )
    front = local[on_front]
    if len(front) < STATION.least_points:
        return None
    centre = front.mean(axis=0)
    direction = np.linalg.svd(front - centre, full_matrices=False)[2][0]
    direction = direction if direction[1] > 0.0 else -direction
    across = front @ direction
    low, high = float(across.min()), float(across.max())
    spacing = (high - low) / max(len(front) - 1, 1)
    if (
        high - low < STATION.least_share * station.width - spacing
        or high - low > station.width + STATION.edge_tolerance + 2.0 * spacing
    ):
        return None
    normal = np.array([direction[1], -direction[0]])
    if _goes_on(local, direction, normal, float(centre @ normal), (low, high)):
        return None
    middle = direction * (low + high) / 2.0 + normal * float(centre @ normal)
    turned = math.atan2(-direction[0], direction[1])
    return Sighting(rough.compose(Pose2D(float(middle[0]), float(middle[1]), turned)), len(front))
