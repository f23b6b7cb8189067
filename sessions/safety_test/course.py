"""The course of a safety test. Its session has the robot, so that no visitor gets it; the session
manager orders the test under that session's lease, which names the action's id as its driver, so
that no page can drive. What the agent measured becomes an entry of the log of interventions. If the
robot is lost, the session ends as any other does, and with it the test.
"""

import datetime
import secrets
import uuid
from typing import Any

from django.conf import settings
from django.utils import timezone

from accounts import audit, interventions
from accounts.models import AuditEntry, User
from robots.api.messages import ENDED, ActionStatus, SafetyTest
from robots.api.reasons import ReasonCode, parts_of
from robots.cards import was_stopped
from robots.models import Robot
from sessions.leases import store, terms
from sessions.leases.store import TakeGranted, load_scene
from sessions.leases.terms import Provider, Terms
from sessions.models import Lease, Session
from sessions.protocol import Queued
from sessions.safety_test.rules import UNDOCK, TestConditions, WhyNot, why_not

LABEL = PEER = interventions.SAFETY_TEST
SPEED = 0.15  # m/s, unless the robot's own limit is lower
LONGEST = 120.0  # s, after which the session ends in any case
GRACE = 5.0  # s without the test's heartbeats, after which it is over
_NAMESPACE = uuid.UUID("0a5f8e1c-6f57-4f39-9a75-0c1f5b6f2f53")
# Reasons of a test that a safety function did not pass; all others kept it from its end.
FAILURES = {
    ReasonCode.DID_NOT_STOP,
    ReasonCode.TOO_LATE,
    ReasonCode.NOT_HELD,
    ReasonCode.NOT_RELEASED,
    ReasonCode.TOO_FAST,
}


class SafetyTestTerms(Provider):
    """The terms of the session of a test, which is known by the driver that its lease names."""

    def granted(self, session: Session, now: datetime.datetime) -> Terms | None:
        """Return them for such a session; None for all others."""
        if not Lease.objects.filter(session=session, peer__startswith=PEER).exists():
            return None
        return Terms(
            label=LABEL,
            linear=SPEED,
            assist="slow",
            actions=(UNDOCK,),
            controllers=("script",),
            control_way="mqtt",
            turn_seconds=LONGEST,
            turn_always=True,
            grace_seconds=GRACE,
            leaving_completes=False,
        )


SAFETY_TEST_TERMS = SafetyTestTerms()


def reason_against(robot: Robot, now: datetime.datetime) -> WhyNot:
    """Return why this robot cannot be tested now, "" when it can."""
    presence = robot.presence
    conditions = TestConditions(
        tuple((presence.factsheet or {}).get("capabilities", ())),
        presence.report or {},
        is_returning=robot.can_go_home and presence.turnaround != Robot.Turnaround.READY,
        was_stopped=was_stopped(robot),
    )
    return why_not(load_scene(robot, now), conditions, now.timestamp())


def start(robot: Robot, user: User, now: datetime.datetime) -> str:
    """Give the robot to a test; return why not, "" when it begins."""
    if reason := reason_against(robot, now):
        return reason
    taken = store.take(robot, user, f"{PEER}-{secrets.token_hex(8)}", now=now)
    match taken:
        case TakeGranted(session=session):
            store.update_living(session, {"seen_at": None})  # no page drives it
            return ""
        case Queued(session=session):  # another visitor was quicker
            store.end(session, Session.Outcome.CANCELLED, store.LEFT_QUEUE, now)
            return "driven"
    return str(taken.reason)


def running(robot: Robot) -> Session | None:
    """Return the session of the test that has this robot now."""
    living = Session.objects.filter(robot=robot, state__in=store.LIVE, leases__isnull=False)
    return next((session for session in living if is_test(session)), None)


def stop(session: Session, now: datetime.datetime) -> None:
    """End a test: its lease is withdrawn, and the robot brakes."""
    store.end(str(session.pk), Session.Outcome.STOPPED_BY_OPERATOR, "by an operator", now)


def is_test(session: Session) -> bool:
    """Tell whether a session is that of a test."""
    return terms.of(session).label == LABEL


def order_of(lease: Lease, now: datetime.datetime) -> SafetyTest | None:
    """Return the order that goes with a published lease: that of its test until it has begun. The
    agent takes copies of one order for one.
    """
    session = lease.session
    if session is None or session.state != Session.State.CONNECTING or not is_test(session):
        return None
    robot, visitor = lease.robot, session.visitor
    return SafetyTest(
        action_id=lease.peer,
        stamp=now.timestamp(),
        role="owner" if robot.owner_id == visitor.pk else "staff",
        user=visitor.sent_name,
    )


def results_of(robot: str) -> list[AuditEntry]:
    """Return the entries of a robot's tests, the newest first."""
    rows = AuditEntry.objects.filter(act=interventions.SAFETY_TEST, robot=robot)
    return list(rows.order_by("-at"))


# --- receivers of the session manager's signals ---------------------------------------------------


def take_result(robot: str, session: str, message: object, **_more: Any) -> None:
    """Store what the agent measured, and end the session."""
    if not isinstance(message, ActionStatus) or message.type != interventions.SAFETY_TEST:
        return
    row = Session.objects.select_related("robot__presence").filter(pk=session).first()
    if row is None or row.robot.name != robot or message.status not in ENDED or not is_test(row):
        return
    outcome = _outcome_of(message)
    _add_entry(row, outcome, message.reason, dict(message.result))
    is_over = outcome in {"passed", "failed"}
    ended = Session.Outcome.COMPLETED if is_over else Session.Outcome.CANCELLED
    store.end(str(row.pk), ended, message.reason, timezone.now())


def _outcome_of(status: ActionStatus) -> str:
    if status.status == "FINISHED":
        return "passed"
    if parts_of(status.reason)[0] in FAILURES:
        return "failed"
    return "broken_off" if status.result else "not_run"


def take_end(session: Session, **_more: Any) -> None:
    """Note a test that ended without a result: the robot was lost, or a person ended it."""
    if is_test(session):
        _add_entry(session, "broken_off", session.outcome_reason, {})


def _add_entry(session: Session, outcome: str, reason: str, figures: dict[str, Any]) -> None:
    """Add the entry of a test, of several calls the first."""
    robot = session.robot
    sheet = robot.presence.factsheet or {}
    versions = {"site": settings.VERSION} | {
        name: sheet.get(key, "")
        for name, key in (("agent", "agentVersion"), ("adapter", "adapter"), ("driver", "driver"))
    }
    data = {"outcome": outcome, "reason": reason, "figures": figures, "versions": versions}
    row = audit.entry(
        interventions.SAFETY_TEST,
        pk=uuid.uuid5(_NAMESPACE, str(session.pk)),
        actor=session.visitor_id,
        robot=robot,
        role="owner" if robot.owner_id == session.visitor_id else "staff",
        thing=session,
        data=data,
    )
    interventions.store([row])
