"""The events of coders, checked against the scheme (experiments/definition/coding.py)."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

import msgspec
from django.utils.translation import gettext as _

from experiments.definition.coding import Code, CodingScheme, scheme_problems
from surveys.document_forms.problem_text import sentences

MAX_EVENTS, MAX_COMMENT = 5000, 500
# Six days: longer than any session, and short enough that no time is a mistake in units.
MAX_SECONDS = 500_000.0
MAX_SCHEME_BYTES = 200_000


class BadCodingError(ValueError):
    """A scheme or a coding that cannot be used. `problems` has a sentence for each one found."""

    def __init__(self, problems: Sequence[str]) -> None:
        super().__init__(" ".join(problems))
        self.problems = list(problems)


class CodedEvent(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """An event of a coding; `end` is None for a point. Times are in seconds since the grant, as in
    the replay; `modifiers` are the chosen values by the modifiers' names.
    """

    code: str
    begin: float
    end: float | None = None
    comment: str = ""
    modifiers: dict[str, str] = {}


# The events of a file, and a sentence for each of its parts that is not imported.
ImportedCoding = tuple[list[CodedEvent], list[str]]


def scheme_from(document: Any) -> CodingScheme:
    """Return a scheme, or raise BadCodingError; a list alone is its codes."""
    whole = {"codes": document} if isinstance(document, list) else document
    try:
        scheme = msgspec.convert(whole, CodingScheme)
    except msgspec.ValidationError as error:
        raise BadCodingError([f"{error}."]) from error
    if found := sentences(scheme_problems(scheme.codes)):
        raise BadCodingError(found)
    return scheme


def scheme_in(file: bytes) -> CodingScheme:
    """Return the scheme in a JSON file, or raise BadCodingError."""
    if len(file) > MAX_SCHEME_BYTES:
        raise BadCodingError([_("The file is too large for a coding scheme.")])
    return scheme_from(json_in(file))


def json_in(file: bytes) -> Any:
    """Return the content of a JSON file, or raise BadCodingError."""
    try:
        return msgspec.json.decode(file.removeprefix(b"\xef\xbb\xbf"))
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        text = _("This is not valid JSON: %(problem)s.") % {"problem": error}
        raise BadCodingError([text]) from error


def events_from(document: Any, codes: Sequence[Code], duration: float) -> list[CodedEvent]:
    """Return the events of a coding in order of time, rounded to milliseconds, from a list of
    objects with the fields of CodedEvent, or raise BadCodingError. They lie within the duration of
    the session, in s.
    """
    try:
        events = msgspec.convert(document, list[CodedEvent])
    except msgspec.ValidationError as error:
        raise BadCodingError([f"{error}."]) from error
    if len(events) > MAX_EVENTS:
        raise BadCodingError([_("A coding has at most %(n)d events.") % {"n": MAX_EVENTS}])
    known = {code.code: code for code in codes}
    if found := [text for event in events for text in _problems_of(event, known, duration)]:
        raise BadCodingError(found[:20])
    ordered = sorted(map(_rounded, events), key=lambda event: (event.begin, event.code))
    if found := list(_overlaps(ordered, known)):
        raise BadCodingError(found[:20])
    return ordered


def _rounded(event: CodedEvent) -> CodedEvent:
    end = None if event.end is None else round(event.end, 3)
    return msgspec.structs.replace(event, begin=round(event.begin, 3), end=end)


def _problems_of(event: CodedEvent, known: Mapping[str, Code], duration: float) -> Iterator[str]:
    code, limit = known.get(event.code), min(duration, MAX_SECONDS) + 0.001
    yield from event_problems(event, code, event.code)
    if code is not None and code.kind == "interval" and event.end is None:
        yield _not_ended(event, event.code)
    if not (0 <= event.begin <= limit and (event.end is None or event.end <= limit)):
        yield _("%(code)s at %(at)s s is outside the session.") % _where(event, event.code)


def event_problems(event: Any, code: Code | None, name: str) -> Iterator[str]:
    """Yield why an object with the fields of CodedEvent cannot be stored. A state may have no end
    yet; `code` is None when the scheme has none, and `name` is for the sentences.
    """
    where = _where(event, name)
    if code is None:
        yield _("The scheme has no code “%(code)s”.") % where
    elif code.kind == "point" and event.end is not None:
        yield _("%(code)s at %(at)s s is a point, so it can't have an end.") % where
    elif event.end is not None and not event.end > event.begin:
        yield _not_ended(event, name)
    if len(event.comment) > MAX_COMMENT or not event.comment.isprintable():
        yield _("%(code)s at %(at)s s: the comment is too long.") % where
    allowed = {one.name: one.values for one in code.modifiers} if code is not None else {}
    if code and any(value not in allowed.get(one, ()) for one, value in event.modifiers.items()):
        yield _("%(code)s at %(at)s s has a modifier that the scheme does not have.") % where


def _not_ended(event: Any, name: str) -> str:
    text: str = _("%(code)s at %(at)s s must end after it begins.") % _where(event, name)
    return text


def _where(event: Any, name: str) -> dict[str, str]:
    return {"code": name, "at": f"{event.begin:.3f}"}


def clean(text: str) -> str:
    """Return a text of another program on one line, without characters that cannot be seen."""
    return "".join(sign for sign in " ".join(text.split()) if sign.isprintable())


def _overlaps(events: Iterable[CodedEvent], known: Mapping[str, Code]) -> Iterator[str]:
    last: dict[str, float] = {}
    for event in events:
        where = _where(event, event.code)
        if event.end is None:
            if last.get(event.code) == event.begin:
                yield _("%(code)s at %(at)s s appears twice.") % where
            last[event.code] = event.begin
            continue
        group = known[event.code].group
        name = f"group {group}" if group else event.code
        if event.begin < last.get(name, 0.0):
            yield _("%(code)s at %(at)s s begins before the previous one ends.") % where
        last[name] = max(last.get(name, 0.0), event.end)
