"""The hidden operator's part of a lease in the database: taken, released, and recorded.

The visitor holds the lease; these functions change who drives under it. As in
sessions/leases/store.py, correctness rests on comparing and setting: the operator changes only if
lease and operator are still those that were read, and every change has a new epoch, so that
commands of the previous page are void.
"""

import datetime
from typing import Any, Literal

from django.db.models import F

from accounts.models import User
from robots.api import messages as m
from robots.models import Robot
from sessions.leases import terms
from sessions.leases.store import LIVE, message_of
from sessions.models import Lease, Session, SessionEvent

Refusal = Literal["occupied", "ended", "refused"]
ATTEMPTS = 20
STEP, LINE, BY_HAND, REACHED = "wizard_step", "wizard_line", "wizard_by_hand", "wizard_reached"
TOOK, LEFT, LOST = "wizard_took", "wizard_left", "wizard_lost"


def session_at(robot: Robot) -> Session | None:
    """Return the session that holds a robot, if a hidden operator is to drive in it."""
    lease = (
        Lease.objects.filter(robot=robot, session__state__in=LIVE)
        .exclude(session__state=Session.State.WAITING)
        .select_related("session__visitor")
        .first()
    )
    session = lease.session if lease is not None else None
    return session if session is not None and terms.of(session).driver == "wizard" else None


def operator_of(session: Session) -> str:
    """Return the peer of the page that operates a session; empty while none does."""
    peer = Lease.objects.filter(session=session).values_list("wizard_peer", flat=True).first()
    return peer or ""


def take(
    session: str, user: User, peer: str, now: datetime.datetime, *, takeover: bool = False
) -> m.Lease | Refusal:
    """Let a page of a permitted operator (sessions/wizard/operators.py) drive in a session, and
    return the new lease.

    Only a `takeover` replaces another user; the newest page of a user replaces earlier ones.
    """
    for _ in range(ATTEMPTS):
        lease = _lease_of(session)
        if lease is None or lease.session is None:
            return "ended"
        if terms.of(lease.session).driver != "wizard":
            return "refused"
        if lease.wizard_peer and lease.wizard_id != user.pk and not takeover:
            return "occupied"
        if _change(lease, peer, user):
            return _message(session, now)
    return "ended"


def release(session: str, peer: str, now: datetime.datetime) -> m.Lease | None:
    """Stop operating a session, and return the new lease; None if this page does not operate it."""
    lease = _lease_of(session)
    if lease is None or lease.wizard_peer != peer or not _change(lease, "", None):
        return None
    return _message(session, now)


def _lease_of(session: str) -> Lease | None:
    living = Lease.objects.filter(session_id=session, session__state__in=LIVE)
    found: Lease | None = living.select_related("robot", "session__visitor").first()
    return found


def _change(lease: Lease, peer: str, user: User | None) -> bool:
    """Change the operator if lease and operator are unchanged; no other statement does."""
    unchanged = Lease.objects.filter(
        robot=lease.robot_id, epoch=lease.epoch, wizard_epoch=lease.wizard_epoch
    )
    changed = unchanged.update(
        wizard_peer=peer,
        wizard=user,
        wizard_epoch=lease.wizard_epoch + 1,
        renewal=F("renewal") + 1,
    )
    return bool(changed)


def _message(session: str, now: datetime.datetime) -> m.Lease:
    rows = Lease.objects.select_related("robot", "session__visitor")
    return message_of(rows.get(session_id=session), now)


def note(session: str, kind: str, user: User, now: datetime.datetime, **data: Any) -> None:
    """Record an action of a session's operator, whose key datasets replace by a pseudonym."""
    event = SessionEvent.of_server(session, kind, now, {**data, "by": str(user.pk)})
    event.save(force_insert=True)


def steps_done(session: str) -> list[tuple[float, str]]:
    """Return (Unix seconds, key) of the steps that were begun and sent, in order."""
    rows = SessionEvent.server_events(session, STEP).order_by("stamp")
    return [
        (stamp, str(data.get("step", "")))
        for stamp, data in rows.values_list("stamp", "data")
        if not data.get("reason")
    ]
