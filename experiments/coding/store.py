"""Stored codings: schemes by version, and each coder's events, every change of which is a row.

A page sends changes with ids of its own, so that a change that is sent twice is stored once. A
change always becomes the newest version of its event: if two tabs change one event, the later
change is valid, the other one remains stored, and the answer names the event.
"""

import contextlib
import datetime
import uuid
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Annotated, Any

import msgspec
from django.db import IntegrityError, transaction
from django.db.models import Max
from django.utils.translation import gettext as _
from msgspec import Meta

from experiments.coding.scheme import (
    MAX_COMMENT,
    MAX_EVENTS,
    MAX_SECONDS,
    BadCodingError,
    CodedEvent,
    event_problems,
    events_from,
    scheme_from,
)
from experiments.definition.coding import CodingScheme
from experiments.models import Coding, CodingEdit, CodingSchemeVersion, Drive, Participant, Study

MAX_EDITS, MAX_EDITS_AT_ONCE = 50_000, 500
ATTEMPTS = 5  # to store a version while another tab stores some

Seconds = Annotated[float, Meta(ge=0.0, le=MAX_SECONDS)]


class EventEdit(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The event after a change. `base` is the version that was changed, 0 for a new event."""

    id: uuid.UUID
    event: uuid.UUID
    base: Annotated[int, Meta(ge=0, le=MAX_EDITS)]
    code: str
    begin: Seconds
    end: Seconds | None = None
    modifiers: dict[str, str] = {}
    comment: Annotated[str, Meta(max_length=MAX_COMMENT)] = ""
    is_deleted: bool = False


class EventEdits(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    edits: Annotated[tuple[EventEdit, ...], Meta(max_length=MAX_EDITS_AT_ONCE)]


@dataclass(frozen=True)
class Saved:
    """Events that another tab has changed, and the changes that cannot be stored, with reasons."""

    conflicts: tuple[str, ...]
    refused: dict[str, str]


def scheme_of(study: Study, now: datetime.datetime) -> CodingSchemeVersion | None:
    """Return the newest scheme of a study; that of its definition is stored at its first use."""
    newest = _newest(study)
    if newest is None and (declared := study.as_definition().coding) is not None:
        return store_scheme(study, declared, now)
    return newest


def store_scheme(study: Study, scheme: CodingScheme, now: datetime.datetime) -> CodingSchemeVersion:
    """Make a scheme the newest of a study, unless it is that already."""
    newest = _newest(study)
    if newest is not None and read_scheme(newest) == scheme:
        return newest
    fields = {"document": msgspec.to_builtins(scheme), "created_at": now}
    version = newest.version + 1 if newest else 1
    rows = CodingSchemeVersion.objects
    row: CodingSchemeVersion
    row, _new = rows.get_or_create(study=study, version=version, defaults=fields)
    return row


def _newest(study: Study) -> CodingSchemeVersion | None:
    rows = CodingSchemeVersion.objects.filter(study=study)
    found: CodingSchemeVersion | None = rows.order_by("-version").first()
    return found


def read_scheme(row: CodingSchemeVersion) -> CodingScheme:
    return scheme_from(row.document)


def coding_of(session: uuid.UUID, scheme: CodingSchemeVersion, user: Any) -> Coding | None:
    found: Coding | None
    found = Coding.objects.filter(session=session, scheme=scheme, coder=user).first()
    return found


def begin(drive: Drive, scheme: CodingSchemeVersion, user: Any, now: datetime.datetime) -> Coding:
    """Return a user's coding of a drive's session, begun now where there is none."""
    slug, session = drive.participant.study.slug, drive.session_id
    for _attempt in range(ATTEMPTS + 1):
        if found := coding_of(session, scheme, user):
            return found
        # refused when another tab has begun it, or another coder took the number
        with contextlib.suppress(IntegrityError), transaction.atomic():
            list(Study.objects.select_for_update().filter(slug=slug).values_list("pk"))
            rows = Coding.objects.filter(scheme__study__slug=slug)
            # a coder has one number in a study
            own = rows.filter(coder=user).values_list("number", flat=True).first()
            number = own or (rows.aggregate(most=Max("number"))["most"] or 0) + 1
            fields = {"scheme": scheme, "coder": user, "number": number, "began_at": now}
            Coding.objects.create(session_id=session, **fields)
    raise BadCodingError([_("The coding could not be started. Try again.")])


def current(coding: Coding) -> list[CodingEdit]:
    """Return the newest version of each event that is not deleted, in order of time."""
    newest = {edit.event: edit for edit in coding.edits.order_by("version")}
    kept = (edit for edit in newest.values() if not edit.is_deleted)
    return sorted(kept, key=lambda edit: (edit.begin, edit.code, str(edit.event)))


def events_of(coding: Coding) -> list[CodedEvent]:
    edits = current(coding)
    return [CodedEvent(one.code, one.begin, one.end, one.comment, one.modifiers) for one in edits]


def save(coding: Coding, edits: Sequence[EventEdit], now: datetime.datetime) -> Saved:
    """Store changes in order, unless the coding is done or has too many."""
    refuse_if_done(coding)
    if coding.edits.count() + len(edits) > MAX_EDITS:
        text = _("Not saved: a coding can have at most %(n)d changes.") % {"n": MAX_EDITS}
        raise BadCodingError([text])
    scheme = read_scheme(coding.scheme)
    conflicts: list[str] = []
    refused: dict[str, str] = {}
    room = MAX_EVENTS - len(current(coding))
    for edit in edits:
        code = scheme.code(edit.code)
        problem = next(event_problems(edit, code, code.name if code else edit.code), "")
        if not problem and edit.base == 0 and room <= 0:
            problem = _("A coding has at most %(n)d events.") % {"n": MAX_EVENTS}
        room -= edit.base == 0
        if problem:
            refused[str(edit.id)] = problem
        elif _store(coding, edit, now):
            conflicts.append(str(edit.event))
    return Saved(tuple(dict.fromkeys(conflicts)), refused)


def refuse_if_done(coding: Coding) -> None:
    if coding.done_at is not None:
        raise BadCodingError([_("This coding is marked as done. Reopen it to change it.")])


def _store(coding: Coding, edit: EventEdit, now: datetime.datetime) -> bool:
    """Store a change once; return whether another tab changed the event since `edit.base`."""
    for _attempt in range(ATTEMPTS):
        if CodingEdit.objects.filter(pk=edit.id).exists():
            return False
        versions = CodingEdit.objects.filter(coding=coding, event=edit.event)
        newest: int = versions.aggregate(most=Max("version"))["most"] or 0
        about = {"pk": edit.id, "event": edit.event, "is_deleted": edit.is_deleted}
        row = _row(coding, edit, now, **about, version=newest + 1)
        try:
            with transaction.atomic():
                row.save(force_insert=True)
        except IntegrityError:  # another tab stores this event, or this very change
            continue
        return newest != edit.base
    raise BadCodingError([_("The changes could not be saved. Try again.")])


def _row(coding: Coding, noted: Any, now: datetime.datetime, **more: Any) -> CodingEdit:
    """Return a row that is not stored yet, of anything with the fields of CodedEvent."""
    begin, end = round(noted.begin, 3), None if noted.end is None else round(noted.end, 3)
    fields = {name: getattr(noted, name) for name in ("code", "modifiers", "comment")}
    return CodingEdit(coding=coding, begin=begin, end=end, at=now, **fields, **more)


def replace_events(coding: Coding, events: Iterable[CodedEvent], now: datetime.datetime) -> int:
    """Replace the events of a coding by imported, checked ones; return their number."""
    refuse_if_done(coding)
    deletions = [
        _row(coding, edit, now, event=edit.event, version=edit.version + 1, is_deleted=True)
        for edit in current(coding)
    ]
    new = [_row(coding, one, now, event=uuid.uuid4(), version=1) for one in events]
    with transaction.atomic():
        CodingEdit.objects.bulk_create([*deletions, *new], batch_size=200)
    return len(new)


def finish(coding: Coding, duration: float, now: datetime.datetime) -> None:
    """Mark a coding as done if its events are as `checked` requires."""
    checked(coding, duration)
    Coding.objects.filter(pk=coding.pk, done_at=None).update(done_at=now)


def checked(coding: Coding, duration: float) -> list[CodedEvent]:
    """Return the events of a coding, sorted; one that is incomplete is a BadCodingError."""
    document = msgspec.to_builtins(events_of(coding))
    return events_from(document, read_scheme(coding.scheme).codes, duration)


def reopen(coding: Coding) -> None:
    """Make a coding editable that is done, unless it may have been compared with others."""
    if is_revealed(coding.session_id, coding.scheme):
        text = _(
            "All coders are done and may have compared their codings, so this one can't be"
            " reopened."
        )
        raise BadCodingError([text])
    Coding.objects.filter(pk=coding.pk).update(done_at=None)


def is_revealed(session: uuid.UUID, scheme: CodingSchemeVersion) -> bool:
    """Tell whether the codings of a session may be compared: at least two, and all of them done."""
    rows = list(Coding.objects.filter(session=session, scheme=scheme).values_list("done_at"))
    return len(rows) > 1 and all(done is not None for (done,) in rows)


def released(scheme: CodingSchemeVersion) -> list[Coding]:
    """Return the codings that may be exported: those of sessions that no coder is still coding."""
    every = Coding.objects.filter(scheme=scheme).select_related("session", "scheme")
    rows = every.exclude(session__drive__participant__status=Participant.Status.WITHDRAWN)
    found = list(rows.order_by("session__granted_at", "session", "number"))
    busy = {row.session_id for row in found if row.done_at is None}
    return [row for row in found if row.session_id not in busy]
