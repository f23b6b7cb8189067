"""The database queries of pages' connections: synchronous, with plain results.

Consumers call these through database.py, and never for a command or a signal, which are authorized
by the lease in memory.
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
from sessions.leases import store, terms
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
    """The data and permissions of a page that connects."""

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
        """Tell whether the visitor may drive or watch."""
        return bool(self.may_drive or self.may_observe)


@dataclass(frozen=True)
class Welcome:
    """The permissions of a connected page when they are checked again."""

    answer: Answer
    user: User | None = None  # read again, with the present rights
    may_observe: bool = False
    operator: Operator | None = None
    private: PrivateDrive | None = None


@dataclass(frozen=True)
class SessionStatus:
    """The status of a session in the database. `lease` is set while it holds the robot by this
    page's peer and epoch; `moved` when it does by another; `seconds` is the rest of an offer.
    """

    state: str
    outcome: str = ""
    reason: str = ""
    moved: bool = False
    lease: m.Lease | None = None
    seconds: float | None = None


def enter(user: User, name: str, now: datetime.datetime) -> ConnectionContext | None:
    """Return the context of a user's page at a robot, or None when there is no such robot."""
    robot = Robot.objects.filter(name=name).first()
    if robot is None:
        return None
    live = store.living_session_of(robot, user)
    is_live = live is not None and live.state != Session.State.WAITING
    is_left = live is not None and store.session_of(live).is_left(now.timestamp())
    return ConnectionContext(
        robot=robot,
        may_drive=may_drive(user, robot),
        may_observe=may_observe(user, robot),
        operator=_operator(user, robot),
        live_elsewhere=is_live and not is_left,
        live_since=store.began(live) if is_live else None,
        online=robot.is_online(now),
        waiting=waiting_at(robot, now),
        pause=store.pause_of(robot),
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
    """Tell whether a user may watch a private session: their own, or one that its terms allow."""
    own = Session.objects.filter(pk=session, visitor=user).exists()
    return own or terms.may_watch(user, session)


def _operator(user: User, robot: Robot) -> Operator | None:
    if not may_operate(user, robot):
        return None
    return "owner" if robot.owner_id == user.pk else "staff"


def welcome(session_key: str | None, user: User, robot: Robot) -> Welcome:
    """Check again whether a connected page's user is signed in and allowed, and the permissions."""
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
    """Return the user as stored now; None when the browser's session has ended by logout, a new
    password, expiry or staff. The object is new, because Django caches a user's permissions.
    """
    if session_key is None:
        return None
    browser = import_module(settings.SESSION_ENGINE).SessionStore(session_key)
    current = User.objects.filter(pk=user.pk, is_active=True).first()
    if current is None or browser.get(SESSION_KEY) != str(user.pk):
        return None
    known = browser.get(HASH_SESSION_KEY, "")
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
) -> store.Taken:
    """Take the robot if the user may drive it now; see sessions/leases/store.py."""
    robot.refresh_from_db()
    verdict = may_drive(user, robot)
    if not verdict:
        return Refused(reason=verdict.reason)  # type: ignore[arg-type]
    held = store.holder_of(robot, user)
    if held is not None and store.is_free_drive(held) and terms.claims(user, robot):
        # The free drive is no part of the study's session, and the robot returns to its dock before
        # that begins.
        store.end(str(held.session_id), Session.Outcome.COMPLETED, store.BEGINS_ANEW, now)
        held = session = None
    reason = terms.why_not(user, robot, now)
    if reason and held is None:  # a visitor who already drives may finish
        return Refused(reason=reason)  # type: ignore[arg-type]
    return store.take(
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
    """Return the status of a session for a page that drives, as far as it knows (with `epoch` and
    `peer`), or waits (epoch 0).
    """
    row = Session.objects.filter(pk=session).first()
    if row is None or row.state == Session.State.ENDED:
        return SessionStatus("ended", row.outcome if row else "", row.outcome_reason if row else "")
    rows = Lease.objects.select_related("robot", "session__visitor")
    lease = rows.filter(robot=robot, session=session).first()
    if lease is None:
        if row.offered_at is None:
            return SessionStatus(row.state)
        left = settings.START_SECONDS - (now - row.offered_at).total_seconds()
        return SessionStatus(row.state, seconds=left if left > 0.0 else None)
    if (lease.epoch, lease.peer) != (epoch, peer):
        return SessionStatus(row.state, moved=True)
    return SessionStatus(row.state, lease=store.message_of(lease, now))


def choose_assist(
    session: str, level: str, *, peer: str, now: datetime.datetime
) -> m.Lease | Literal["not_driver", "fixed"]:
    """Store the driver's level of assistance, and return the lease with it; or why it is refused:
    this page does not drive, or the level is fixed.
    """
    row = Session.objects.filter(pk=session).first()
    fixed = terms.FREE if row is None else terms.of(row)
    if fixed.assist is not None:
        return "fixed"
    lease = store.set_assist(session, level, peer=peer)
    return "not_driver" if lease is None else store.message_of(lease, now)


def outcome_of(session: str) -> tuple[str, str]:
    """Return (outcome, reason) of a session; empty while it has none."""
    row = Session.objects.filter(pk=session).values_list("outcome", "outcome_reason").first()
    return row or ("", "")


def is_of(session: str, visitor: User) -> bool:
    """Tell whether a session is this visitor's; False for an id that is not a session's."""
    try:
        return Session.objects.filter(pk=uuid.UUID(session), visitor=visitor).exists()
    except ValueError:
        return False


def waiting_at(robot: Robot, now: datetime.datetime) -> int:
    """Return how many visitors wait for a robot with an open page."""
    return Session.objects.filter(store.waits_here(now), robot=robot).count()


def queue_at(robot: Robot, now: datetime.datetime) -> tuple[int, str]:
    """Return how many visitors wait for a robot, and why it is not ready, empty when it is."""
    return waiting_at(robot, now), store.pause_of(robot)
