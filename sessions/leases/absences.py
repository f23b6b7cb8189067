"""Absences of the server from a session: stored as events of the session, and read back.

- A web process stores every few seconds that a page is open, and when the page's socket closes. A
  process that is killed does neither: the page was last seen long ago, and never closed. The
  session manager then stores `server_absent`, and `server_back` when a page of the session is seen
  again.
- A new session manager reads when the previous one was last alive, and stores `server_absent` with
  both ends in the sessions that lived then.
"""

import contextlib
import datetime
import uuid
from collections import defaultdict
from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import Any

import msgspec
from django.db.models import Q

from sessions.leases.fault_side import (
    MANAGER,
    WEB,
    FaultAttribution,
    ServerAbsence,
    SessionEnd,
    fault_of,
)
from sessions.leases.policy import ActiveSession
from sessions.models import HOLDING_STATES, Session, SessionEvent, StateChunk

ABSENT, BACK, PAGE_CLOSED = "server_absent", "server_back", "page_closed"
EVENT_KEYS = uuid.UUID("5b0ce3cf-2d6c-4d6c-9f5a-0c4a3f5f8f39")


class WebAbsences:
    """The absences of web processes that the session manager remembers between two ticks. The
    first time that a session is passed, those that a previous session manager stored are read.
    """

    def __init__(self) -> None:
        self._since: dict[str, float | None] = {}

    def tick(self, driver: ActiveSession | None, now: datetime.datetime) -> None:
        """Store that the web process of a driver's page is away, or that the page is back."""
        if driver is None or driver.granted_at is None:
            return
        if driver.id not in self._since:
            if len(self._since) > 1000:
                self._since.clear()
            self._since[driver.id] = _absent_since(driver.id)
        since = self._since[driver.id]
        seen, is_open = driver.seen_at, driver.page_open(now.timestamp())
        if since is None and seen is not None and not is_open:
            _note(driver.id, ABSENT, now, part=WEB, since=seen)
            self._since[driver.id] = seen
        elif since is not None and seen is not None and is_open:
            _note(driver.id, BACK, now, part=WEB, since=since, until=seen)
            self._since[driver.id] = None


def note_manager_absence(since: datetime.datetime, until: datetime.datetime) -> None:
    """Store in every session that was driven then that no session manager ran."""
    lived = Q(state__in=HOLDING_STATES) | Q(state=Session.State.ENDED, ended_at__gte=since)
    ends = {"since": since.timestamp(), "until": until.timestamp()}
    for key in Session.objects.filter(lived, granted_at__lt=until).values_list("pk", flat=True):
        _note(str(key), ABSENT, until, part=MANAGER, **ends)


def note_page_closed(session: str, code: int, now: datetime.datetime) -> None:
    """Store that the socket of a driver's page has closed with this code."""
    _note(session, PAGE_CLOSED, now, code=code)


def faults_of(sessions: Iterable[Session]) -> dict[uuid.UUID, FaultAttribution]:
    """Return whose fault the end of each session was, by its key."""
    rows = list(sessions)
    stored: dict[uuid.UUID, list[tuple[str, dict[str, Any]]]] = defaultdict(list)
    events = SessionEvent.objects.filter(
        session__in=[row.pk for row in rows],
        source=SessionEvent.Source.SERVER,
        type__in=(ABSENT, BACK, PAGE_CLOSED),
    )
    for key, kind, data in events.order_by("received_at", "stamp").values_list(
        "session_id", "type", "data"
    ):
        stored[key].append((kind, data))
    return {row.pk: fault_of(_end(row, stored[row.pk])) for row in rows}


def end_of(session: Session) -> datetime.datetime | None:
    """Return when a session was over for the visitor, without the time that the server waited for
    a lost connection or a silent robot; None while it lives.
    """
    if session.ended_at is None:
        return None
    if session.outcome == Session.Outcome.CONNECTION_LOST and session.lost_at is not None:
        return min(session.lost_at, session.ended_at)
    if (session.outcome, session.outcome_reason) in {
        (Session.Outcome.ROBOT_FAULT, "robot_offline"),
        (Session.Outcome.CONNECTION_LOST, "lease_gone"),
    }:
        chunks = StateChunk.objects.filter(session=session).order_by("-received_at")
        last = chunks.values_list("received_at", flat=True).first()
        if last is not None:
            return min(datetime.datetime.fromtimestamp(last, datetime.UTC), session.ended_at)
    return session.ended_at


def _end(row: Session, stored: list[tuple[str, dict[str, Any]]]) -> SessionEnd:
    begun = row.granted_at or row.queued_at
    ended = row.ended_at or begun
    codes = [
        data["code"]
        for kind, data in stored
        if kind == PAGE_CLOSED and isinstance(data.get("code"), int)
    ]
    return SessionEnd(
        outcome=row.outcome,
        reason=row.outcome_reason,
        begun_at=begun.timestamp(),
        ended_at=ended.timestamp(),
        lost_at=row.lost_at.timestamp() if row.lost_at is not None else None,
        close_code=codes[-1] if codes and row.seen_at is None else None,
        absences=tuple(_absences(stored)),
    )


def _absences(stored: list[tuple[str, dict[str, Any]]]) -> Iterator[ServerAbsence]:
    """Read the stored absences; malformed ones are left out."""
    read: dict[str, list[ServerAbsence]] = {ABSENT: [], BACK: []}
    for kind, data in stored:
        if kind in read:
            with contextlib.suppress(msgspec.ValidationError):
                read[kind].append(msgspec.convert(data, ServerAbsence))
    for absence in read[ABSENT]:
        ends = (one.until for one in read[BACK] if abs(one.since - absence.since) < 1.0)
        yield replace(absence, until=absence.until or next(ends, None))


def _absent_since(session: str) -> float | None:
    """Return since when the web process is away by the last stored event; None when it is not."""
    events = SessionEvent.server_events(session, ABSENT, BACK).order_by("-stamp")
    for kind, data in events.values_list("type", "data"):
        if data.get("part") == WEB:
            return data["since"] if kind == ABSENT else None
    return None


def _note(session: str, kind: str, now: datetime.datetime, **data: Any) -> None:
    """Store an event once, however often it is tried."""
    once = data.get("since", now.timestamp())
    key = uuid.uuid5(EVENT_KEYS, f"{session} {kind} {data.get('part')} {once}")
    SessionEvent.objects.get_or_create(
        pk=key,
        defaults={
            "session_id": session,
            "source": SessionEvent.Source.SERVER,
            "type": kind,
            "stamp": now.timestamp(),
            "received_at": now.timestamp(),
            "data": data,
        },
    )
