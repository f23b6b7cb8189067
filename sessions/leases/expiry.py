"""What time does to sessions, carried out in the database: sessions/leases/transitions.py decides,
conditional updates perform.

A visitor may come back, leave or be stopped, by another process, between the decision and the
update. So every update names the state that was decided on, and what did not happen is not
reported.
"""

import datetime
from typing import Any

from robots.models import Robot
from sessions.leases.policy import ActiveSession, Scene
from sessions.leases.store import LIVE, change_lease, end, fix_terms, load_scene, rules_of
from sessions.leases.terms import NotGranted
from sessions.leases.transitions import (
    IDLE,
    Act,
    FirstMotion,
    Free,
    Lose,
    Move,
    RobotLink,
    TurnLimited,
    TurnUnlimited,
    Withdraw,
    decide_tick,
)
from sessions.models import Session
from sessions.protocol import AskedThere, Ended, FoundThere, Offered, TurnWarning


def tick(
    robot: Robot, link: RobotLink, now: datetime.datetime, scene: Scene | None = None
) -> tuple[Act, ...]:
    """Do what is due at one robot and return what was really done; `scene` by whoever has read
    those of many at once.
    """
    scene = load_scene(robot, now) if scene is None else scene
    return tuple(
        act
        for act in decide_tick(scene, link, rules_of(robot), now.timestamp())
        if _perform(act, scene, link, robot, now)
    )


def _perform(act: Act, scene: Scene, link: RobotLink, robot: Robot, now: datetime.datetime) -> bool:
    match act:
        case Free(epoch):
            return change_lease(robot, epoch, session=None, peer="", now=now)
        case Move():
            return _move(act, _session(scene, act.session), now)
        case Ended(session=session, outcome=outcome, reason=reason):
            # while this was decided
            sign_came = reason == IDLE and link.signs.get(session, 0.0) >= now.timestamp()
            return not sign_came and end(
                session, outcome, reason, now, **_as_decided(_session(scene, session))
            )
        case TurnWarning() | AskedThere() | FoundThere():
            return True
        case _:
            changes, only_if = _changes(act, now)
            return _update(act.session, changes, **only_if)


def _changes(
    act: FirstMotion | TurnLimited | TurnUnlimited | Offered | Withdraw | Lose,
    now: datetime.datetime,
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return what an act changes in its session's row, and under which conditions."""
    waiting = {"state": Session.State.WAITING}
    match act:
        case FirstMotion():
            return {"first_motion_at": now}, {"first_motion_at__isnull": True}
        case TurnLimited():
            return {"turn_ends_at": _at(act.ends_at)}, {}
        case TurnUnlimited():
            return {"turn_ends_at": None}, {}
        case Offered():
            return {"offered_at": now}, waiting | {"offered_at__isnull": True}
        case Withdraw():
            return {"offered_at": None}, waiting
        case Lose():
            return {"lost_at": _at(act.lost_at)}, waiting | {"lost_at__isnull": True}


def _move(move: Move, session: ActiveSession, now: datetime.datetime) -> bool:
    if session.state == "waiting" and not _terms_fixed(move.session, now):
        return False
    changes: dict[str, Any] = {"state": move.state, "lost_at": _at(move.lost_at)}
    if session.granted_at is None:  # the process that granted it did not live to say so
        changes["granted_at"] = now
    moved = _update(move.session, changes, **_as_decided(session))
    if moved and move.state == "driving":
        _update(move.session, {"driving_at": now}, driving_at__isnull=True)
    return moved


def _terms_fixed(session: str, now: datetime.datetime) -> bool:
    """Fix the terms of a session whose grant nobody lived to finish; False when it has come to its
    end instead.
    """
    try:
        fix_terms(session, now)
    except NotGranted as refusal:
        end(session, Session.Outcome.CANCELLED, str(refusal), now)
        return False
    return True


def _update(session: str, changes: dict[str, Any], **only_if: Any) -> bool:
    return bool(
        Session.objects.filter(pk=session, state__in=LIVE).filter(**only_if).update(**changes)
    )


def _as_decided(session: ActiveSession) -> dict[str, Any]:
    """Return the conditions under which a decision about a session still stands: a visitor who came
    back is lost again only from then on.
    """
    conditions: dict[str, Any] = {"state": session.state}
    if session.lost_at is not None and session.state == "reconnecting":
        conditions["lost_at__lte"] = _at(session.lost_at + 0.001)
    return conditions


def _session(scene: Scene, session: str) -> ActiveSession:
    return next(found for found in scene.sessions if found.id == session)


def _at(seconds: float | None) -> datetime.datetime | None:
    return None if seconds is None else datetime.datetime.fromtimestamp(seconds, datetime.UTC)
