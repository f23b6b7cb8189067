"""Obstacles other than walls, as boxes and cylinders, so that the simulation has every obstacle of
the map.

A group of cells becomes the tightest rectangle along its principal axis; where that would cover
floor that is free on the map, the group is cut across its longer side and each half tried again.
"""

import math
from dataclasses import dataclass

import numpy as np
import scipy

from robots.api.geometry import Pose2D
from robots.world.sensing import points_from_frame
from robots.world.solids import Floats
from robots.world.tracing.layers import EVERYWHERE, Bools, Layers, disc
from robots.world.tracing.line_regions import principal_axis
from robots.world.tracing.structure import Structure
from robots.world.tracing.walls import Segment

MOST_OBSTACLES = 500  # of a plan


@dataclass(frozen=True)
class ObstacleParams:
    """Parameters of fitting boxes to the map."""

    near_wall: float = 0.75  # cells beyond a wall's side that still belong to the wall
    free_share: tuple[float, ...] = (0.12, 0.25, 0.4)  # of a box; the next where there are too many
    free_area: float = 0.06  # m² of a box, at most, however large
    closing: float = 0.15  # metres: gaps in the outline of something that stands free
    smallest: float = 0.16  # metres: a group with a shorter longer side is not cut
    round_shares: tuple[float, float] = (0.65, 0.88)  # of its box that something round fills
    round_sides: float = 1.3  # longer to shorter side of something round, at most
    round_least: float = 0.2  # metres across


OBSTACLES = ObstacleParams()


@dataclass(frozen=True)
class Obstacle:
    """A box of `width` along `direction` by `depth`, or a cylinder of `width` across; metres in the
    map's frame.
    """

    x: float
    y: float
    direction: float
    width: float
    depth: float
    is_round: bool = False


def find_obstacles(structure: Structure, solid: Bools) -> list[Obstacle]:
    """Return the obstacles in the rooms, the largest first: the cells `solid` (h, w), which belong
    to no wall, and free-standing furniture. The smallest are left out when a plan cannot hold them.
    """
    layers = structure.layers
    solid = solid | _filled(structure)
    groups, _ = scipy.ndimage.label(solid, EVERYWHERE)
    found: list[Obstacle] = []
    for share in OBSTACLES.free_share:
        found = []
        for label, place in enumerate(scipy.ndimage.find_objects(groups), start=1):
            rows, columns = np.nonzero(groups[place] == label)
            points = layers.centres(rows + place[0].start, columns + place[1].start)
            found += _boxes(points, structure, share)
        if len(found) <= MOST_OBSTACLES:
            break
    found.sort(key=lambda obstacle: -obstacle.width * obstacle.depth)
    return found[:MOST_OBSTACLES]


def _filled(structure: Structure) -> Bools:
    """Return free-standing furniture with the cells that it encloses."""
    outlines = structure.layers.occupied & structure.furniture
    radius = structure.layers.cells_in(OBSTACLES.closing)
    closed = scipy.ndimage.binary_closing(outlines, disc(radius))
    filled: Bools = (scipy.ndimage.binary_fill_holes(closed) & structure.furniture) | outlines
    return filled


def cells_of_walls(layers: Layers, walls: list[Segment]) -> Bools:
    """Return the occupied cells (h, w) that lie in or at a wall."""
    rows, columns = layers.occupied.nonzero()
    points = layers.centres(rows, columns)
    near = np.zeros(len(points), dtype=np.bool_)
    for wall in walls:
        reach = wall.thickness / 2.0 + OBSTACLES.near_wall * layers.resolution
        near |= wall.distances(points) <= reach
    result = np.zeros_like(layers.occupied)
    result[rows[near], columns[near]] = True
    return result


def _boxes(points: Floats, structure: Structure, free_share: float) -> list[Obstacle]:
    layers = structure.layers
    box = _box(points, layers.resolution)
    if _is_round(box, points, layers):
        across = (box.width + box.depth) / 2.0
        return [Obstacle(box.x, box.y, 0.0, across, across, is_round=True)]
    most = min(free_share, OBSTACLES.free_area / (box.width * box.depth))
    if box.width <= OBSTACLES.smallest or _floor_in(box, structure) <= most:
        return [box]
    along = (points - (box.x, box.y)) @ (math.cos(box.direction), math.sin(box.direction))
    first, second = points[along < 0.0], points[along >= 0.0]
    if not len(first) or not len(second):
        return [box]
    return _boxes(first, structure, free_share) + _boxes(second, structure, free_share)


def _box(points: Floats, cell: float) -> Obstacle:
    """Return the box about the cells with the centres (n, 2): the smallest of those along their
    principal axis and along the axes of the map.
    """
    _, axis = principal_axis(points)
    boxes = [_box_along(points, cell, direction) for direction in (0.0, axis)]
    return min(boxes, key=lambda box: box.width * box.depth)


def _box_along(points: Floats, cell: float, direction: float) -> Obstacle:
    cosine, sine = math.cos(direction), math.sin(direction)
    along, across = points @ (cosine, sine), points @ (-sine, cosine)
    sides = [float(np.ptp(along)) + cell, float(np.ptp(across)) + cell]
    a, b = float(along.max() + along.min()) / 2.0, float(across.max() + across.min()) / 2.0
    x, y = a * cosine - b * sine, a * sine + b * cosine
    if sides[0] < sides[1]:
        return Obstacle(x, y, direction + math.pi / 2.0, sides[1], sides[0])
    return Obstacle(x, y, direction, sides[0], sides[1])


def _is_round(box: Obstacle, points: Floats, layers: Layers) -> bool:
    """Tell whether a cylinder fits the cells better than their box."""
    share = len(points) * layers.area / (box.width * box.depth)
    if (
        box.depth < OBSTACLES.round_least
        or box.width > OBSTACLES.round_sides * box.depth
        or not OBSTACLES.round_shares[0] <= share <= OBSTACLES.round_shares[1]
    ):
        return False
    away = np.hypot(points[:, 0] - box.x, points[:, 1] - box.y)
    return float(away.max()) <= (box.width + box.depth) / 4.0 + 0.25 * layers.resolution


def _floor_in(box: Obstacle, structure: Structure) -> float:
    """Return which share of a box is floor on the map."""
    layers = structure.layers
    step = layers.resolution / 2.0
    a, b = (
        (np.arange(max(1, math.ceil(side / step))) + 0.5) * step - side / 2.0
        for side in (box.width, box.depth)
    )
    along, across = (values.ravel() for values in np.meshgrid(a, b))
    frame = Pose2D(box.x, box.y, box.direction)
    points = points_from_frame(frame, np.column_stack([along, across]))
    return float(layers.at(structure.floor, points).mean())
