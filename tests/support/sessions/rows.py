"""Rows of sessions and their states."""

import datetime
from typing import Any

from django.utils import timezone

from accounts.models import User
from robots.models import Robot
from sessions.models import Session, StateChunk

NOW = timezone.now()


def after(seconds: float) -> datetime.datetime:
    """Return the moment so long after NOW."""
    return NOW + datetime.timedelta(seconds=seconds)


def session_row(robot: Robot, visitor: User, **fields: Any) -> Session:
    """Store a session that was queued now."""
    live = {"live_key": f"{robot.pk}:{visitor.pk}", "queued_at": timezone.now()}
    return Session.objects.create(robot=robot, visitor=visitor, **live | fields)


def chunk_row(session: Session, states: list[dict[str, Any]], **fields: Any) -> StateChunk:
    """Store states as on the wire, with their own boot, numbers and stamps."""
    row = unsaved_chunk(session, states, **fields)
    row.save()
    return row


def unsaved_chunk(session: Session, states: list[dict[str, Any]], **fields: Any) -> StateChunk:
    first, last = states[0], states[-1]
    return StateChunk(
        session=session,
        states=states,
        boot=first["boot"],
        first_seq=first["seq"],
        last_seq=last["seq"],
        count=len(states),
        first_stamp=first["stamp"],
        last_stamp=last["stamp"],
        **{"received_at": last["stamp"], "clock_offset": 0.0} | fields,
    )
