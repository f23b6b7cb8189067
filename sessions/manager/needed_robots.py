"""Which robots the session manager needs: those with a session, with a queue, on the way to their
next visitor, or that may still owe states of a session. All others may be idle
(robots/api/idle.py).
"""

from django.db.models import Q

from robots.models import Robot
from sessions.leases.store import LIVE
from sessions.models import Session


def needed_robots() -> frozenset[str]:
    """Return their names, in one query."""
    unclosed = Q(state__in=LIVE) | Q(state=Session.State.ENDED, closed_at=None)
    busy = Session.objects.filter(unclosed).values("robot_id")
    needed = Robot.objects.filter(
        Q(pk__in=busy) | ~Q(presence__turnaround=Robot.Turnaround.READY), enabled=True
    )
    return frozenset(needed.order_by().values_list("name", flat=True))
