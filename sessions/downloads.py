"""Downloads of sessions' states, written while they are sent: one chunk is in memory at a time."""

import json
from collections import Counter
from collections.abc import AsyncIterator
from typing import Any

from django.db.models import QuerySet
from django.http import StreamingHttpResponse

from robots.files.csv_text import csv_text
from sessions.models import Session, SessionEvent, StateChunk

# The cells that are fields of robots.api.messages.State: where its JSON has the value, and the
# default, which agents leave out.
FIELDS: dict[str, tuple[tuple[str, ...], Any]] = {
    "x": (("pose", "x"), None),
    "y": (("pose", "y"), None),
    "theta": (("pose", "theta"), None),
    "localized": (("pose", "localized"), True),
    "score": (("pose", "score"), 1.0),
    "linear": (("velocity", "linear"), None),
    "angular": (("velocity", "angular"), None),
    "charge": (("battery", "charge"), None),
    "charging": (("battery", "charging"), False),
    "docked": (("docked",), False),
    "tilt": (("tilt",), None),
    "mode": (("mode",), "manual"),
    "assist": (("assist",), "off"),
    "estop": (("safety", "estop"), False),
    "collision": (("safety", "collision"), False),
    "inhibited": (("safety", "inhibited"), None),
    "clearance": (("clearance",), None),
    "contacts": (("contacts",), 0),
    "distance": (("distance",), 0.0),
    "visitor_silence": (("visitorSilence",), None),
}
COLUMNS = (
    *("session", "robot", "visitor", "boot", "seq", "stamp", "clock_offset"),
    *FIELDS,
    *("commands", "method", "way", "command_age"),
)


def as_csv(sessions: QuerySet[Session], name: str) -> StreamingHttpResponse:
    """Return a download with one line a state."""
    return _download(_csv_lines(sessions), f"{name}.csv", "text/csv; charset=utf-8")


def as_json(sessions: QuerySet[Session], name: str) -> StreamingHttpResponse:
    """Return a download with one JSON document: sessions, each with its states and events."""
    return _download(_json_parts(sessions), f"{name}.json", "application/json")


def _download(parts: AsyncIterator[str], file: str, kind: str) -> StreamingHttpResponse:
    headers = {
        "Content-Disposition": f'attachment; filename="{file}"',
        "Cache-Control": "private, no-store",
    }
    return StreamingHttpResponse(parts, content_type=kind, headers=headers)


def _each(sessions: QuerySet[Session]) -> AsyncIterator[Session]:
    return sessions.select_related("robot").order_by("queued_at").aiterator(chunk_size=100)


def _chunks(session: Session) -> AsyncIterator[StateChunk]:
    rows = StateChunk.objects.filter(session=session).order_by("first_stamp")
    return rows.aiterator(chunk_size=100)


def _events(session: Session) -> AsyncIterator[dict[str, Any]]:
    rows = SessionEvent.objects.filter(session=session).order_by("received_at")
    columns = ("source", "type", "stamp", "received_at", "data")
    return rows.values(*columns).aiterator(chunk_size=500)


async def _csv_lines(sessions: QuerySet[Session]) -> AsyncIterator[str]:
    yield csv_text([COLUMNS])
    async for session in _each(sessions):
        async for chunk in _chunks(session):
            yield csv_text(_row(session, chunk, state) for state in chunk.states)


async def _json_parts(sessions: QuerySet[Session]) -> AsyncIterator[str]:
    comma = "["
    async for session in _each(sessions):
        yield f'{comma}{json.dumps(_about(session))[:-1]}, "chunks": '
        inner = "["
        async for chunk in _chunks(session):
            names = ("boot", "received_at", "clock_offset", "states")
            yield inner + json.dumps({name: getattr(chunk, name) for name in names})
            inner = ",\n"
        events = json.dumps([event async for event in _events(session)])
        yield ("[]" if inner == "[" else "]") + f', "events": {events}' + "}"
        comma = ",\n"
    yield "[]\n" if comma == "[" else "]\n"


def _about(session: Session) -> dict[str, Any]:
    return {
        "session": str(session.pk),
        "robot": session.robot.name,
        "visitor": str(session.visitor_id),
        "state": session.state,
        "outcome": session.outcome,
        "reason": session.outcome_reason,
        "queued_at": _iso(session.queued_at),
        "granted_at": _iso(session.granted_at),
        "driving_at": _iso(session.driving_at),
        "ended_at": _iso(session.ended_at),
        "device": session.device,
        "summary": session.summary,
    }


def _iso(at: Any) -> str | None:
    return None if at is None else at.isoformat()


def _row(session: Session, chunk: StateChunk, state: dict[str, Any]) -> list[Any]:
    about = [session.pk, session.robot.name, session.visitor_id, chunk.boot]
    applied = state.get("applied", [])
    return [
        *about,
        *(state["seq"], state["stamp"], chunk.clock_offset),
        *(_value(state, path, default) for path, default in FIELDS.values()),
        *(len(applied), _most(applied, "method"), _most(applied, "way")),
        max((command["age"] for command in applied), default=None),
    ]


def _value(state: dict[str, Any], path: tuple[str, ...], default: Any) -> Any:
    *groups, name = path
    for group in groups:
        state = state.get(group, {})
    return state.get(name, default)


def _most(applied: list[dict[str, Any]], name: str) -> str:
    return Counter(command[name] for command in applied).most_common(1)[0][0] if applied else ""
