"""The summary of a complete record, so that no list must read the states."""

from collections import Counter
from collections.abc import Iterable
from typing import Any


def summarise(
    runs: Iterable[tuple[str, list[dict[str, Any]]]], *, missing: int = 0
) -> dict[str, Any]:
    """Return the summary of a session's states.

    Args:
        runs: (boot, states) in order of time, states as in StateChunk.states.
        missing: how many states are known to be lost.

    Returns:
        `states`, `missing`, `seconds` (first to last stamp), `distance` (m, by odometry),
        `commands`, `methods` and `ways` (commands by input method and by way), `contacts`,
        `least_clearance` (m, None when never measured).
    """
    total = _Total()
    for boot, states in runs:
        for state in states:
            total.add(boot, state)
    return {**total.fields(), "missing": missing}


class _Total:
    def __init__(self) -> None:
        self.states = 0
        self.contacts = 0
        self.distance = 0.0
        self.first = self.last = None
        self.odometers: dict[str, float] = {}  # the newest reading of each run, in metres
        self.methods: Counter[str] = Counter()
        self.ways: Counter[str] = Counter()
        self.clearances: list[float] = []

    def add(self, boot: str, state: dict[str, Any]) -> None:
        self.states += 1
        self.first = state["stamp"] if self.first is None else min(self.first, state["stamp"])
        self.last = state["stamp"] if self.last is None else max(self.last, state["stamp"])
        odometer = state.get("distance", 0.0)
        # A run's odometer only grows; its first reading in the session is the session's start.
        self.distance += max(0.0, odometer - self.odometers.get(boot, odometer))
        self.odometers[boot] = odometer
        self.contacts += state.get("contacts", 0)
        for command in state.get("applied", ()):
            self.methods[command["method"]] += 1
            self.ways[command["way"]] += 1
        if state.get("clearance") is not None:
            self.clearances.append(state["clearance"])

    def fields(self) -> dict[str, Any]:
        return {
            "states": self.states,
            "seconds": round(self.last - self.first, 3)
            if self.first is not None and self.last is not None
            else 0.0,
            "distance": round(self.distance, 3),
            "commands": sum(self.methods.values()),
            "methods": dict(self.methods),
            "ways": dict(self.ways),
            "contacts": self.contacts,
            "least_clearance": min(self.clearances, default=None),
        }
