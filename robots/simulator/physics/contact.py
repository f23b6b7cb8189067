"""Collisions of the footprint, a convex polygon, with convex solids.

Two convex shapes are apart exactly when one of their edge normals separates them (separating axis
theorem); the axis with the least overlap is the shortest way out. Steps are shorter than any solid
is thick, so that the robot cannot pass through one between two checks.
"""

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from robots.api.geometry import Pose2D, wrap_angle
from robots.simulator.physics.drive import WheelMotion, advance
from robots.world.solids import Floats, Solid, edges, sides

MAXIMUM_STEP = 0.01  # metres that any corner may travel between two checks
SKIN = 1e-4  # left between robot and thing after a push
RELEASE = 0.01  # a contact is over when the gap is this wide
PUSHES = 4
CANDIDATES = 5  # solids whose distance is measured first
LATTICE = 0.25  # metres between the points whose distance from everything is cached


def normals(outline: Floats) -> Floats:
    """Return the outward unit normals (n, 2) of a counter-clockwise outline's sides."""
    across = np.empty_like(outline)
    across[:-1], across[-1] = outline[1:] - outline[:-1], outline[0] - outline[-1]
    across[:, 0], across[:, 1] = across[:, 1].copy(), -across[:, 0]
    across /= np.sqrt((across**2).sum(axis=1))[:, None]
    return across


class Convex(NamedTuple):
    """A convex outline (n, 2), its sides' normals (n, 2) and their offsets (n,)."""

    outline: Floats
    normals: Floats
    offsets: Floats

    @classmethod
    def of(cls, outline: Floats, across: Floats) -> "Convex":
        return cls(outline, across, (across * outline).sum(axis=1))


def gap(mine: Convex, other: Convex) -> tuple[float, Floats]:
    """Return the widest separation in metres of two convex outlines along their normals, and the
    direction that frees `mine`.

    It is negative where they overlap; when positive it is a lower bound of their distance.
    """
    from_mine: Floats = (mine.normals @ other.outline.T).min(axis=1) - mine.offsets
    from_other: Floats = (other.normals @ mine.outline.T).min(axis=1) - other.offsets
    a, b = int(from_mine.argmax()), int(from_other.argmax())
    if from_mine[a] > from_other[b]:
        return float(from_mine[a]), -mine.normals[a]
    return float(from_other[b]), other.normals[b]


def place(footprint: Floats, pose: Pose2D) -> Floats:
    """Return the footprint (n, 2) in the world."""
    cosine, sine = math.cos(pose.theta), math.sin(pose.theta)
    # for so few corners Python is faster than NumPy
    return np.array(
        [
            (x * cosine - y * sine + pose.x, x * sine + y * cosine + pose.y)
            for x, y in footprint.tolist()
        ]
    )


@dataclass(frozen=True)
class ContactMove:
    """The end of a move: pose, the speeds reached, and the names of the touched solids."""

    pose: Pose2D
    motion: WheelMotion
    touched: frozenset[str]


@dataclass(frozen=True, eq=False)
class Shape:
    """A solid with what collisions need: its sides (n, 4) and its bounding box."""

    solid: Solid
    convex: Convex
    sides: Floats
    low: Floats
    high: Floats

    def gap_to(self, outline: Floats) -> tuple[float, Floats]:
        return gap(Convex.of(outline, normals(outline)), self.convex)

    def moved(self, name: str, x: float, y: float) -> "Shape":
        """Return the same shape under another name, shifted."""
        by = np.array([x, y])
        solid = replace(self.solid, name=name, outline=self.solid.outline + by)
        convex = Convex.of(solid.outline, self.convex.normals)
        moved = self.sides + np.array([x, y, x, y])
        return Shape(solid, convex, moved, self.low + by, self.high + by)


def shape(solid: Solid) -> Shape:
    outline = solid.outline
    convex = Convex.of(outline, normals(outline))
    return Shape(solid, convex, sides(outline), outline.min(axis=0), outline.max(axis=0))


class Hit(NamedTuple):
    """An overlap with a solid: how deep in metres, and the direction that frees the other."""

    solid: Solid
    depth: float
    direction: Floats


class Obstacles:
    """Solids at rest; immutable: make new ones when a door moves. `others` are moving shapes."""

    def __init__(self, solids: tuple[Solid, ...]) -> None:
        self.solids = solids
        self.shapes = tuple(map(shape, solids))
        self.segments = edges(solids)
        self._low = np.array([each.low for each in self.shapes]).reshape(-1, 2)
        self._high = np.array([each.high for each in self.shapes]).reshape(-1, 2)
        self._bounds = np.hstack([self._low, -self._high])
        self._free: dict[tuple[int, int], float] = {}
        self._reach: tuple[Floats, float] | None = None  # of the last footprint

    def free_about(self, x: float, y: float) -> float:
        """Return the radius in metres about a point that is free at least: the free radius of the
        nearest lattice point less the distance from it.
        """
        key = (math.floor(x / LATTICE), math.floor(y / LATTICE))
        if key not in self._free:
            middle = np.array([[(key[0] + 0.5) * LATTICE, (key[1] + 0.5) * LATTICE]])
            self._free[key] = (
                math.sqrt(_nearest(middle, self.segments)) if len(self.segments) else math.inf
            )
        return self._free[key] - LATTICE * math.sqrt(0.5)

    def near(self, outline: Floats) -> list[Shape]:
        """Return the solids whose bounding box meets that of an outline."""
        x, y = outline.T.tolist()
        within = self._bounds <= np.array((max(x), max(y), -min(x), -min(y)))
        return [self.shapes[index] for index in np.flatnonzero(within.all(axis=1)).tolist()]

    def hits(self, outline: Floats, others: tuple[Shape, ...] = ()) -> list[Hit]:
        """Return everything that an outline overlaps, the deepest first."""
        near = [*self.near(outline), *others]
        if not near:
            return []
        mine = Convex.of(outline, normals(outline))
        found = [(each.solid, *gap(mine, each.convex)) for each in near]
        hits = [Hit(solid, -free, direction) for solid, free, direction in found if free < 0.0]
        return sorted(hits, key=lambda hit: -hit.depth)

    def clearance(self, outline: Floats) -> float:
        """Return metres from an outline to the nearest solid, `inf` without any."""
        if not self.solids:
            return math.inf
        apart = np.maximum(
            np.maximum(self._low - outline.max(axis=0), outline.min(axis=0) - self._high), 0.0
        )
        at_least = np.sqrt((apart**2).sum(axis=1))
        order = np.argsort(at_least)
        nearest = self._distance(outline, order[:CANDIDATES])
        rest = order[CANDIDATES:][at_least[order[CANDIDATES:]] < nearest]
        return min(nearest, self._distance(outline, rest)) if len(rest) else nearest

    def _distance(self, outline: Floats, which: npt.NDArray[np.intp]) -> float:
        theirs = np.vstack([self.shapes[index].sides for index in which])
        return math.sqrt(min(_nearest(outline, theirs), _nearest(theirs[:, :2], sides(outline))))

    def move(
        self,
        footprint: Floats,
        pose: Pose2D,
        motion: WheelMotion,
        dt: float,
        others: tuple[Shape, ...] = (),
    ) -> ContactMove:
        """Drive for `dt` seconds; obstacles stop the robot or let it slide along."""
        reach = self._reach_of(footprint)
        travel = (abs(motion.linear) + abs(motion.angular) * reach) * dt
        if not others and self.free_about(pose.x, pose.y) > reach + travel + SKIN:
            return ContactMove(advance(pose, motion, dt), motion, frozenset())
        count = max(1, math.ceil(travel / MAXIMUM_STEP))
        here, touched = pose, set[str]()
        for _ in range(count):
            here, met = self._step(footprint, here, motion, dt / count, others)
            touched |= met
        if not touched or dt <= 0.0:
            return ContactMove(here, motion, frozenset(touched))
        ahead = (here.x - pose.x) * math.cos(pose.theta) + (here.y - pose.y) * math.sin(pose.theta)
        done = WheelMotion(
            _less(ahead / dt, motion.linear),
            _less(wrap_angle(here.theta - pose.theta) / dt, motion.angular),
        )
        return ContactMove(here, done, frozenset(touched))

    def _step(
        self,
        footprint: Floats,
        pose: Pose2D,
        motion: WheelMotion,
        dt: float,
        others: tuple[Shape, ...],
    ) -> tuple[Pose2D, set[str]]:
        wanted = advance(pose, motion, dt)
        travel = (abs(motion.linear) + abs(motion.angular) * self._reach_of(footprint)) * dt
        longest, touched = 2.0 * travel + SKIN, set[str]()
        candidates = (wanted, Pose2D(pose.x, pose.y, wanted.theta)) if motion.angular else (wanted,)
        for candidate in candidates:
            free, met = self._pushed_free(footprint, candidate, longest, others)
            touched |= met
            if free is not None:
                return free, touched
        return pose, touched

    def _reach_of(self, footprint: Floats) -> float:
        """Return the radius about the robot's centre that holds its footprint; cached."""
        if self._reach is None or self._reach[0] is not footprint:
            self._reach = footprint, math.sqrt(float((footprint**2).sum(axis=1).max()))
        return self._reach[1]

    def _pushed_free(
        self, footprint: Floats, pose: Pose2D, longest: float, others: tuple[Shape, ...]
    ) -> tuple[Pose2D | None, set[str]]:
        """Return the pose pushed out of overlaps by at most `longest` metres, None when that is too
        little; and the names of what it met.
        """
        touched = set[str]()
        x, y = pose.x, pose.y
        for _ in range(PUSHES):
            hits = self.hits(place(footprint, Pose2D(x, y, pose.theta)), others)
            if not hits:
                return Pose2D(x, y, pose.theta), touched
            touched |= {hit.solid.name for hit in hits}
            push = (hits[0].depth + SKIN) * hits[0].direction
            x, y = x + float(push[0]), y + float(push[1])
            if math.hypot(x - pose.x, y - pose.y) > longest:
                return None, touched
        return None, touched


def _less(done: float, wanted: float) -> float:
    """Return the part of a wanted speed that was done, with its sign, or 0."""
    return min(max(done, 0.0), wanted) if wanted > 0.0 else max(min(done, 0.0), wanted)


def _nearest(points: Floats, segments: Floats) -> float:
    """Return the least squared distance of (n, 2) points to (m, 4) segments."""
    start, along = segments[:, :2], segments[:, 2:] - segments[:, :2]
    dx, dy = points[:, 0:1] - start[:, 0], points[:, 1:2] - start[:, 1]
    share = np.clip((dx * along[:, 0] + dy * along[:, 1]) / (along**2).sum(axis=1), 0.0, 1.0)
    return float(((dx - share * along[:, 0]) ** 2 + (dy - share * along[:, 1]) ** 2).min())


def distance_to(x: float, y: float, outline: Floats) -> float:
    """Return how far a point lies from a convex, counter-clockwise outline, 0 inside."""
    corners = outline.tolist()
    inside, least = True, math.inf
    for (ax, ay), (bx, by) in zip(corners, (*corners[1:], corners[0]), strict=True):
        along_x, along_y, dx, dy = bx - ax, by - ay, x - ax, y - ay
        inside = inside and along_x * dy - along_y * dx >= 0.0
        share = min(1.0, max(0.0, (dx * along_x + dy * along_y) / (along_x**2 + along_y**2)))
        least = min(least, math.hypot(dx - share * along_x, dy - share * along_y))
    return 0.0 if inside else least
