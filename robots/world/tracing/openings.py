"""Openings between rooms: where two of them touch, the shortest line from wall to wall."""

import math
from dataclasses import dataclass

import numpy as np
import scipy

from robots.world.solids import Floats
from robots.world.tracing.layers import EVERYWHERE, Labels
from robots.world.tracing.structure import Structure

Point = tuple[float, float]


@dataclass(frozen=True)
class OpeningParams:
    """Parameters of measuring openings."""

    directions: int = 36
    longest: float = 4.0  # of half a line, times the clearance of the border
    widest_door: float = 1.5  # metres
    about: float = 0.4  # metres from the border of two rooms in which the narrowest line is sought
    middle: float = 0.8  # least clearance of its middle, as a share of that of the border
    squareness: float = 1.1  # how much longer a line square to the building may be and still win
    narrowest: float = 0.62  # metres: what a plan takes, with some room for a wall's thickness


OPENINGS = OpeningParams()


@dataclass(frozen=True)
class Opening:
    """From wall to wall, metres in the map's frame, and the numbers of the rooms beside it."""

    start: Point
    end: Point
    rooms: tuple[int, int]

    @property
    def width(self) -> float:
        """Metres."""
        return math.dist(self.start, self.end)


def find_openings(structure: Structure, labels: Labels, main: float | None) -> list[Opening]:
    """Return the openings between labelled rooms, each border's own; `main` is the building's
    direction in radians, when it has one.
    """
    layers = structure.layers
    clearance = structure.ground_clearance
    found = []
    for pair in _pairs(labels):
        first, second = labels == pair[0], labels == pair[1]
        border = first & scipy.ndimage.binary_dilation(second, EVERYWHERE)
        border |= second & scipy.ndimage.binary_dilation(first, EVERYWHERE)
        parts, count = scipy.ndimage.label(border, EVERYWHERE)
        for part in range(1, count + 1):
            rows, columns = (parts == part).nonzero()
            best = int(np.argmax(clearance[rows, columns]))
            row, column = rows[best], columns[best]
            if 2.0 * clearance[row, column] < OPENINGS.narrowest - 2.0 * layers.resolution:
                continue
            line = _across(structure, clearance, (int(row), int(column)), main)
            if math.dist(*line) >= OPENINGS.narrowest:
                found.append(Opening(*line, pair))
    return found


def _pairs(labels: Labels) -> list[tuple[int, int]]:
    """Return the numbers of rooms that touch."""
    pairs = set()
    for a, b in (
        (labels[:, :-1], labels[:, 1:]),
        (labels[:-1], labels[1:]),
        (labels[:-1, :-1], labels[1:, 1:]),
        (labels[:-1, 1:], labels[1:, :-1]),
    ):
        both = (a != b) & (a > 0) & (b > 0)
        pairs |= set(
            zip(np.minimum(a, b)[both].tolist(), np.maximum(a, b)[both].tolist(), strict=True)
        )
    return sorted(pairs)


def _across(
    structure: Structure, clearance: Floats, cell: tuple[int, int], main: float | None
) -> tuple[Point, Point]:
    """Return the shortest line from wall to wall about a cell of a border, one square to the
    building when it is not much longer. In a doorway the border may lie a little off the neck.
    """
    layers, height = structure.layers, float(clearance[cell])
    reach = layers.cells_in(OPENINGS.about) if 2.0 * height <= OPENINGS.widest_door else 0
    lines = []
    for row in range(max(cell[0] - reach, 0), min(cell[0] + reach + 1, clearance.shape[0]), 2):
        columns = range(max(cell[1] - reach, 0), min(cell[1] + reach + 1, clearance.shape[1]), 2)
        for column in columns:
            # a line is at least twice as long as its middle is clear
            if clearance[row, column] >= OPENINGS.middle * height:
                x, y = layers.centres(np.array([row]), np.array([column]))[0].tolist()
                far = OPENINGS.longest * (height + layers.resolution)
                lines.append(_shortest(structure, (x, y), main, far))
    return min(lines, key=lambda line: math.dist(*line))


def _shortest(
    structure: Structure, through: Point, main: float | None, far: float
) -> tuple[Point, Point]:
    """Return the shortest of the lines through a point, `far` metres to each side at most."""
    angles = np.arange(OPENINGS.directions) * (math.pi / OPENINGS.directions)
    if main is not None:
        angles = np.concatenate([angles, [main, main + math.pi / 2.0]])
    ends = _ends(structure, through, np.concatenate([angles, angles + math.pi]), far)
    starts, ends = ends[: len(angles)], ends[len(angles) :]
    lengths = np.hypot(*(ends - starts).T)
    best = int(np.argmin(lengths[: OPENINGS.directions]))
    if main is not None:
        square = OPENINGS.directions + int(np.argmin(lengths[OPENINGS.directions :]))
        most = OPENINGS.squareness * lengths[best] + structure.layers.resolution
        best = square if lengths[square] <= most else best
    (x0, y0), (x1, y1) = starts[best].tolist(), ends[best].tolist()
    return (x0, y0), (x1, y1)


def _ends(structure: Structure, start: Point, angles: Floats, far: float) -> Floats:
    """Return the last free points (n, 2) from a point in directions (n,)."""
    layers = structure.layers
    steps = np.arange(0.0, far, layers.resolution / 4.0)
    x = start[0] + np.cos(angles)[:, None] * steps
    y = start[1] + np.sin(angles)[:, None] * steps
    free = layers.at(structure.ground, np.column_stack([x.ravel(), y.ravel()])).reshape(x.shape)
    last = np.where(free.all(axis=1), len(steps) - 1, np.maximum((~free).argmax(axis=1) - 1, 0))
    each = np.arange(len(angles))
    ends: Floats = np.column_stack([x[each, last], y[each, last]])
    return ends
