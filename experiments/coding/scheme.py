"""What coders of a study's replays may note: a scheme of codes, and the events that they coded.

An event of a code for points has a moment, one of a code for intervals a beginning and an end, in
seconds since the grant, the time of the replay.
"""

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Annotated, Any, Literal

import msgspec
from django.utils.translation import gettext as _

MAX_CODES, MAX_EVENTS, MAX_COMMENT = 40, 5000, 500
# Six days: longer than any session, and short enough that no time is a mistake in units.
MAX_SECONDS = 500_000.0
# Keys that the replay's player has.
TAKEN_KEYS = frozenset("k+- ")

CodeName = Annotated[str, msgspec.Meta(pattern=r"^[a-z][a-z0-9_]{0,39}$")]


class BadCodingError(ValueError):
    """A scheme or a coding that cannot be used. `problems` has a sentence each."""

    def __init__(self, problems: Sequence[str]) -> None:
        super().__init__(" ".join(problems))
        self.problems = list(problems)


class Code(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One thing to code. `code` names it in files, `name` on pages; `key` codes it on the replay,
    "" only by its button.
    """

    code: CodeName
    name: str
    kind: Literal["point", "interval"]
    key: str = ""


class CodedEvent(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Something that a coder noted; `end` is None for a point. Times in seconds."""

    code: str
    begin: float
    end: float | None = None
    comment: str = ""


def codes_from(document: Any) -> tuple[Code, ...]:
    """Return the codes of a scheme.

    Raises:
        BadCodingError: with every problem found.
    """
    try:
        codes = msgspec.convert(document, tuple[Code, ...])
    except msgspec.ValidationError as error:
        raise BadCodingError([f"{error}."]) from error
    if found := list(_code_problems(codes)):
        raise BadCodingError(found)
    return codes


def _code_problems(codes: Sequence[Code]) -> Iterator[str]:
    if len(codes) > MAX_CODES:
        yield _("A scheme has at most %(n)d codes.") % {"n": MAX_CODES}
    for code in codes:
        if not code.name.strip() or len(code.name) > 80:
            yield _("%(code)s: enter a name of at most 80 characters.") % {"code": code.code}
        if len(code.key) > 1 or code.key.lower() in TAKEN_KEYS or not code.key.isprintable():
            yield _(
                "%(code)s: choose a single character as the key. The player already uses k, "
                "+ and −."
            ) % {"code": code.code}
    for what, names in (
        (_("code"), [code.code for code in codes]),
        (_("key"), [code.key.lower() for code in codes if code.key]),
    ):
        for name, count in Counter(names).items():
            if count > 1:
                yield _("The %(what)s “%(name)s” is used %(count)d times.") % {
                    "what": what,
                    "name": name,
                    "count": count,
                }


def events_from(document: Any, codes: Sequence[Code], duration: float) -> list[CodedEvent]:
    """Return the events of a coding in order of time, rounded to milliseconds.

    Args:
        document: a list of objects with the fields of CodedEvent.
        codes: those of the scheme.
        duration: of the session, s; an event lies within it.

    Raises:
        BadCodingError: with every problem found.
    """
    try:
        events = msgspec.convert(document, list[CodedEvent])
    except msgspec.ValidationError as error:
        raise BadCodingError([f"{error}."]) from error
    if len(events) > MAX_EVENTS:
        raise BadCodingError([_("A coding has at most %(n)d events.") % {"n": MAX_EVENTS}])
    kinds = {code.code: code.kind for code in codes}
    if found := list(_event_problems(events, kinds, duration)):
        raise BadCodingError(found[:20])
    ordered = sorted(
        (_rounded(event) for event in events), key=lambda event: (event.begin, event.code)
    )
    if found := list(_overlaps(ordered)):
        raise BadCodingError(found[:20])
    return ordered


def _rounded(event: CodedEvent) -> CodedEvent:
    end = None if event.end is None else round(event.end, 3)
    return msgspec.structs.replace(event, begin=round(event.begin, 3), end=end)


def _event_problems(
    events: Iterable[CodedEvent], kinds: Mapping[str, str], duration: float
) -> Iterator[str]:
    limit = min(duration, MAX_SECONDS) + 0.001
    for event in events:
        where = {"code": event.code, "at": f"{event.begin:.3f}"}
        kind = kinds.get(event.code)
        if kind is None:
            yield _("The scheme has no code “%(code)s”.") % where
        elif kind == "point" and event.end is not None:
            yield _("%(code)s at %(at)s s is a point, so it can't have an end.") % where
        elif kind == "interval" and (event.end is None or not event.end > event.begin):
            yield _("%(code)s at %(at)s s must end after it begins.") % where
        if not (0 <= event.begin <= limit and (event.end is None or event.end <= limit)):
            yield _("%(code)s at %(at)s s is outside the session.") % where
        if len(event.comment) > MAX_COMMENT or "\x00" in event.comment:
            yield _("%(code)s at %(at)s s: the comment is too long.") % where


def _overlaps(events: Iterable[CodedEvent]) -> Iterator[str]:
    """Yield intervals of one code that overlap: who codes says when it began and ended once."""
    last: dict[str, float] = {}
    for event in events:
        if event.end is None:
            continue
        if event.begin < last.get(event.code, 0.0):
            yield _("%(code)s at %(at)s s begins before the previous one ends.") % {
                "code": event.code,
                "at": f"{event.begin:.3f}",
            }
        last[event.code] = max(last.get(event.code, 0.0), event.end)
