"""Which process is the session manager: the one whose name stands in the row and whose beat is
young.

The row changes hands by one conditional update. A manager that was stopped cleanly gives it back;
one that was killed is succeeded at once by another of its computer, which knows that it is dead
(sessions/manager/lock_file.py), and by any other after STALE_SECONDS, which is short enough that a
lease (10 s) outlives the change.
"""

import datetime
from typing import Any

from django.db.models import Q

from sessions.models import ManagerBeat

NAME = "session_manager"
HEARTBEAT_INTERVAL_S = 1.0
WAIT_SECONDS = 0.5  # between two attempts of one that waits
STALE_SECONDS = 4.0
_LONG_AGO = datetime.datetime(2000, 1, 1, tzinfo=datetime.UTC)


def beat(
    holder: str, now: datetime.datetime, report: dict[str, Any] | None = None, *, dead: str = ""
) -> bool:
    """Take the row, or keep it; False while somebody else has it.

    `report` is how its holder does (SessionManager.report), for the web processes that answer
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
    """Let another process take the row at once."""
    ManagerBeat.objects.filter(name=NAME, holder=holder).update(holder="", beat_at=_LONG_AGO)
