"""What a page's connection asks the database: synchronous, one question a function, plain answers.

Consumers call these through database.py, and never for a command or a signal: those
are judged by the lease in memory.
"""

import datetime
import uuid
from dataclasses import dataclass
from importlib import import_module
from typing import Any, Literal

from django.conf import settings
from django.contrib.auth import HASH_SESSION_KEY, SESSION_KEY
from django.utils.crypto import constant_time_compare

from accounts.models import User
from robots.access import Verdict, may_drive, may_observe, may_operate
from robots.api import messages as m
from robots.models import Robot
from sessions.consumers.authorization import Operator
from sessions.leases import store as turns
from sessions.leases import terms
from sessions.models import Lease, Session
from sessions.protocol import Refused

Answer = Literal["welcome", "signed_out", "not_allowed"]


@dataclass(frozen=True)
class PrivateDrive:
    """A private session that has the robot now, and whether a user may watch it."""

    session: str
    may_watch: bool


@dataclass(frozen=True)
class ConnectionContext:
    """What a page is told, and may do, when it connects."""

    robot: Robot
    may_drive: Verdict
    may_observe: Verdict
    operator: Operator | None
    live_elsewhere: bool
    live_since: float | None
    online: bool
    waiting: int
    pause: str
    private: PrivateDrive | None

    @property
    def may_enter(self) -> bool:
        """Tell whether there is anything at all for this visitor here."""
        return bool(self.may_drive or self.may_observe)


@dataclass(frozen=True)
class Welcome:
    """What a page that is already inside is told when it is looked at again."""

    answer: Answer
    user: User | None = None  # with the rights of now
    may_observe: bool = False
    operator: Operator | None = None
    private: PrivateDrive | None = None


@dataclass(frozen=True)
class SessionStatus:
    """Where a session really stands: `lease` is set while it holds the robot through this very page
    and epoch.

    `seconds` is what is left of an offered turn.
    """

    state: str
    outcome: str = ""
    reason: str = ""
    moved: bool = False
    lease: m.Lease | None = None
    seconds: float | None = None


def enter(user: User, name: str, now: datetime.datetime) -> ConnectionContext | None:
    """Return what a robot's door says to a user, or None when there is no such robot."""
    robot = Robot.objects.filter(name=name).first()
    if robot is None:
        return None
    live = turns.living_session_of(robot, user)
    is_live = live is not None and live.state != Session.State.WAITING
    is_left = live is not None and turns.session_of(live).is_left(now.timestamp())
    return ConnectionContext(
        robot=robot,
        may_drive=may_drive(user, robot),
        may_observe=may_observe(user, robot),
        operator=_operator(user, robot),
        live_elsewhere=is_live and not is_left,
        live_since=turns.began(live) if is_live else None,
        online=robot.is_online(now),
        waiting=waiting_at(robot, now),
        pause=turns.pause_of(robot),
        private=private_drive(user, robot),
    )


def private_drive(user: User, robot: Robot) -> PrivateDrive | None:
    """Return the private session that has a robot now; None when there is none."""
    holder = Session.objects.filter(leases__robot=robot).first()
    if holder is None or not terms.of(holder).private:
        return None
    session = str(holder.pk)
    return PrivateDrive(session, may_watch_private(user, session))


def may_watch_private(user: User, session: str) -> bool:
    """Tell whether a user may watch a private session: their own, or as its terms have it."""
    own = Session.objects.filter(pk=session, visitor=user).exists()
    return own or terms.may_watch(user, session)


def _operator(user: User, robot: Robot) -> Operator | None:
    if not may_operate(user, robot):
        return None
    return "owner" if robot.owner_id == user.pk else "staff"


def welcome(session_key: str | None, user: User, robot: Robot) -> Welcome:
    """Tell whether a page that is already inside may stay, still signed in and still allowed, and
    what it may do.
    """
    current = signed_in(session_key, user)
    if current is None:
        return Welcome("signed_out")
    robot.refresh_from_db()
    observes = bool(may_observe(current, robot))
    if not (observes or may_drive(current, robot)):
        return Welcome("not_allowed")
    operator, private = _operator(current, robot), private_drive(current, robot)
    return Welcome("welcome", current, observes, operator, private)


def signed_in(session_key: str | None, user: User) -> User | None:
    """Return the user as stored now; None when logging out, a new password, expiry or staff have
    ended the browser's session. It is another object, because one keeps the rights that it was once
    asked for.
    """
    if session_key is None:
        return None
    store = import_module(settings.SESSION_ENGINE).SessionStore(session_key)
    current = User.objects.filter(pk=user.pk, is_active=True).first()
    if current is None or store.get(SESSION_KEY) != str(user.pk):
        return None
    known = store.get(HASH_SESSION_KEY, "")
    return current if constant_time_compare(known, current.get_session_auth_hash()) else None


def take(
    robot: Robot,
    user: User,
    peer: str,
    *,
    session: str | None,
    old_peer: str | None,
    takeover: bool,
    device: dict[str, Any],
    now: datetime.datetime,
) -> turns.Taken:
    """Ask for the robot, if the user may drive it now; see sessions/leases/store.py."""
    robot.refresh_from_db()
    verdict = may_drive(user, robot)
    if not verdict:
        return Refused(reason=verdict.reason)  # type: ignore[arg-type]
    held = turns.holder_of(robot, user)
    if held is not None and turns.is_free_drive(held) and terms.claims(user, robot):
        # What was driven for oneself is no part of what begins now, and the robot goes home in
        # between.
        turns.end(str(held.session_id), Session.Outcome.COMPLETED, turns.BEGINS_ANEW, now)
        held = session = None
    reason = terms.why_not(user, robot, now)
    if reason and held is None:  # whoever drives already may finish
        return Refused(reason=reason)  # type: ignore[arg-type]
    return turns.take(
        robot,
        user,
        peer,
        session=session,
        old_peer=old_peer,
        takeover=takeover,
        device=device,
        now=now,
    )


def session_status_of(
    robot: Robot, session: str, *, epoch: int, peer: str, now: datetime.datetime
) -> SessionStatus:
    """Return where a session stands, for a page that thinks it drives (with `epoch` and `peer`) or
    waits (epoch 0).
    """
    row = Session.objects.filter(pk=session).first()
    if row is None or row.state == Session.State.ENDED:
        return SessionStatus("ended", row.outcome if row else "", row.outcome_reason if row else "")
    rows = Lease.objects.select_related("robot", "session__visitor")
    lease = rows.filter(robot=robot, session=session).first()
    if lease is None:
        left = (
            None
            if row.offered_at is None
            else settings.START_SECONDS - (now - row.offered_at).total_seconds()
        )
        return SessionStatus(row.state, seconds=left if left is not None and left > 0.0 else None)
    if (lease.epoch, lease.peer) != (epoch, peer):
        return SessionStatus(row.state, moved=True)
    return SessionStatus(row.state, lease=turns.message_of(lease, now))


def choose_assist(
    session: str, level: str, *, peer: str, now: datetime.datetime
) -> m.Lease | Literal["not_driver", "fixed"]:
    """Note how much help a driver wants, and return the lease that says so; or why not: this page
    does not drive, or has no choice.
    """
    row = Session.objects.filter(pk=session).first()
    fixed = terms.FREE if row is None else terms.of(row)
    if fixed.assist is not None:
        return "fixed"
    lease = turns.set_assist(session, level, peer=peer)
    return "not_driver" if lease is None else turns.message_of(lease, now)


def outcome_of(session: str) -> tuple[str, str]:
    """Return (outcome, reason) of a session; empty while it has none."""
    row = Session.objects.filter(pk=session).values_list("outcome", "outcome_reason").first()
    return row or ("", "")


def is_of(session: str, visitor: User) -> bool:
    """Return whether a session is this visitor's; false for what is no session at all."""
    try:
        return Session.objects.filter(pk=uuid.UUID(session), visitor=visitor).exists()
    except ValueError:
        return False


def waiting_at(robot: Robot, now: datetime.datetime) -> int:
    """Return how many visitors wait for a robot with an open page."""
    return Session.objects.filter(turns.waits_here(now), robot=robot).count()


def between_visits_at(robot: Robot, now: datetime.datetime) -> tuple[int, str]:
    """Return how many visitors wait for a robot, and why it is not ready, empty when it is."""
    return waiting_at(robot, now), turns.pause_of(robot)
