"""Rooms of a map by the distance transform and the watershed.

The clearance of the floor is a landscape whose peaks are the middles of rooms and whose saddles are
doorways. It is flooded from the peaks down (Vincent and Soille, "Watersheds in digital spaces",
1991); where two basins meet they become one unless the saddle is a doorway between them. Bormann et
al., "Room segmentation: survey, implementation, and analysis" (2016), compare this with its
alternatives; asking at the saddle keeps corridors whole, which a threshold for the whole map does
not.

Furniture that stands free is floor here: a table does not divide a room.
"""

from dataclasses import dataclass
from itertools import combinations

import numpy as np
import scipy

from robots.api.floorplan import contains
from robots.api.geometry import Pose2D
from robots.api.messages import Point
from robots.world.solids import Floats
from robots.world.tracing.layers import EVERYWHERE, Bools, Labels, Layers, disc
from robots.world.tracing.outlines import polygon_of
from robots.world.tracing.structure import Structure

MOST_ROOMS = 100  # of a plan
MARGIN = 2  # cells by which a room reaches into its neighbours
JOINED_CELL = 0.05  # metres, of the drawing in which two rooms of a plan are joined
JOINED_MARGIN = 1.0  # metres around that drawing


@dataclass(frozen=True)
class RoomParams:
    """Limits of doorways and rooms."""

    widest_door: float = 1.5  # metres
    # the doorway's width to that of the narrower room beside it, at most
    door_share: float = 0.8
    wide_share: float = 0.45  # the same of an opening that is wider than a door
    least_width: float = 1.0  # metres, of a room
    least_area: float = 2.0  # m²
    closing: float = 0.35  # metres: niches and gaps in furniture that belong to the room
    deepest: float = 1.0  # metres, of furniture at a wall
    tolerance: float = 0.12  # metres that a corner of the outline may be off
    least_hole: float = 1.0  # m² of a building's part inside a room


ROOMS = RoomParams()


def label_rooms(structure: Structure) -> Labels:
    """Return the number of the room of each cell of the ground (h, w), from 1 in reading order, 0
    elsewhere.
    """
    layers = structure.layers
    labels = _without_small(_flooded(structure.ground_clearance, layers), layers)
    found = np.unique(labels[labels > 0])
    places = {int(label): np.argwhere(labels == label).mean(axis=0) for label in found}
    row = max(1, layers.cells_in(3.0))
    order = sorted(places, key=lambda label: (int(places[label][0]) // row, places[label][1]))
    renumbered = np.zeros(int(labels.max()) + 1, dtype=np.int32)
    for number, label in enumerate(order[:MOST_ROOMS], start=1):
        renumbered[label] = number
    return renumbered[labels]


def with_things(labels: Labels, solid: Bools, layers: Layers) -> Labels:
    """Return labels (h, w) that include the furniture at the walls of each room, such as a cabinet
    in a corner.
    """
    result = labels
    for _ in range(layers.cells_in(ROOMS.deepest)):
        grown = scipy.ndimage.grey_dilation(result, footprint=EVERYWHERE)
        result = np.where(solid & (result == 0), grown, result)
    return result


def polygon(labels: Labels, number: int, layers: Layers) -> Floats:
    """Return the outline (n, 2) of a room, metres in the map's frame: its floor, with the niches
    and the furniture along its walls.
    """
    others = (labels > 0) & (labels != number)
    room = filled(labels == number, others, layers)
    return polygon_of(room, layers, ROOMS.tolerance, ROOMS.least_hole)


def filled(floor: Bools, others: Bools, layers: Layers) -> Bools:
    """Return the floor of a room with its niches, without the floor of `others`."""
    radius = layers.cells_in(ROOMS.closing)
    # the closing changes nothing farther away
    part = _about(floor, radius + MARGIN)
    padded = np.pad(floor[part], 2 * radius)
    closed = scipy.ndimage.binary_closing(padded, disc(radius))[
        2 * radius : -2 * radius, 2 * radius : -2 * radius
    ]
    # a little into its neighbours: outlines that are simplified must leave no slit between rooms
    grown = scipy.ndimage.binary_dilation(closed & ~others[part], EVERYWHERE, iterations=MARGIN)
    parts, count = scipy.ndimage.label(grown)
    if count > 1:
        grown = parts == int(np.argmax(np.bincount(parts.ravel())[1:])) + 1
    result: Bools = np.zeros_like(floor)
    result[part] = grown
    return result


def joined(first: tuple[Point, ...], second: tuple[Point, ...]) -> tuple[Point, ...]:
    """Return one polygon for two rooms of a plan and a gap of a wall's width between them: the
    watershed divides some rooms that people would not.

    Raises:
        ValueError: they do not touch.
    """
    points = np.array([*first, *second])
    low, high = points.min(axis=0) - JOINED_MARGIN, points.max(axis=0) + JOINED_MARGIN
    wide, tall = np.ceil((high - low) / JOINED_CELL).astype(int).tolist()
    empty = np.zeros((tall, wide), dtype=np.bool_)
    layers = Layers(empty, empty, JOINED_CELL, Pose2D(float(low[0]), float(low[1]), 0.0))
    rows, columns = np.nonzero(~empty)
    centres = (layers.centres(rows, columns) + low).tolist()
    masks = []
    for corners in (first, second):
        mask = empty.copy()
        mask[rows, columns] = [contains(corners, x, y) for x, y in centres]
        masks.append(mask)
    both = filled(masks[0] | masks[1], empty, layers)
    # `filled` keeps the largest part: both are in it only where they touch
    if min(float((mask & both).sum()) / max(int(mask.sum()), 1) for mask in masks) < 0.5:
        raise ValueError("the rooms do not touch")
    outline = polygon_of(both, layers, ROOMS.tolerance, ROOMS.least_hole).tolist()
    return tuple(layers.to_world((x, y)) for x, y in outline)


def _about(mask: Bools, cells: int) -> tuple[slice, slice]:
    """Return the rows and columns of a mask's cells, and so many beside them."""
    found = [np.flatnonzero(mask.any(axis=axis)).tolist() or [0] for axis in (1, 0)]
    rows, columns = (slice(max(each[0] - cells, 0), each[-1] + cells + 1) for each in found)
    return rows, columns


# --- flooding -------------------------------------------------------------------------------------


class _Basins:
    """Basins that grow and join: a union-find with the peak and the cells of each."""

    def __init__(self, layers: Layers) -> None:
        self.parent: list[int] = [0]
        self.peak: list[float] = [0.0]
        self.cells: list[int] = [0]
        self.cell_area = layers.area

    def new(self, peak: float) -> int:
        self.parent.append(len(self.parent))
        self.peak.append(peak)
        self.cells.append(0)
        return len(self.parent) - 1

    def root(self, basin: int) -> int:
        while self.parent[basin] != basin:
            self.parent[basin] = self.parent[self.parent[basin]]
            basin = self.parent[basin]
        return basin

    def meet(self, a: int, b: int, saddle: float) -> None:
        """Let two basins meet at a saddle: they stay two, or the lower one joins the other."""
        higher, lower = (a, b) if self.peak[a] >= self.peak[b] else (b, a)
        if higher != lower and not self._are_rooms(lower, saddle):
            self.parent[lower] = higher
            self.cells[higher] += self.cells[lower]

    def _are_rooms(self, lower: int, saddle: float) -> bool:
        peak = self.peak[lower]
        share = ROOMS.door_share if 2.0 * saddle <= ROOMS.widest_door else ROOMS.wide_share
        return (
            saddle <= share * peak
            and 2.0 * peak >= ROOMS.least_width
            and self.cells[lower] * self.cell_area >= ROOMS.least_area / 2.0
        )


def _flooded(clearance: Floats, layers: Layers) -> Labels:
    """Return the basins (h, w) of the clearance, highest cells first."""
    high, wide = clearance.shape
    flat = np.pad(clearance, 1).ravel()
    order = np.argsort(-flat, kind="stable")
    order = order[: int((flat > 0.0).sum())]
    across = wide + 2
    about = (-across - 1, -across, -across + 1, -1, 1, across - 1, across, across + 1)
    labels, basins, height = [0] * len(flat), _Basins(layers), flat.tolist()
    for cell in order.tolist():
        near = [other for step in about if labels[other := cell + step]]
        met = set(map(labels.__getitem__, near))
        if not near:
            basin = basins.new(height[cell])
        elif len(met) == 1:
            basin = basins.root(met.pop())
        else:
            for one, other in combinations(sorted({basins.root(label) for label in met}), 2):
                basins.meet(basins.root(one), basins.root(other), height[cell])
            # water runs from a cell to its highest neighbour
            basin = basins.root(labels[max(near, key=height.__getitem__)])
        labels[cell] = basin
        basins.cells[basin] += 1
    roots = np.array([basins.root(basin) for basin in range(len(basins.parent))], dtype=np.int32)
    return roots[np.array(labels, dtype=np.int32)].reshape(high + 2, across)[1:-1, 1:-1]


def _without_small(labels: Labels, layers: Layers) -> Labels:
    """Give basins that are too small for a room to the neighbour with the longest border."""
    result = labels.copy()
    sizes = np.bincount(result.ravel())
    for label in sorted(np.flatnonzero(sizes), key=lambda number: int(sizes[number])):
        mine = result == label
        if label == 0 or mine.sum() * layers.area >= ROOMS.least_area:
            continue
        border = scipy.ndimage.binary_dilation(mine, EVERYWHERE) & ~mine & (result > 0)
        result[mine] = np.bincount(result[border]).argmax() if border.any() else 0
    return result
