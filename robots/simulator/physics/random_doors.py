"""Doors that open and close by themselves, as people leave them: at most one is closed, so that in
most sites every room can be reached.
"""

import math

import numpy as np

from robots.api.floorplan import DoorState


class RandomDoors:
    """Chooses which door moves when; there are `mean` seconds between two changes, on average
    (exponentially distributed), 0 for never.
    """

    def __init__(self, doors: tuple[str, ...], mean: float, rng: np.random.Generator) -> None:
        self._doors, self._mean, self._rng = doors, mean, rng
        self._closed: str | None = None
        self._next = self._after(0.0) if doors and mean > 0.0 else math.inf

    def due(self, time: float) -> dict[str, DoorState]:
        """Return the new changes up to `time` seconds since the start."""
        changes: dict[str, DoorState] = {}
        while time >= self._next:
            changes |= self._change()
            self._next = self._after(self._next)
        return changes

    def leave(self, names: set[str]) -> None:
        """Stop moving these doors."""
        self._doors = tuple(door for door in self._doors if door not in names)
        if self._closed in names:
            self._closed = None
        if not self._doors:
            self._next = math.inf

    def _after(self, time: float) -> float:
        return time + float(self._rng.exponential(self._mean))

    def _change(self) -> dict[str, DoorState]:
        if self._closed is not None:
            opened, self._closed = self._closed, None
            return {opened: "open"}
        self._closed = self._doors[int(self._rng.integers(len(self._doors)))]
        return {self._closed: "closed"}
