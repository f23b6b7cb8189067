"""Which process is the session manager: the one whose name is in the row and whose heartbeat is
young.

The row changes hands by one conditional update. A manager that was stopped cleanly gives it back;
one that was killed is succeeded at once by another of its computer, which knows that it is dead
(sessions/manager/lock_file.py), and by any other after STALE_SECONDS, which is short enough that a
lease (10 s) outlives the change.
"""

import datetime
import os
import secrets
import socket
from pathlib import Path
from typing import Any

from django.db.models import Q
from django.utils import timezone

from sessions.leases.absences import note_manager_absence
from sessions.manager.database_thread import DatabaseThread
from sessions.manager.health import ManagerHealth
from sessions.manager.lock_file import LockFile
from sessions.models import STALE_SECONDS, ManagerBeat

NAME = "session_manager"
HEARTBEAT_INTERVAL_S = 1.0
WAIT_SECONDS = 0.5  # between two attempts of one that waits
LEFT = "left_at"  # in the report of a row that was given back: Unix seconds
_LONG_AGO = datetime.datetime(2000, 1, 1, tzinfo=datetime.UTC)


class LeaderElection:
    """One process's part in it, from its start to its end.

    Args:
        lock_file: tells a successor on this computer that this process is dead.
        health: is told how heartbeats go.
    """

    def __init__(self, lock_file: Path, health: ManagerHealth) -> None:
        self.holder = f"{socket.gethostname()}:{os.getpid()}:{secrets.token_hex(4)}"
        self._lock_file = LockFile(lock_file)
        self._thread = DatabaseThread("heartbeat", health)
        self._leads = False
        self._before: datetime.datetime | None = None  # when the one before was last alive

    async def win(self) -> bool:
        """Take the row; False while somebody else has it, or the database is away."""
        return bool(await self._thread.attempt(self._heartbeat, {}, refused=False))

    async def keep(self, report: dict[str, Any]) -> bool:
        """Say that this process leads, and how it does; False when another one has taken over.

        While the database is away nobody can take it, so that this process goes on.
        """
        return bool(await self._thread.attempt(self._heartbeat, report, refused=True))

    def _heartbeat(self, report: dict[str, Any]) -> bool:
        dead, now = self._lock_file.predecessor(), timezone.now()
        if not self._leads and (before := last_alive(self.holder)) is not None:
            self._before = before
        ours = heartbeat(self.holder, now, report, dead=dead)
        if ours:
            self._lock_file.sign(self.holder)
            self._begin(now)
        self._leads = ours
        return ours

    def _begin(self, now: datetime.datetime) -> None:
        """Note how long nobody led, once it is this process that does."""
        if self._before is not None and (now - self._before).total_seconds() > STALE_SECONDS:
            note_manager_absence(self._before, now)
        self._before = None

    async def close(self) -> None:
        """Let another process lead at once."""
        await self._thread.attempt(give_back, self.holder)
        self._lock_file.release()
        await self._thread.close()


def heartbeat(
    holder: str, now: datetime.datetime, report: dict[str, Any] | None = None, *, dead: str = ""
) -> bool:
    """Take the row, or keep it; False while somebody else has it.

    `report` is how its holder does (ActiveManager.report), for the web processes that answer
    /readyz and /metrics. `dead` is a holder of whom it is certain that its process is gone.
    """
    ManagerBeat.objects.get_or_create(name=NAME, defaults={"beat_at": _LONG_AGO})
    free = Q(holder__in={holder, dead or holder}) | Q(
        beat_at__lt=now - datetime.timedelta(seconds=STALE_SECONDS)
    )
    return bool(
        ManagerBeat.objects.filter(free, name=NAME).update(
            holder=holder, beat_at=now, report=report or {}
        )
    )


def give_back(holder: str) -> None:
    """Let another process take the row at once; the report says when this one was last alive."""
    last = last_alive("")
    ManagerBeat.objects.filter(name=NAME, holder=holder).update(
        holder="", beat_at=_LONG_AGO, report={LEFT: last.timestamp()} if last else {}
    )


def last_alive(holder: str) -> datetime.datetime | None:
    """Return when a holder other than this one was last alive; None when there never was any."""
    row = ManagerBeat.objects.filter(name=NAME).exclude(holder=holder or "-").first()
    if row is None:
        return None
    left = row.report.get(LEFT)
    if row.beat_at == _LONG_AGO:
        return None if left is None else datetime.datetime.fromtimestamp(left, datetime.UTC)
    return row.beat_at
