"""The transitions of sessions/leases/transitions.py, carried out in the database.

Between the decision and the update, another process may end the session, or its visitor may
reconnect. Every update therefore names the state that was decided on, and a transition that did not
happen is not reported.
"""

import datetime
from typing import Any

from robots.models import Robot
from sessions.leases.policy import ActiveSession, Scene
from sessions.leases.store import change_lease, end, fix_terms, load_scene, rules_of, update_living
from sessions.leases.terms import NotGranted
from sessions.leases.transitions import (
    IDLE,
    FirstMotion,
    MarkLost,
    ReleaseLease,
    RobotLink,
    SetState,
    Transition,
    TurnLimited,
    TurnUnlimited,
    WithdrawOffer,
    decide_tick,
)
from sessions.models import Session
from sessions.protocol import Ended, Offered, PresenceAsked, PresenceConfirmed, TurnWarning

WAITING = Session.State.WAITING


def tick(
    robot: Robot, link: RobotLink, now: datetime.datetime, scene: Scene | None = None
) -> tuple[Transition, ...]:
    """Carry out the transitions that are due at one robot, and return those that happened. A caller
    that has read the scenes of many robots together passes `scene`.
    """
    scene = load_scene(robot, now) if scene is None else scene
    return tuple(
        transition
        for transition in decide_tick(scene, link, rules_of(robot), now.timestamp())
        if _perform(transition, scene, link, robot, now)
    )


def _perform(
    transition: Transition, scene: Scene, link: RobotLink, robot: Robot, now: datetime.datetime
) -> bool:
    """Carry out one transition; False when the row has changed since the scene was read, in which
    case the next tick decides again.
    """
    match transition:
        case ReleaseLease(epoch):
            return change_lease(robot, epoch, now=now)
        case SetState():
            return _set_state(transition, _session(scene, transition.session), now)
        case Ended(session=session, outcome=outcome, reason=reason):
            # The page may have sent a sign of its visitor since the decision.
            sign_came = reason == IDLE and link.signs.get(session, 0.0) >= now.timestamp()
            return not sign_came and end(
                session, outcome, reason, now, **_as_decided(_session(scene, session))
            )
        case TurnWarning() | PresenceAsked() | PresenceConfirmed():
            return True
        case _:
            return _change_row(transition, now)


def _change_row(
    transition: FirstMotion | TurnLimited | TurnUnlimited | Offered | WithdrawOffer | MarkLost,
    now: datetime.datetime,
) -> bool:
    match transition:
        case FirstMotion(session):
            return update_living(session, {"first_motion_at": now}, first_motion_at=None)
        case TurnLimited(session, ends_at):
            return update_living(session, {"turn_ends_at": _at(ends_at)})
        case TurnUnlimited(session):
            return update_living(session, {"turn_ends_at": None})
        case Offered(session=session):
            return update_living(session, {"offered_at": now}, state=WAITING, offered_at=None)
        case WithdrawOffer(session):
            return update_living(session, {"offered_at": None}, state=WAITING)
        case MarkLost(session, lost_at):
            return update_living(session, {"lost_at": _at(lost_at)}, state=WAITING, lost_at=None)


def _set_state(change: SetState, session: ActiveSession, now: datetime.datetime) -> bool:
    if session.state == "waiting" and not _terms_fixed(change.session, now):
        return False
    changes: dict[str, Any] = {"state": change.state, "lost_at": _at(change.lost_at)}
    if session.granted_at is None:  # the process that granted it died before it stored this
        changes["granted_at"] = now
    moved = update_living(change.session, changes, **_as_decided(session))
    if moved and change.state == "driving":
        update_living(change.session, {"driving_at": now}, driving_at=None)
    return moved


def _terms_fixed(session: str, now: datetime.datetime) -> bool:
    """Store the terms if the granting process died before it could; False if they refuse."""
    try:
        fix_terms(session, now)
    except NotGranted as refusal:
        end(session, Session.Outcome.CANCELLED, str(refusal), now)
        return False
    return True


def _as_decided(session: ActiveSession) -> dict[str, Any]:
    """Return the conditions under which a decision about a session is still right. A connection
    that came back and was lost again since has a grace period of its own.
    """
    conditions: dict[str, Any] = {"state": session.state}
    if session.lost_at is not None and session.state == "reconnecting":
        conditions["lost_at__lte"] = _at(session.lost_at + 0.001)
    return conditions


def _session(scene: Scene, session: str) -> ActiveSession:
    return next(found for found in scene.sessions if found.id == session)


def _at(seconds: float | None) -> datetime.datetime | None:
    return None if seconds is None else datetime.datetime.fromtimestamp(seconds, datetime.UTC)
