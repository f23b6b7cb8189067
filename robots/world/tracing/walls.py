"""Straight walls from the occupied cells of a building.

1. A wall is fitted to each line-support region (`line_regions`) by total least squares.
2. Directions near the two that most of the building has are turned to these; buildings are mostly
   rectangular, and a map of one is never quite (Luperto and Amigoni, "Extracting structure of
   buildings using layout reconstruction", 2018).
3. Pieces along one line become one, and so do the two faces of a wall, where nothing free lies
   between them: a doorway stays open.
4. Ends that nearly meet meet.

`obstacles` takes the pieces that are too short or too ragged for a wall.
"""

import math
from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
import scipy

from robots.api.geometry import Pose2D
from robots.world.sensing import points_from_frame, points_in_frame
from robots.world.solids import Floats
from robots.world.tracing.layers import Bools, Layers
from robots.world.tracing.line_regions import line_regions, principal_axis

Point = tuple[float, float]


@dataclass(frozen=True)
class WallParams:
    """Limits of walls; metres and radians."""

    visible: float = 0.25  # metres into something solid that count
    shortest_piece: float = 0.3
    shortest: float = 0.5  # of a wall, when all pieces have been joined
    covered: float = 0.5  # share of a wall's length at which the map shows something
    inside: float = 0.4  # share of its length at which both sides are occupied: a block, no wall
    beside: float = 0.5  # the same of one side; only for walls that are not long
    straightness: float = 3.5  # length to thickness of a wall, at least, unless it is long
    long: float = 1.5  # from which a wall may be as thick as it is
    turned: float = math.radians(6.0)  # to the building's own directions
    parallel: float = math.radians(5.0)  # of pieces that become one
    thickest: float = 0.35
    gap: float = 0.6  # between pieces along a line; nothing of it may be free
    free_between: float = 0.1  # share of a joined wall that may be free on the map
    corner: float = 0.3  # between an end and the line that it should meet


WALLS = WallParams()


@dataclass(frozen=True)
class Segment:
    """A wall: its centre line from `start` to `end`, metres in the map's frame."""

    start: Point
    end: Point
    thickness: float

    @property
    def length(self) -> float:
        """Metres."""
        return math.dist(self.start, self.end)

    @property
    def direction(self) -> float:
        """Radians in [0, pi)."""
        return math.atan2(self.end[1] - self.start[1], self.end[0] - self.start[0]) % math.pi

    @property
    def middle(self) -> Point:
        """The point half way."""
        return (self.start[0] + self.end[0]) / 2.0, (self.start[1] + self.end[1]) / 2.0

    @property
    def frame(self) -> Pose2D:
        """The wall's own frame: x along it from its middle, y to its left."""
        return Pose2D(*self.middle, self.direction)

    def coordinates(self, points: Floats) -> tuple[Floats, Floats]:
        """Return how far along (n,) from the middle, and how far to the left (n,), points are."""
        along, across = points_in_frame(self.frame, points).T
        return along, across

    def distances(self, points: Floats) -> Floats:
        """Return the distance (n,) of points (n, 2) from the centre line."""
        along, across = self.coordinates(points)
        beyond = np.maximum(np.abs(along) - self.length / 2.0, 0.0)
        away: Floats = np.hypot(beyond, across)
        return away


@dataclass(frozen=True, eq=False)
class _Piece:
    """A wall and the centres (n, 2) of the cells that it is fitted to."""

    wall: Segment
    points: Floats


def trace_walls(building: Bools, layers: Layers) -> list[Segment]:
    """Return the walls among the occupied cells (h, w) of a building, the longest first."""
    cell = layers.resolution
    depth = scipy.ndimage.distance_transform_edt(~layers.free) * cell
    shell = building & (depth <= max(WALLS.visible, 1.5 * cell))
    pieces = [_Piece(fitted(points, cell), points) for points in line_regions(shell, layers)]
    pieces = [piece for piece in pieces if piece.wall.length >= WALLS.shortest_piece]
    pieces = _joined(_turned(pieces, cell), layers)
    walls = [
        piece.wall
        for piece in pieces
        if _is_wall(piece, cell) and not _is_block(piece.wall, layers)
    ]
    return sorted(_meeting(walls), key=lambda wall: -wall.length)


def _is_wall(piece: _Piece, cell: float) -> bool:
    wall = piece.wall
    slender = wall.length >= WALLS.long or wall.length >= WALLS.straightness * wall.thickness
    along, _ = wall.coordinates(piece.points)
    shown = len(np.unique(np.floor(along / cell))) * cell
    return wall.length >= WALLS.shortest and slender and shown >= WALLS.covered * wall.length


def _is_block(wall: Segment, layers: Layers) -> bool:
    """Tell whether a piece runs through something solid, or is the short side of it."""
    cell = layers.resolution
    along = np.arange(-wall.length / 2.0, wall.length / 2.0, cell / 2.0)
    sides = []
    for side in (-1.0, 1.0):
        across = np.full_like(along, side * (wall.thickness / 2.0 + cell))
        points = points_from_frame(wall.frame, np.column_stack([along, across]))
        sides.append(layers.at(layers.occupied, points))
    through, beside = float((sides[0] & sides[1]).mean()), max(float(s.mean()) for s in sides)
    return through > WALLS.inside or (wall.length < WALLS.long and beside > WALLS.beside)


def fitted(points: Floats, cell: float, direction: float | None = None) -> Segment:
    """Return the wall through the centres (n, 2) of cells that are `cell` metres wide, in a given
    direction or in that in which they lie.
    """
    middle, axis = principal_axis(points)
    direction = axis if direction is None else direction
    cosine, sine = math.cos(direction), math.sin(direction)
    along = (points - middle) @ np.array([cosine, sine])
    across = (points - middle) @ np.array([-sine, cosine])
    low, high = np.percentile(across, [4.0, 96.0])
    offset = float(low + high) / 2.0
    x, y = float(middle[0]) - sine * offset, float(middle[1]) + cosine * offset
    first, last = float(along.min()) - cell / 2.0, float(along.max()) + cell / 2.0
    return Segment(
        (x + first * cosine, y + first * sine),
        (x + last * cosine, y + last * sine),
        float(high - low) + cell,
    )


# --- straight, whole, and meeting -----------------------------------------------------------------


def main_direction(walls: Iterable[Segment]) -> float | None:
    """Return the direction in [0, pi/2) in which, or across which, most of the walls' length runs;
    None when no such direction has at least a third of it.
    """
    bins = 180
    weights = np.zeros(bins)
    walls = list(walls)
    quarter = math.pi / 2.0
    for wall in walls:
        weights[int(wall.direction % quarter / quarter * bins) % bins] += wall.length
    smooth = scipy.ndimage.gaussian_filter1d(weights, 3.0, mode="wrap")
    peak = (int(np.argmax(smooth)) + 0.5) / bins * quarter
    near = [wall for wall in walls if _turn(wall.direction, peak, quarter) <= WALLS.turned]
    total = sum(wall.length for wall in walls)
    if not near or sum(wall.length for wall in near) < total / 3.0:
        return None
    # long walls know their direction better: the variance falls with the cube of the length
    vector = sum(wall.length**3 * np.exp(4j * wall.direction) for wall in near)
    return float(np.angle(vector) / 4.0 % quarter)


def _turn(a: float, b: float, period: float) -> float:
    return abs((a - b + period / 2.0) % period - period / 2.0)


def _turned(pieces: list[_Piece], cell: float) -> list[_Piece]:
    """Turn the pieces that lie nearly in the building's own directions into these."""
    main, quarter = main_direction(piece.wall for piece in pieces), math.pi / 2.0
    if main is None:
        return pieces
    turned = []
    for piece in pieces:
        if _turn(piece.wall.direction, main, quarter) <= WALLS.turned:
            turns = round((piece.wall.direction - main) / quarter)
            wall = fitted(piece.points, cell, main + turns * quarter)
            turned.append(replace(piece, wall=wall))
        else:
            turned.append(piece)
    return turned


def _joined(pieces: list[_Piece], layers: Layers) -> list[_Piece]:
    """Join pairs until none is left to join; the longest go first."""
    waiting = deque(sorted(pieces, key=lambda piece: -piece.wall.length))
    done: list[_Piece] = []
    while waiting:
        piece = waiting.popleft()
        for index, other in enumerate(done):
            both = _one_of_two(other, piece, layers)
            if both is not None:
                del done[index]
                waiting.appendleft(both)
                break
        else:
            done.append(piece)
    return done


def _one_of_two(a: _Piece, b: _Piece, layers: Layers) -> _Piece | None:
    """Return the wall of which both are pieces, or None."""
    longer, shorter = (a, b) if a.wall.length >= b.wall.length else (b, a)
    most = (a.wall.length + b.wall.length) / 2.0 + WALLS.gap + WALLS.thickest
    if math.dist(a.wall.middle, b.wall.middle) > most:
        return None
    turn = _turn(a.wall.direction, b.wall.direction, math.pi)
    if turn > WALLS.parallel and shorter.wall.length > 2.0 * WALLS.thickest:
        return None
    along, across = longer.wall.coordinates(np.array([shorter.wall.start, shorter.wall.end]))
    half = longer.wall.length / 2.0
    apart = max(float(along.min()) - half, -half - float(along.max()))
    if apart > WALLS.gap or float(np.abs(across).max()) > WALLS.thickest:
        return None
    points = np.vstack([longer.points, shorter.points])
    wall = fitted(points, layers.resolution, longer.wall.direction)
    if wall.thickness > WALLS.thickest or _free_share(wall, layers) > WALLS.free_between:
        return None
    return _Piece(wall, points)


def _free_share(wall: Segment, layers: Layers) -> float:
    """Return which share of a wall's core is free on the map."""
    cell = layers.resolution
    along = np.arange(-wall.length / 2.0, wall.length / 2.0, cell / 2.0)
    spread = max(wall.thickness - 1.5 * cell, 0.0) / 2.0
    across = np.linspace(-spread, spread, 2 * math.ceil(spread / cell) + 1)
    a, b = (values.ravel() for values in np.meshgrid(along, across))
    points = points_from_frame(wall.frame, np.column_stack([a, b]))
    return float(layers.at(layers.free, points).mean())


def _meeting(walls: list[Segment]) -> list[Segment]:
    """Move ends to where their line meets that of another wall, when that is near for both."""
    met = []
    for index, wall in enumerate(walls):
        others = [other for number, other in enumerate(walls) if number != index]
        met.append(replace(wall, start=_met(wall, 0, others), end=_met(wall, 1, others)))
    return [wall for wall in met if wall.length > 0.0]


def _met(wall: Segment, which: int, others: list[Segment]) -> Point:
    end = (wall.start, wall.end)[which]
    best, least = end, WALLS.corner
    for other in others:
        if _turn(wall.direction, other.direction, math.pi) < math.radians(20.0):
            continue
        crossing = _crossing(wall, other)
        reach = other.length / 2.0 + WALLS.corner
        far = math.dist(crossing, end)
        if far < least and math.dist(crossing, other.middle) <= reach:
            best, least = crossing, far
    return best


def _crossing(a: Segment, b: Segment) -> Point:
    """Return where the lines of two walls that are not parallel cross."""
    ax, ay = math.cos(a.direction), math.sin(a.direction)
    bx, by = math.cos(b.direction), math.sin(b.direction)
    dx, dy = b.middle[0] - a.middle[0], b.middle[1] - a.middle[1]
    along = (dx * by - dy * bx) / (ax * by - ay * bx)
    return a.middle[0] + along * ax, a.middle[1] + along * ay
