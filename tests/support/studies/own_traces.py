"""Everything that belongs to one participant, and where any of it turns up: in rows, in bytes of
files, in lines of a log.
"""

import datetime
import json
import re
import struct
import uuid
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

from django.apps import apps
from django.contrib.sessions.models import Session as BrowserSession
from django.db.models import Model, QuerySet

from experiments.models import (
    ConsentReceipt,
    Drive,
    Participant,
    PersonalLink,
    StepResponse,
    StepVisit,
    TaskEvent,
)
from sessions.models import NetworkSample, Session, SessionEvent, Snapshot, StateChunk, SystemLog
from surveys.models import Answer, Response

MARK = re.compile(r"zq[0-9a-z]{6,}", re.IGNORECASE)  # words that tests made up begin so
HASH = re.compile(r"\b[0-9a-f]{64}\b")
KEY = re.compile(r"[0-9a-f]{8}-?(?:[0-9a-f]{4}-?){3}[0-9a-f]{12}", re.IGNORECASE)
LARGE = 10**6  # a smaller number may be any count
NOW = range(10**9, 3 * 10**9)  # Unix times in seconds
# References from rows of a participant to rows that are shared with others.
SHARED = {"study_id", "robot_id", "questionnaire_id", "excluded_by_id"}
WHOLE = {"code", "username", "email", "live_key", "slot", "label", "guardian"}


def rows_of(participant: Participant) -> list[QuerySet[Any]]:
    """Return every row that belongs to a participant."""
    responses = Response.objects.filter(asked_at__participant=participant)
    sessions = Session.objects.filter(drive__participant=participant)
    inside: list[type[Model]] = [StateChunk, SessionEvent, NetworkSample, Snapshot, SystemLog]
    own: list[type[Model]] = [ConsentReceipt, StepVisit, StepResponse, Drive, PersonalLink]
    return [
        Participant.objects.filter(pk=participant.pk),
        *(model._default_manager.filter(participant=participant) for model in own),
        responses,
        Answer.objects.filter(response__in=responses),
        sessions,
        *(model._default_manager.filter(session__in=sessions) for model in inside),
        TaskEvent.objects.filter(drive__participant=participant),
    ]


def spread_out(rows: Iterable[QuerySet[Any]], begin: datetime.datetime) -> None:
    """Give every time in these rows a second that nothing else has, from `begin` on."""
    second = 0
    for found in rows:
        names = [
            field.attname
            for field in found.model._meta.concrete_fields
            if field.get_internal_type() == "DateTimeField"
        ]
        for row in list(found):
            for name in names:
                if getattr(row, name) is not None:
                    second += 977
                    at = begin + datetime.timedelta(seconds=second, microseconds=second % 999_983)
                    found.model._base_manager.filter(pk=row.pk).update(**{name: at})


def values_of(
    rows: Iterable[QuerySet[Any]], *, but: Iterable[QuerySet[Any]] = ()
) -> dict[str, set[bytes]]:
    """Return by name how each value of these rows is spelled, as text and in files of SQLite,
    without those of the rows of others.
    """
    others = set().union(*values_of(but).values()) if but else set()
    found: dict[str, set[bytes]] = {}
    for some in rows:
        for row in some.values():
            for name, value in row.items():
                if name not in SHARED:
                    words = set(_spelled(name, value)) - others
                    found.setdefault(f"{some.model.__name__}.{name}", set()).update(words)
    return {name: words for name, words in found.items() if words}


def _spelled(name: str, value: Any) -> Iterator[bytes]:
    match value:
        case uuid.UUID():
            yield from (str(value).encode(), value.hex.encode(), value.bytes)
        case datetime.datetime():
            yield from (
                f"{value:%Y-%m-%d %H:%M:%S}".encode(),
                f"{value:%Y-%m-%dT%H:%M:%S}".encode(),
            )
            yield str(int(value.timestamp())).encode()
        case bool() | None:
            pass
        case float() if int(value) in NOW:
            yield from (str(int(value)).encode(), struct.pack(">d", value))
        case int() if value > LARGE:
            yield str(value).encode()
        case str():
            yield from _words(name, value)
        case bytes() | memoryview():
            yield from (word.encode() for word in MARK.findall(bytes(value).decode("latin-1")))
        case Mapping() | list() | tuple():
            yield from _words("", json.dumps(value))


def _words(name: str, text: str) -> Iterator[bytes]:
    if name in WHOLE and text:
        yield text.lower().encode()
    for word in KEY.findall(text):
        yield from _spelled("", uuid.UUID(word))
    yield from (word.lower().encode() for word in (*MARK.findall(text), *HASH.findall(text)))


def in_bytes(content: bytes, values: Mapping[str, set[bytes]]) -> set[str]:
    """Return the names of the values that are in it."""
    lower = content.lower()
    return {
        f"{name}: {word!r}"
        for name, words in values.items()
        for word in words
        if word in content or word in lower
    }


def in_tables(values: Mapping[str, set[bytes]]) -> set[str]:
    """Return the columns of all tables that hold one of them."""
    found: set[str] = set()
    for model in apps.get_models():
        for row in model._base_manager.values():
            if model is BrowserSession:
                row["session_data"] = BrowserSession(**row).get_decoded()
            for name, value in row.items():
                kept = bytes(value) if isinstance(value, memoryview) else str(value).encode()
                found |= {f"{model.__name__}.{name} = {what}" for what in in_bytes(kept, values)}
    return found


def in_files(folder: Path, values: Mapping[str, set[bytes]]) -> set[str]:
    """Return the files below a folder that hold one of them, or are called so."""
    return {
        f"{path.relative_to(folder)} = {what}"
        for path in folder.rglob("*")
        if path.is_file()
        for what in in_bytes(str(path).encode() + b"\n" + path.read_bytes(), values)
    }
