"""A line to drive along, measured by the way from its start."""

from dataclasses import dataclass, field

import numpy as np

from robots.world.sensing import Floats

SPACING = 0.05


@dataclass(frozen=True, eq=False)
class PlannedPath:
    """Points (n, 2) in metres, n >= 1, and the way (n,) from the first to each."""

    points: Floats
    along: Floats = field(init=False)

    def __post_init__(self) -> None:
        steps = np.hypot(*np.diff(self.points, axis=0).T)
        object.__setattr__(self, "along", np.concatenate([[0.0], np.cumsum(steps)]))

    @property
    def length(self) -> float:
        return float(self.along[-1])

    @property
    def end(self) -> tuple[float, float]:
        return float(self.points[-1, 0]), float(self.points[-1, 1])

    def at(self, along: float) -> tuple[float, float]:
        """Return the point `along` metres from the start, within the line's ends."""
        x, y = self.interpolated(np.array([along]))[0]
        return float(x), float(y)

    def interpolated(self, along: Floats) -> Floats:
        """Return the points (m, 2) at distances (m,) from the start."""
        axes = (np.interp(along, self.along, self.points[:, axis]) for axis in (0, 1))
        return np.column_stack(list(axes))

    def nearest(self, x: float, y: float, start: float, stop: float) -> float:
        """Return the way, from `start` to `stop`, of the line's point nearest to (x, y)."""
        here = (self.along >= start - SPACING) & (self.along <= stop + SPACING)
        if not here.any():
            return min(max(start, 0.0), self.length)
        index = np.flatnonzero(here)
        distances = (self.points[index, 0] - x) ** 2 + (self.points[index, 1] - y) ** 2
        return float(self.along[index[int(np.argmin(distances))]])

    def between(self, start: float, stop: float) -> Floats:
        """Return the points (m, 2) whose way lies between two distances; at least the end."""
        chosen: Floats = self.points[(self.along >= start) & (self.along <= stop)]
        return chosen if len(chosen) else self.points[-1:]

    def sharpest_bend(self, start: float, stop: float) -> float:
        """Return the largest curvature (1/m) between two distances, over a quarter of a metre."""
        distances = np.arange(start, min(stop, self.length - 0.125), SPACING)
        if len(distances) == 0:
            return 0.0
        spots = [self.interpolated(distances + off) for off in (-0.125, 0.0, 0.125)]
        before, behind = spots[1] - spots[0], spots[2] - spots[1]
        across = before[:, 0] * behind[:, 1] - before[:, 1] * behind[:, 0]
        along = (before * behind).sum(axis=1)
        return float(np.abs(np.arctan2(across, along)).max() / 0.125)


def resampled(points: Floats, spacing: float = SPACING) -> Floats:
    """Return the line with a point about every `spacing` metres, without doubles."""
    steps = np.hypot(*np.diff(points, axis=0).T)
    kept: Floats = points[np.concatenate([[True], steps > 1e-9])]
    if len(kept) == 1:
        return kept
    path = PlannedPath(kept)
    count = max(2, round(path.length / spacing) + 1)
    return path.interpolated(np.linspace(0.0, path.length, count))
