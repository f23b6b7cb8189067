"""The faults that keep the session manager from its work: pure, `now` is monotonic seconds."""

from typing import Literal

from robots.api.disk_space import DiskState
from sessions.disk_full import is_disk_full

HELD_SECONDS = 0.6  # a step that takes longer is a fault
# for which a refused or slow step counts: successful ones in between may only have read
FAILED_SECONDS = 2.0
Fault = Literal["database", "disk_low", "disk_full"]


class ManagerHealth:
    """The outcome of the last steps in the database: ticks, which mostly read, and heartbeats,
    which write. Steps begin and end in other threads.
    """

    def __init__(self) -> None:
        self._begun: dict[object, float] = {}
        self._refused_at: dict[Fault, float] = {}

    def begun(self, step: object, now: float) -> None:
        """Note that a step has begun."""
        self._begun[step] = now

    def ended(self, step: object, now: float) -> None:
        """Note that a step has ended, with or without an error."""
        if now - self._begun.pop(step) >= HELD_SECONDS:
            self._refused_at["database"] = now

    def refused(self, error: Exception, now: float) -> None:
        """Note that the database refused a step."""
        self._refused_at["disk_full" if is_disk_full(error) else "database"] = now

    def faults(self, now: float, disk: DiskState) -> tuple[Fault, ...]:
        """Return the present faults; a database that does not answer is one."""
        found = {word for word, at in list(self._refused_at.items()) if now - at < FAILED_SECONDS}
        if any(now - at >= HELD_SECONDS for at in list(self._begun.values())):
            found.add("database")
        if disk == "full":
            found.add("disk_full")
        elif disk == "low" and "disk_full" not in found:
            found.add("disk_low")
        return tuple(sorted(found))
