"""Interventions of a researcher in a drive: a message, its end, a pause of the robot's queue.

Each is recorded with its time and user: as an event of the session whose type begins with
`operator`, which the table of data quality counts, and in the system log.
"""

import datetime
from typing import Any

from accounts import audit
from robots.models import Robot
from sessions import protocol, system_log
from sessions.leases import store
from sessions.models import Session, SessionEvent
from sessions.page_channel import check_pages, robot_group, send_notice

LONGEST = 200


def send_message(session: Session, text: str, user: Any, now: datetime.datetime) -> bool:
    """Send a sentence to the visitor's page and record it; False if it could not be sent."""
    message = protocol.OperatorMessage(session=str(session.pk), text=text[:LONGEST])
    if not send_notice(session.robot.name, message):
        return False
    _note(message.session, protocol.NOTICE_NAMES[type(message)], user, now, text=message.text)
    audit.note("session_message", actor=user, thing=message.session, at=now)
    return True


def end_session(session: Session, reason: str, user: Any, now: datetime.datetime) -> bool:
    """End a session as stopped by the operator; False if it had ended already."""
    ended = store.end(str(session.pk), Session.Outcome.STOPPED_BY_OPERATOR, reason[:LONGEST], now)
    if ended:
        check_pages(robot_group(session.robot.name), session=str(session.pk))
        _note(str(session.pk), "operator_end", user, now, reason=reason[:LONGEST])
        person, robot = session.visitor_id, session.robot
        audit.note("session_stopped", actor=user, person=person, robot=robot, thing=session, at=now)
    return ended


def hold(robot: Robot, reason: str, user: Any, now: datetime.datetime) -> None:
    """Pause the queue of a robot; its driver goes on, and those who wait keep their places."""
    reason = reason[:LONGEST]
    Robot.objects.filter(pk=robot.pk).update(held=reason)
    system_log.log("queue_held", "warning", robot=robot, at=now, reason=reason, user=str(user.pk))
    audit.note("queue_held", actor=user, robot=robot, at=now)


def release(robot: Robot, user: Any, now: datetime.datetime) -> bool:
    """Resume the queue; False if it was not paused."""
    released = bool(Robot.objects.filter(pk=robot.pk).exclude(held="").update(held=""))
    if released:
        system_log.log("queue_released", robot=robot, at=now, user=str(user.pk))
        audit.note("queue_released", actor=user, robot=robot, at=now)
    return released


def _note(session: str, kind: str, user: Any, now: datetime.datetime, **data: str) -> None:
    data["user"] = str(user.pk)
    times = dict.fromkeys(("stamp", "received_at"), now.timestamp())
    server = SessionEvent.Source.SERVER
    SessionEvent.objects.create(session_id=session, source=server, type=kind, data=data, **times)
    system_log.log(kind, "warning", session=session, at=now, **data)
