"""Two rooms of a plan made one: a watershed divides some rooms that people would not."""

import numpy as np

from robots.api.floorplan import contains
from robots.api.geometry import Pose2D
from robots.api.messages import Point
from robots.world.tracing.layers import Layers
from robots.world.tracing.outlines import polygon_of
from robots.world.tracing.rooms import ROOMS, filled

CELL = 0.05  # metres of the drawing in which the rooms are joined
MARGIN = 1.0


def joined(first: tuple[Point, ...], second: tuple[Point, ...]) -> tuple[Point, ...]:
    """Return the polygon of both rooms, a gap as wide as a wall between them included.

    Raises:
        ValueError: they do not touch.
    """
    points = np.array([*first, *second])
    low, high = points.min(axis=0) - MARGIN, points.max(axis=0) + MARGIN
    wide, tall = np.ceil((high - low) / CELL).astype(int).tolist()
    empty = np.zeros((tall, wide), dtype=np.bool_)
    layers = Layers(empty, empty, CELL, Pose2D(float(low[0]), float(low[1]), 0.0))
    rows, columns = np.nonzero(~empty)
    centres = (layers.centres(rows, columns) + low).tolist()
    masks = []
    for polygon in (first, second):
        mask = empty.copy()
        mask[rows, columns] = [contains(polygon, x, y) for x, y in centres]
        masks.append(mask)
    both = filled(masks[0] | masks[1], empty, layers)
    # `filled` keeps the largest part: both are in it only where they touch
    if min(float((mask & both).sum()) / max(int(mask.sum()), 1) for mask in masks) < 0.5:
        message = "the rooms do not touch"
        raise ValueError(message)
    outline = polygon_of(both, layers, ROOMS.tolerance, ROOMS.least_hole).tolist()
    return tuple(layers.to_world((x, y)) for x, y in outline)
