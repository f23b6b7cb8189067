"""Scene items side by side in arrays, so that all of them are placed in a frame at once."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from robots.api.geometry import Pose2D
from robots.simulator.render.rays import EDGE, Mask, Places
from robots.simulator.render.scene import SceneItem, moved_sides
from robots.world.solids import Floats


@dataclass(frozen=True, eq=False)
class Things:
    """k items with n sides: first sides `starts` (k,), items `owner` (n,), rest as SceneItem."""

    items: tuple[SceneItem, ...]
    sides: Floats
    owner: Places
    starts: Places
    bottom: Floats
    top: Floats
    density: Floats
    rows: Places
    offsets: npt.NDArray[np.intp]
    columns: npt.NDArray[np.intp]
    deep: Mask
    group: Places
    billboards: Places
    mirrored: Mask

    def seen_from(self, origin: Floats) -> Floats:
        """Return all sides (n, 4), billboards turned to the eye."""
        if not len(self.billboards):
            return self.sides
        sides = self.sides.copy()
        sides[self.billboards] = turned(sides[self.billboards], origin)
        return sides

    def moved(self, pose: Pose2D) -> "Things":
        """Return items made about the origin at a pose; a lid's texture is not turned."""
        return replace(self, sides=moved_sides(self.sides, pose))


def gather(items: tuple[SceneItem, ...]) -> Things:
    """Return items in arrays."""
    counts = [len(item.sides) for item in items]
    starts = np.cumsum([0, *counts])[:-1].astype(np.intp)
    names = {name: n for n, name in enumerate(dict.fromkeys(item.group for item in items))}
    none = np.zeros((items[0].offsets.shape[0] if items else 1, 0), dtype=np.intp)
    return Things(
        items=items,
        sides=np.vstack([np.zeros((0, 4)), *(item.sides for item in items)]),
        owner=np.repeat(np.arange(len(items)), counts),
        starts=starts,
        bottom=np.array([item.bottom for item in items]),
        top=np.array([item.top for item in items]),
        density=np.array([item.density for item in items]),
        rows=np.array([item.rows for item in items], dtype=np.intp),
        offsets=np.hstack([none, *(item.offsets for item in items)]),
        columns=np.hstack([none, *(item.columns for item in items)]),
        deep=np.array([item.lid is not None or item.under >= 0 for item in items], dtype=np.bool_),
        group=np.array([names[item.group] for item in items], dtype=np.intp),
        billboards=np.array(
            [start for start, item in zip(starts, items, strict=True) if item.billboard],
            dtype=np.intp,
        ),
        mirrored=np.array([item.mirrored for item in items], dtype=np.bool_),
    )


def joined(first: Things, second: Things) -> Things:
    """Return the items of both; their groups are different ones."""
    if not second.items or not first.items:
        return first if first.items else second
    sides = len(first.sides)
    unchanged: dict[str, Any] = {
        name: np.concatenate([getattr(first, name), getattr(second, name)], axis=-1)
        for name in ("bottom", "top", "density", "rows", "offsets", "columns", "deep", "mirrored")
    }
    return Things(
        items=first.items + second.items,
        sides=np.concatenate([first.sides, second.sides]),
        owner=np.concatenate([first.owner, second.owner + len(first.items)]),
        starts=np.concatenate([first.starts, second.starts + sides]),
        group=np.concatenate([first.group, second.group + int(first.group.max()) + 1]),
        billboards=np.concatenate([first.billboards, second.billboards + sides]),
        **unchanged,
    )


def before(things: Things, point: Floats, normal: Floats) -> Things:
    """Return the things that do not lie wholly behind a line through `point`."""
    ends = ((things.sides.reshape(-1, 2) - point) @ normal).reshape(-1, 2)
    ahead = np.maximum.reduceat(ends.max(axis=1), things.starts) > 0.0
    return gather(tuple(things.items[n] for n in np.flatnonzero(ahead)))


def turned(sides: Floats, origin: Floats) -> Floats:
    """Return upright faces (n, 4) turned about their middles to a viewer at `origin`."""
    middle = (sides[:, :2] + sides[:, 2:]) / 2.0
    half = np.hypot(sides[:, 2] - sides[:, 0], sides[:, 3] - sides[:, 1]) / 2.0
    away = middle - origin
    right = (
        np.column_stack([away[:, 1], -away[:, 0]])
        * (half / np.maximum(np.hypot(away[:, 0], away[:, 1]), EDGE))[:, None]
    )
    return np.hstack([middle - right, middle + right])
