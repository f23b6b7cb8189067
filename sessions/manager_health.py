"""What the session manager lacks to do its work, for its heartbeat: pure, `now` is monotonic seconds."""

from typing import Literal

from robots.api.disk_space import DiskState

HELD_SECONDS = 1.2  # for which a look may take its time; one follows another twice a second
FAILED_SECONDS = 2.0  # for which one that was refused counts: others between them may only have read
Word = Literal["database", "disk_low", "disk_full"]
_SQLITE_FULL = "database or disk is full"
_POSTGRES_FULL = "53100"  # SQLSTATE disk_full


class ManagerHealth:
    """How the last looks at the database went."""

    def __init__(self) -> None:
        self._looked_at = 0.0
        self._refused_at: dict[Word, float] = {}

    def looked(self, now: float) -> None:
        """A step in the database came back."""
        self._looked_at = now

    def refused(self, error: Exception, now: float) -> None:
        """The database refused a step."""
        self._looked_at = now
        self._refused_at["disk_full" if is_disk_full(error) else "database"] = now

    def faults(self, now: float, disk: DiskState) -> tuple[Word, ...]:
        """Return what fails now: a database that says nothing is as good as none."""
        found = {word for word, at in self._refused_at.items() if now - at < FAILED_SECONDS}
        if now - self._looked_at >= HELD_SECONDS:
            found.add("database")
        if disk == "full":
            found.add("disk_full")
        elif disk == "low" and "disk_full" not in found:
            found.add("disk_low")
        return tuple(sorted(found))


def is_disk_full(error: Exception) -> bool:
    """Tell whether a database refused because there is no room: SQLite's own sentence, or PostgreSQL's code."""
    return _SQLITE_FULL in str(error) or getattr(error.__cause__, "sqlstate", None) == _POSTGRES_FULL
