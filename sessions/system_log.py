"""The system log: event names with fields, in the database and in the process's own log."""

import datetime
import logging
from typing import Any
from uuid import UUID

import structlog
from django.utils import timezone

from robots.models import Robot
from sessions.models import Session, SystemLog

logger = structlog.stdlib.get_logger("telepresence.system")
_LEVELS = {
    SystemLog.Severity.INFO: logging.INFO,
    SystemLog.Severity.WARNING: logging.WARNING,
    SystemLog.Severity.ERROR: logging.ERROR,
}


def log(event: str, level: str = "info", **about: Any) -> SystemLog:
    """Log and store an event; the arguments are those of `entry`.

    Raises:
        DatabaseError: it was only written to the process's log.
    """
    row = entry(event, level, **about)
    row.save(force_insert=True)
    return row


def entry(
    event: str,
    level: str = "info",
    *,
    robot: Robot | UUID | str | None = None,
    session: Session | UUID | str | None = None,
    at: datetime.datetime | None = None,
    **fields: Any,
) -> SystemLog:
    """Write an event to the process's log, and return its row, which is not stored yet.

    Args:
        event: a name in snake_case, at most 60 characters.
        level: `info`, `warning` or `error`.
        robot: what it is about, as a row or its key.
        session: likewise.
        at: when, now by default.
        fields: whatever JSON can hold.
    """
    robot_id, session_id = _key(robot), _key(session)
    named = {
        name: value
        for name, value in {"robot": robot_id, "session": session_id, **fields}.items()
        if value is not None
    }
    logger.log(_LEVELS[SystemLog.Severity(level)], event, **named)
    return SystemLog(
        at=at or timezone.now(),
        level=level,
        event=event[:60],
        robot_id=robot_id,
        session_id=session_id,
        fields=fields,
    )


def _key(row: Robot | Session | UUID | str | None) -> UUID | str | None:
    return row.pk if isinstance(row, Robot | Session) else row
