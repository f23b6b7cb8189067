"""Which things an eye sees, where in the frame, and how far away.

All things are placed in the frame by their corners, the near ones are cast, and things that no ray
meets before a wall are left out.
"""

from types import EllipsisType
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from robots.simulator.render.items import Things
from robots.simulator.render.lens import RAYS, ROWS, Lens
from robots.simulator.render.rays import (
    EDGE,
    FAR,
    Distances,
    Eye,
    Meetings,
    Places,
    angles,
    cast,
    looks_at,
    spans,
)
from robots.simulator.render.scene import SceneItem
from robots.simulator.render.texture_atlas import LEVELS
from robots.world.solids import Floats

NEAR = 0.05  # metres before the lens within which a corner cannot be projected
SORTED = 8  # every so manyth ray decides what stands before what
SMALLEST = 4  # rows, of which one is rounding: lower things are not drawn


class PictureWindow(NamedTuple):
    """A part of the frame: first row, last + 1, first column, last + 1."""

    top: int
    bottom: int
    left: int
    right: int

    @property
    def is_empty(self) -> bool:
        return self.bottom <= self.top or self.right <= self.left

    def within(self, other: "PictureWindow") -> "PictureWindow":
        return PictureWindow(
            max(self.top, other.top),
            min(self.bottom, other.bottom),
            max(self.left, other.left),
            min(self.right, other.right),
        )

    @property
    def paired(self) -> "PictureWindow":
        """Return the same, grown to rows that come in pairs: these share their azimuths."""
        return self._replace(
            top=self.top - self.top % ROWS, bottom=self.bottom + -self.bottom % ROWS
        )

    @property
    def pairs(self) -> tuple[EllipsisType, slice, slice]:
        """Return its rows in pairs and its columns, for tables (…, height / ROWS, width)."""
        return ..., slice(self.top // ROWS, self.bottom // ROWS), slice(self.left, self.right)


class ItemSight(NamedTuple):
    """An item as the rays of one eye meet it.

    `upper`, `lower` are the rows of the frame that its upper and its lower face lie in. `entry`,
    `leave` (RAYS,) are the metres at which a ray enters and leaves it, FAR where it does not or
    walls hide it; `texel` (RAYS,) is the atlas offset of its texture column.
    """

    item: SceneItem
    window: PictureWindow
    upper: tuple[int, int]
    lower: tuple[int, int]
    entry: Distances
    leave: Distances
    texel: npt.NDArray[np.int32]

    def within(self, window: PictureWindow) -> "ItemSight":
        return self._replace(window=self.window.within(window))


def look(
    things: Things, lens: Lens, eye: Eye, walls: Distances, within: PictureWindow
) -> list[ItemSight]:
    """Return an eye's sights within a part of the frame, the hidden before what hides them; `walls`
    (RAYS,) is how far it sees.

    Rays along a side divide by zero and miss it; the caller ignores numpy's warnings about that.
    """
    if not things.items or within.is_empty:
        return []
    sides = things.seen_from(eye.origin)
    level = eye.level(sides.reshape(-1, 2))
    azimuths, distance = angles(level), _distances(level[0::2], level[1::2])
    first, last = spans(lens, azimuths[0::2], azimuths[1::2], eye.rays())
    nearest = np.minimum.reduceat(distance, things.starts)
    begin, end = np.minimum.reduceat(first, things.starts), np.maximum.reduceat(last, things.starts)
    near = (end > begin) & (nearest < _farthest(walls, begin, end))
    faces = np.flatnonzero(near[things.owner])
    # where two faces of a thing meet the same ray, the nearer one is put in last
    faces = faces[np.argsort(-distance[faces])]
    looks = looks_at(sides[faces], eye.origin)
    fronts, backs = faces[looks], faces[~looks & things.deep[things.owner[faces]]]
    if not len(fronts):
        return []
    directions = eye.directions(lens)
    pool = _Pool(things, np.flatnonzero(near), nearest, lens.focal)
    edges = _edges(things, np.flatnonzero(near[things.owner]), level, lens, eye.height)
    both = np.concatenate([fronts, backs])
    entering, leaving = cast(sides[both], first[both], last[both], eye, directions).split(
        len(fronts)
    )
    pool.enter(fronts, entering, walls)
    if len(backs):
        pool.leave(backs, leaving)
    return pool.sights(edges, lens, eye.height, within)


def _edges(things: Things, faces: Places, level: Floats, lens: Lens, height: float) -> Floats:
    """Return (6, k) limits of the k things with the sides `faces` (f,): rows of the lower edge, of
    the upper edge, and columns. Things that reach behind the lens get the whole frame.
    """
    owner = things.owner[faces]
    starts = np.flatnonzero(np.append(True, owner[1:] != owner[:-1]))
    ends = level.reshape(-1, 4)[faces]
    forward, left = ends[:, 0::2].T, ends[:, 1::2].T
    u0, low, low_depth = lens.project(forward, left, (things.bottom[owner] - height)[None])
    u1, high, high_depth = lens.project(forward, left, (things.top[owner] - height)[None])
    depth = np.minimum.reduceat(np.minimum(low_depth, high_depth).min(axis=0), starts)
    left, right = np.minimum(u0, u1), np.maximum(u0, u1)
    edges = np.stack(
        [
            np.floor(np.minimum.reduceat(low.min(axis=0), starts)),
            np.ceil(np.maximum.reduceat(low.max(axis=0), starts)) + 1,
            np.floor(np.minimum.reduceat(high.min(axis=0), starts)),
            np.ceil(np.maximum.reduceat(high.max(axis=0), starts)) + 1,
            np.floor(np.minimum.reduceat(left.min(axis=0), starts)) - 1,
            np.ceil(np.maximum.reduceat(right.max(axis=0), starts)) + 2,
        ]
    )
    edges[:, depth < NEAR] = np.array([[0], [lens.height], [0], [lens.height], [0], [lens.width]])
    return edges


def _distances(start: Floats, end: Floats) -> Floats:
    """Return how far the origin is from segments (n, 2), (n, 2)."""
    along = end - start
    length2 = np.maximum((along**2).sum(axis=1), EDGE**2)
    share = np.minimum(np.maximum(-(start * along).sum(axis=1) / length2, 0.0), 1.0)
    foot = start + share[:, None] * along
    distances: Floats = np.hypot(foot[:, 0], foot[:, 1])
    return distances


def _farthest(walls: Distances, first: Places, last: Places) -> Distances:
    """Return the greatest of walls[first : last] (k,), of one ray where there is none between."""
    pairs = np.stack([first, last], axis=1).ravel()
    farthest: Distances = np.maximum.reduceat(np.append(walls, np.float32(0.0)), pairs)[0::2]
    return farthest


class _Pool:
    """A row of RAYS per item in `kept`: where rays come in and out, and what they meet."""

    def __init__(self, things: Things, kept: Places, nearest: Floats, focal: float) -> None:
        self._things, self._kept = things, kept
        self._row = np.full(len(things.items), -1, dtype=np.intp)
        self._row[kept] = np.arange(len(kept))
        self._level = np.clip(
            np.rint(np.log2(np.maximum(nearest / focal * things.density, EDGE))), 0, LEVELS - 1
        ).astype(np.intp)
        self._entry = np.full((len(kept), RAYS), FAR, dtype=np.float32)
        self._texel = np.zeros((len(kept), RAYS), dtype=np.int32)
        self._leave = self._entry

    def enter(self, faces: Places, meetings: Meetings, walls: Distances) -> None:
        """Take the fronts (f,) and how they are met, those that hide others last."""
        things, owner = self._things, self._things.owner[faces]
        seen = np.flatnonzero(meetings.met & (meetings.reach < walls[meetings.ray]))
        face, ray = meetings.row[seen], meetings.ray[seen]
        level = self._level[owner]
        share = meetings.share[seen]
        share = np.where(things.mirrored[owner][face], 1.0 - share, share)
        share = np.minimum(np.maximum(share, 0.0), 1.0 - EDGE)
        column = (share * things.columns[level, faces][face]).astype(np.intp)
        place = self._row[owner][face], ray
        self._entry[place] = meetings.reach[seen]
        self._texel[place] = things.offsets[level, faces][face] + column * things.rows[owner][face]

    def leave(self, faces: Places, meetings: Meetings) -> None:
        """Take the backs (b,) of what has an upper or a lower face."""
        seen = np.flatnonzero(meetings.met)
        self._leave = self._entry.copy()
        row = self._row[self._things.owner[faces]][meetings.row[seen]]
        self._leave[row, meetings.ray[seen]] = meetings.reach[seen]

    def sights(
        self, edges: Floats, lens: Lens, height: float, within: PictureWindow
    ) -> list[ItemSight]:
        """Return the sights in a part of the frame, far to near."""
        met = self._entry < np.float32(FAR)
        seen = np.flatnonzero(met.any(axis=1))
        met, entry, number = met[seen], self._entry[seen], self._kept[seen]
        sampled = _thinned(entry)
        nearest, farthest = sampled.min(axis=1), np.where(met, self._leave[seen], 0.0).max(axis=1)
        low, high = self._things.bottom[number] - height, self._things.top[number] - height
        left, right = lens.columns(met.argmax(axis=1), RAYS - met[:, ::-1].argmax(axis=1))
        low_from, low_to, high_from, high_to, begin, end = np.clip(
            edges[:, seen], 0, lens.width + lens.height
        ).astype(np.intp)
        first, last = lens.rows(
            np.maximum(high / nearest, high / farthest), np.minimum(low / nearest, low / farthest)
        )
        top = np.maximum(np.minimum(low_from, high_from), first)
        bottom = np.minimum(np.maximum(low_to, high_to), last)
        left, right = np.maximum(left, begin), np.minimum(right, end)
        places = np.stack(
            [top, bottom, left, right, high_from, high_to, low_from, low_to], axis=1
        ).tolist()
        found = [
            ItemSight(
                self._things.items[n],
                PictureWindow(*place[:4]).within(within),
                (place[4], place[5]),
                (place[6], place[7]),
                *arrays,
            )
            for n, place, *arrays in zip(
                number.tolist(), places, entry, self._leave[seen], self._texel[seen], strict=True
            )
        ]
        vertical = np.maximum(np.maximum(low, -high), 0.0).tolist()
        order = far_to_near(sampled, self._things.group[number], vertical)
        drawn = (found[n] for n in order if not found[n].window.is_empty)
        return [each for each in drawn if each.window.bottom - each.window.top >= SMALLEST]


def _thinned(entry: Distances) -> Distances:
    """Return the least of every SORTED rays next to each other."""
    while entry.shape[1] > RAYS // SORTED:
        entry = np.minimum(entry[:, 0::2], entry[:, 1::2])
    return entry


def far_to_near(nearest: Distances, group: Places, vertical: list[float]) -> list[int]:
    """Return the order in which to draw: the hidden before what hides them.

    Groups have disjoint convex outlines, more or less: where the same ray meets two of them,
    the nearer one hides the other, and within half a turn that has no cycles. Inside a group the
    parts lie one above the other: those further from the eye's height first, then the far ones.

    Args:
        nearest: (n, rays) how far away each part is, FAR where it is not.
        group: (n,) the number of its group; parts of one stand side by side.
        vertical: (n,) how far its range of heights is from the eye's.
    """
    if not len(group):
        return []
    begins = np.flatnonzero(np.append(True, group[1:] != group[:-1]))
    merged = np.minimum.reduceat(nearest, begins, axis=0)
    there = np.where(merged < np.float32(FAR), merged, np.float32(-1.0))
    nearer = np.count_nonzero(merged[:, None] < there[None], axis=2)
    hides = [sum(1 << j for j in np.flatnonzero(row).tolist()) for row in nearer > nearer.T]
    closest = merged.min(axis=1).tolist()
    left, place = set(range(len(begins))), dict[int, int]()
    remaining = (1 << len(begins)) - 1
    while left:
        chosen = max([i for i in left if not hides[i] & remaining] or left, key=closest.__getitem__)
        place[chosen] = len(place)
        left.remove(chosen)
        remaining &= ~(1 << chosen)
    member = np.repeat(np.arange(len(begins)), np.diff(np.append(begins, len(group)))).tolist()
    own = nearest.min(axis=1).tolist()
    return sorted(range(len(group)), key=lambda n: (place[member[n]], -vertical[n], -own[n]))
