"""Codings as they are stored: schemes by version, and each coder's events, every change of which is
a row of its own.

A page sends changes with ids of its own, so that what is sent twice is stored once. A change always
becomes the newest version of its event, whatever version it was made from: of two tabs that change
one event the later change counts, the other one stays stored, and the answer names the event.
"""

import datetime
import uuid
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Annotated, Any

import msgspec
from django.db import IntegrityError, transaction
from django.db.models import Max, Q
from django.utils.translation import gettext as _
from msgspec import Meta

from experiments.coding.scheme import (
    MAX_COMMENT,
    MAX_EVENTS,
    MAX_SECONDS,
    BadCodingError,
    CodedEvent,
    events_from,
    has_modifiers,
    is_comment,
    scheme_from,
)
from experiments.definition.coding import Code, CodingScheme
from experiments.models import Coding, CodingEdit, CodingSchemeVersion, Drive, Participant, Study
from sessions.models import Session

MAX_EDITS, MAX_EDITS_AT_ONCE = 50_000, 500
ATTEMPTS = 5  # to store a version while another tab stores some

Seconds = Annotated[float, Meta(ge=0.0, le=MAX_SECONDS)]


class EventEdit(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A change as a page sends it: the event as it is from now on. `base` is the version that was
    changed, 0 for a new event.
    """

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
    """What a page sends at once."""

    edits: Annotated[tuple[EventEdit, ...], Meta(max_length=MAX_EDITS_AT_ONCE)]


@dataclass(frozen=True)
class Saved:
    """What became of changes: `conflicts` are events that somebody else changed meanwhile,
    `refused` the changes that cannot be stored, with the reason.
    """

    conflicts: tuple[str, ...]
    refused: dict[str, str]


# --- schemes --------------------------------------------------------------------------------------


def scheme_of(study: Study, now: datetime.datetime) -> CodingSchemeVersion | None:
    """Return the newest scheme of a study; that of its definition is stored when it is first asked
    for. None when it has none.
    """
    newest = _newest(study)
    if newest is None and (declared := study.as_definition().coding) is not None:
        return store_scheme(study, declared, now)
    return newest


def store_scheme(study: Study, scheme: CodingScheme, now: datetime.datetime) -> CodingSchemeVersion:
    """Make a scheme the newest of a study; one that is it already stays."""
    newest = _newest(study)
    if newest is not None and read_scheme(newest) == scheme:
        return newest
    fields = {"document": msgspec.to_builtins(scheme), "created_at": now}
    version = newest.version + 1 if newest else 1
    row: CodingSchemeVersion = CodingSchemeVersion.objects.get_or_create(
        study=study, version=version, defaults=fields
    )[0]
    return row


def _newest(study: Study) -> CodingSchemeVersion | None:
    rows = CodingSchemeVersion.objects.filter(study=study)
    found: CodingSchemeVersion | None = rows.order_by("-version").first()
    return found


def read_scheme(row: CodingSchemeVersion) -> CodingScheme:
    """Return the scheme that a row holds."""
    return scheme_from(row.document)


# --- codings --------------------------------------------------------------------------------------


def coding_of(session: uuid.UUID, scheme: CodingSchemeVersion, user: Any) -> Coding | None:
    """Return somebody's coding of a session."""
    rows = Coding.objects.filter(session=session, scheme=scheme, coder=user)
    found: Coding | None = rows.first()
    return found


def begin(drive: Drive, scheme: CodingSchemeVersion, user: Any, now: datetime.datetime) -> Coding:
    """Return somebody's coding of a drive's session, begun now where there is none."""
    for _attempt in range(ATTEMPTS + 1):
        if found := coding_of(drive.session_id, scheme, user):
            return found
        try:
            with transaction.atomic():
                Coding.objects.create(
                    session_id=drive.session_id,
                    scheme=scheme,
                    coder=user,
                    number=_number_of(drive.participant.study.slug, user),
                    began_at=now,
                )
        except IntegrityError:  # another tab has begun it, or another coder took the number
            continue
    raise BadCodingError([_("The coding could not be started. Try again.")])


def _number_of(slug: str, user: Any) -> int:
    """Return what a coder is called in a study: as before, else the next number."""
    list(Study.objects.select_for_update().filter(slug=slug).values_list("pk"))
    rows = Coding.objects.filter(scheme__study__slug=slug)
    own = rows.filter(coder=user).values_list("number", flat=True).first()
    return own or (rows.aggregate(most=Max("number"))["most"] or 0) + 1


def current(coding: Coding) -> list[CodingEdit]:
    """Return the newest version of each event that is not deleted, in order of time."""
    newest: dict[uuid.UUID, CodingEdit] = {}
    for edit in CodingEdit.objects.filter(coding=coding).order_by("version"):
        newest[edit.event] = edit
    kept = (edit for edit in newest.values() if not edit.is_deleted)
    return sorted(kept, key=lambda edit: (edit.begin, edit.code, str(edit.event)))


def events_of(coding: Coding) -> list[CodedEvent]:
    """Return what a coding says, in order of time."""
    return [
        CodedEvent(edit.code, edit.begin, edit.end, edit.comment, edit.modifiers)
        for edit in current(coding)
    ]


def save(coding: Coding, edits: Sequence[EventEdit], now: datetime.datetime) -> Saved:
    """Store changes, in their order.

    Raises:
        BadCodingError: the coding is done, or has too many changes.
    """
    refuse_if_done(coding)
    if coding.edits.count() + len(edits) > MAX_EDITS:
        raise BadCodingError(
            [_("Not saved: a coding can have at most %(n)d changes.") % {"n": MAX_EDITS}]
        )
    scheme = read_scheme(coding.scheme)
    conflicts: list[str] = []
    refused: dict[str, str] = {}
    room = MAX_EVENTS - len(current(coding))
    for edit in edits:
        problem = edit_problem(edit, scheme.code(edit.code))
        if not problem and edit.base == 0 and room <= 0:
            problem = _("A coding has at most %(n)d events.") % {"n": MAX_EVENTS}
        room -= edit.base == 0
        if problem:
            refused[str(edit.id)] = problem
        elif _store(coding, edit, now):
            conflicts.append(str(edit.event))
    return Saved(tuple(dict.fromkeys(conflicts)), refused)


def refuse_if_done(coding: Coding) -> None:
    """Let nothing change a coding that is done.

    Raises:
        BadCodingError: it is.
    """
    if coding.done_at is not None:
        raise BadCodingError([_("This coding is marked as done. Reopen it to change it.")])


def edit_problem(edit: EventEdit, code: Code | None) -> str:
    """Return why a change cannot be stored; "" when it can. A state may have no end yet."""
    problem = ""
    if code is None:
        problem = _("The scheme has no code “%(code)s”.")
    elif code.kind == "point" and edit.end is not None:
        problem = _("%(code)s at %(at)s s is a point, so it can't have an end.")
    elif edit.end is not None and edit.end <= edit.begin:
        problem = _("%(code)s at %(at)s s must end after it begins.")
    elif not is_comment(edit.comment):
        problem = _("%(code)s at %(at)s s: the comment is too long.")
    elif not has_modifiers(code, edit.modifiers):
        problem = _("%(code)s at %(at)s s has a modifier that the scheme does not have.")
    name = edit.code if code is None else code.name
    return problem and problem % {"code": name, "at": f"{edit.begin:.3f}"}


def _store(coding: Coding, edit: EventEdit, now: datetime.datetime) -> bool:
    """Store a change once; tell whether the event was changed since the version it was made of."""
    for _attempt in range(ATTEMPTS):
        if CodingEdit.objects.filter(pk=edit.id).exists():
            return False
        versions = CodingEdit.objects.filter(coding=coding, event=edit.event)
        newest: int = versions.aggregate(most=Max("version"))["most"] or 0
        try:
            with transaction.atomic():
                _insert(coding, edit, newest + 1, now)
        except IntegrityError:  # another tab stores this event, or this very change
            continue
        return newest != edit.base
    raise BadCodingError([_("The changes could not be saved. Try again.")])


def _insert(coding: Coding, edit: EventEdit, version: int, now: datetime.datetime) -> None:
    CodingEdit.objects.create(
        id=edit.id,
        coding=coding,
        event=edit.event,
        version=version,
        code=edit.code,
        begin=round(edit.begin, 3),
        end=None if edit.end is None else round(edit.end, 3),
        modifiers=edit.modifiers,
        comment=edit.comment,
        is_deleted=edit.is_deleted,
        at=now,
    )


def replace_events(coding: Coding, events: Iterable[CodedEvent], now: datetime.datetime) -> int:
    """Put imported, checked events into a coding in place of those that it has; return how many.

    Raises:
        BadCodingError: the coding is done.
    """
    refuse_if_done(coding)
    rows = [_deletion(edit, now) for edit in current(coding)]
    new = [
        CodingEdit(
            coding=coding,
            event=uuid.uuid4(),
            version=1,
            code=one.code,
            begin=one.begin,
            end=one.end,
            modifiers=one.modifiers,
            comment=one.comment,
            at=now,
        )
        for one in events
    ]
    with transaction.atomic():
        CodingEdit.objects.bulk_create([*rows, *new], batch_size=200)
    return len(new)


def _deletion(edit: CodingEdit, now: datetime.datetime) -> CodingEdit:
    return CodingEdit(
        coding_id=edit.coding_id,
        event=edit.event,
        version=edit.version + 1,
        code=edit.code,
        begin=edit.begin,
        end=edit.end,
        modifiers=edit.modifiers,
        comment=edit.comment,
        is_deleted=True,
        at=now,
    )


def finish(coding: Coding, duration: float, now: datetime.datetime) -> None:
    """Mark a coding as done.

    Raises:
        BadCodingError: an event is not as the scheme wants it, such as a state without an end.
    """
    checked(coding, duration)
    Coding.objects.filter(pk=coding.pk, done_at=None).update(done_at=now)


def checked(coding: Coding, duration: float) -> list[CodedEvent]:
    """Return the events of a coding, in order of time.

    Raises:
        BadCodingError: one is not as the scheme wants it.
    """
    document = [msgspec.to_builtins(event) for event in events_of(coding)]
    return events_from(document, read_scheme(coding.scheme).codes, duration)


def reopen(coding: Coding) -> None:
    """Let a coder change a coding that is done.

    Raises:
        BadCodingError: other coders' events of the session have been shown.
    """
    if is_revealed(coding.session_id, coding.scheme):
        raise BadCodingError(
            [
                _(
                    "All coders are done and may have compared their codings, so this one can't be"
                    " reopened."
                )
            ]
        )
    Coding.objects.filter(pk=coding.pk).update(done_at=None)


# --- who sees what --------------------------------------------------------------------------------


def is_revealed(session: uuid.UUID, scheme: CodingSchemeVersion) -> bool:
    """Tell whether the codings of a session may be compared: at least two, and all of them done."""
    rows = list(Coding.objects.filter(session=session, scheme=scheme).values_list("done_at"))
    return len(rows) > 1 and all(done is not None for (done,) in rows)


def released(scheme: CodingSchemeVersion) -> list[Coding]:
    """Return the codings that may leave: those of sessions that nobody is coding any more."""
    rows = list(
        Coding.objects.filter(scheme=scheme)
        .exclude(session__drive__participant__status=Participant.Status.WITHDRAWN)
        .select_related("session", "scheme")
        .order_by("session__granted_at", "session", "number")
    )
    busy = {row.session_id for row in rows if row.done_at is None}
    return [row for row in rows if row.session_id not in busy]


def compared(codings: Sequence[Coding]) -> Iterator[tuple[Session, list[Coding]]]:
    """Yield each session of codings with its own, where there are at least two."""
    of_session: dict[uuid.UUID, list[Coding]] = {}
    for coding in codings:
        of_session.setdefault(coding.session_id, []).append(coding)
    for some in of_session.values():
        if len(some) > 1:
            yield some[0].session, some


def waiting(scheme: CodingSchemeVersion) -> int:
    """Return how many sessions somebody is still coding."""
    rows = Coding.objects.filter(Q(scheme=scheme), done_at=None)
    return len(set(rows.values_list("session", flat=True)))
