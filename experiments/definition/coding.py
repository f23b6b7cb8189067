"""Codes that coders assign on replays: point events, and state events with an end, in s since the
grant.
"""

from collections.abc import Iterator, Sequence
from typing import Annotated, Literal

from msgspec import Meta

from surveys.documents import (
    DocumentPart,
    Key,
    Problem,
    ProblemPlace,
    duplicates,
    gettext_noop as _,
    within,
)

MAX_CODES, MAX_MODIFIERS, MAX_VALUES = 40, 5, 20
MAX_NAME, MAX_DESCRIPTION = 80, 500
TAKEN_KEYS = frozenset("k+- ")  # of the replay's player
# BORIS separates modifiers by these (boris/config.py, CHAR_FORBIDDEN_IN_MODIFIERS).
FORBIDDEN_IN_MODIFIERS = frozenset("(|),`~")


class Modifier(DocumentPart, frozen=True):
    """A property that a coder can add to an event: one of `values`."""

    name: str
    values: tuple[str, ...]


class Code(DocumentPart, frozen=True):
    """`code` is its name in files, `name` on pages, `key` its key on the replay ("": only a
    button). State events of one `group` end each other.
    """

    code: Key
    name: str
    kind: Literal["point", "interval"]
    key: str = ""
    description: str = ""
    group: str = ""
    modifiers: tuple[Modifier, ...] = ()


class CodingScheme(DocumentPart, frozen=True, kw_only=True):
    """`blind` coders see neither the condition nor what would reveal it. Agreement by time has bins
    of `bin` s; events of two coders match when they begin within `tolerance` s.
    """

    codes: tuple[Code, ...]
    blind: bool = False
    bin: Annotated[float, Meta(ge=0.05, le=60.0)] = 1.0
    tolerance: Annotated[float, Meta(ge=0.0, le=60.0)] = 0.5

    def code(self, key: str) -> Code | None:
        return next((code for code in self.codes if code.code == key), None)


def scheme_problems(codes: Sequence[Code]) -> Iterator[Problem]:
    place = ProblemPlace("coding")
    if not codes:
        yield Problem(_("The coding scheme has no codes."), place=place)
    if len(codes) > MAX_CODES:
        yield Problem(_("A coding scheme has at most %(n)d codes."), {"n": MAX_CODES}, place=place)
    names = (code.name.strip().casefold() for code in codes)
    keys = (code.key.lower() for code in codes if code.key)
    yield from within(duplicates(_("Code"), (code.code for code in codes)), place)
    yield from within(duplicates(_("Name"), names), place)
    yield from within(duplicates(_("Key"), keys), place)
    for n, code in enumerate(codes):
        yield from within(_code_problems(code), ProblemPlace("codes", n), _("Code"), code.code)


def _code_problems(code: Code) -> Iterator[Problem]:
    if not code.name.strip() or len(code.name) > MAX_NAME or not code.name.isprintable():
        yield Problem(_("enter a name of at most %(n)d characters."), {"n": MAX_NAME})
    if len(code.key) > 1 or code.key.lower() in TAKEN_KEYS or not code.key.isprintable():
        words = _("choose a single character as the key. The player already uses k, + and −.")
        yield Problem(words)
    if len(code.description) > MAX_DESCRIPTION or "\x00" in code.description:
        yield Problem(_("the description is longer than %(n)d characters."), {"n": MAX_DESCRIPTION})
    if len(code.group) > MAX_NAME or not code.group.isprintable():
        yield Problem(_("the group's name is too long."))
    if code.group and code.kind == "point":
        yield Problem(_("a point event has no duration, so it cannot be in a group."))
    if len(code.modifiers) > MAX_MODIFIERS:
        yield Problem(_("it has more than %(n)d modifiers."), {"n": MAX_MODIFIERS})
    for modifier in code.modifiers:
        yield from _modifier_problems(modifier)
    yield from duplicates(_("Modifier"), (modifier.name for modifier in code.modifiers))


def _modifier_problems(modifier: Modifier) -> Iterator[Problem]:
    if not 1 <= len(modifier.values) <= MAX_VALUES:
        words = _("the modifier “%(name)s” needs 1 to %(n)d values.")
        yield Problem(words, {"name": modifier.name, "n": MAX_VALUES})
    for text in (modifier.name, *modifier.values):
        if not text.strip() or text != text.strip() or len(text) > MAX_NAME:
            words = _(
                "the modifier “%(name)s” has a text that is empty, too long, or has spaces around "
                "it."
            )
            yield Problem(words, {"name": modifier.name})
        elif not text.isprintable() or FORBIDDEN_IN_MODIFIERS & set(text) or text == "None":
            words = _("“%(text)s” cannot be used: it is “None”, or has one of ( | ) , ` ~.")
            yield Problem(words, {"text": text})
    yield from duplicates(_("Value"), modifier.values)
