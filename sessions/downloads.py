"""States of sessions as files, written while they are sent: however many there are, a chunk at a
time is in memory.
"""

import json
from collections import Counter
from collections.abc import AsyncIterator
from typing import Any

from django.db.models import QuerySet
from django.http import StreamingHttpResponse

from robots.files.csv_text import csv_text
from sessions.models import Session, SessionEvent, StateChunk

COLUMNS = (
    "session",
    "robot",
    "visitor",
    "boot",
    "seq",
    "stamp",
    "clock_offset",
    "x",
    "y",
    "theta",
    "localized",
    "score",
    "linear",
    "angular",
    "charge",
    "charging",
    "docked",
    "tilt",
    "mode",
    "assist",
    "estop",
    "collision",
    "inhibited",
    "clearance",
    "contacts",
    "distance",
    "visitor_silence",
    "commands",
    "method",
    "way",
    "command_age",
)


def as_csv(sessions: QuerySet[Session], name: str) -> StreamingHttpResponse:
    """Return a download with one line a state."""
    return _download(_csv_lines(sessions), f"{name}.csv", "text/csv; charset=utf-8")


def as_json(sessions: QuerySet[Session], name: str) -> StreamingHttpResponse:
    """Return a download with one JSON document: a list of sessions, each with its events and with
    its states as the robot sent them.
    """
    return _download(_json_parts(sessions), f"{name}.json", "application/json")


def _download(parts: AsyncIterator[str], file: str, kind: str) -> StreamingHttpResponse:
    headers = {
        "Content-Disposition": f'attachment; filename="{file}"',
        "Cache-Control": "private, no-store",
    }
    return StreamingHttpResponse(parts, content_type=kind, headers=headers)


async def _chunks(session: Session) -> AsyncIterator[StateChunk]:
    async for chunk in (
        StateChunk.objects.filter(session=session).order_by("first_stamp").aiterator(chunk_size=100)
    ):
        yield chunk


async def _events(session: Session) -> AsyncIterator[dict[str, Any]]:
    columns = ("source", "type", "stamp", "received_at", "data")
    async for event in (
        SessionEvent.objects.filter(session=session)
        .order_by("received_at")
        .values(*columns)
        .aiterator(chunk_size=500)
    ):
        yield event


async def _csv_lines(sessions: QuerySet[Session]) -> AsyncIterator[str]:
    yield csv_text([COLUMNS])
    async for session in (
        sessions.select_related("robot").order_by("queued_at").aiterator(chunk_size=100)
    ):
        async for chunk in _chunks(session):
            yield csv_text(_row(session, chunk, state) for state in chunk.states)


async def _json_parts(sessions: QuerySet[Session]) -> AsyncIterator[str]:
    comma = "["
    async for session in (
        sessions.select_related("robot").order_by("queued_at").aiterator(chunk_size=100)
    ):
        yield f'{comma}{json.dumps(_about(session))[:-1]}, "chunks": '
        inner = "["
        async for chunk in _chunks(session):
            about = {
                "boot": chunk.boot,
                "received_at": chunk.received_at,
                "clock_offset": chunk.clock_offset,
                "states": chunk.states,
            }
            yield inner + json.dumps(about)
            inner = ",\n"
        yield (
            ("[]" if inner == "[" else "]")
            + f', "events": {json.dumps([event async for event in _events(session)])}'
            + "}"
        )
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
    pose, velocity, battery, safety = (
        state["pose"],
        state["velocity"],
        state["battery"],
        state.get("safety", {}),
    )
    applied = state.get("applied", [])
    return [
        session.pk,
        session.robot.name,
        session.visitor_id,
        chunk.boot,
        state["seq"],
        state["stamp"],
        chunk.clock_offset,
        pose["x"],
        pose["y"],
        pose["theta"],
        pose.get("localized", True),
        pose.get("score", 1.0),
        velocity["linear"],
        velocity["angular"],
        battery.get("charge"),
        battery.get("charging", False),
        state.get("docked", False),
        state.get("tilt"),
        state.get("mode", "manual"),
        state.get("assist", "off"),
        safety.get("estop", False),
        safety.get("collision", False),
        safety.get("inhibited"),
        state.get("clearance"),
        state.get("contacts", 0),
        state.get("distance", 0.0),
        state.get("visitorSilence"),
        len(applied),
        _most(applied, "method"),
        _most(applied, "way"),
        max((command["age"] for command in applied), default=None),
    ]


def _most(applied: list[dict[str, Any]], name: str) -> str:
    return Counter(command[name] for command in applied).most_common(1)[0][0] if applied else ""
