"""What coders of a study's replays may note: point events, which have a moment, and state events,
which have a beginning and an end, in seconds since the grant. Frozen with a study that declares it.
"""

from collections import Counter
from collections.abc import Iterator, Sequence
from typing import Annotated, Literal

from msgspec import Meta

from surveys.documents import DocumentPart, Key

MAX_CODES, MAX_MODIFIERS, MAX_VALUES = 40, 5, 20
MAX_NAME, MAX_DESCRIPTION = 80, 500
# Keys that the replay's player has.
TAKEN_KEYS = frozenset("k+- ")
# BORIS separates modifiers by these (boris/config.py, CHAR_FORBIDDEN_IN_MODIFIERS).
FORBIDDEN_IN_MODIFIERS = frozenset("(|),`~")


class Modifier(DocumentPart, frozen=True):
    """What a coder adds to an event of a code: one of `values`, or nothing."""

    name: str
    values: tuple[str, ...]


class Code(DocumentPart, frozen=True):
    """One thing to code. `code` names it in files, `name` on pages; `key` codes it on the replay,
    "" only by its button. Of the state events of one `group`, one at a time is on.
    """

    code: Key
    name: str
    kind: Literal["point", "interval"]
    key: str = ""
    description: str = ""
    group: str = ""
    modifiers: tuple[Modifier, ...] = ()


class CodingScheme(DocumentPart, frozen=True, kw_only=True):
    """The codes, and how agreement on them is computed.

    `blind` coders see neither the condition nor what would give it away. Time is cut into bins of
    `bin` seconds; events of two coders match when they begin within `tolerance` seconds.
    """

    codes: tuple[Code, ...]
    blind: bool = False
    bin: Annotated[float, Meta(ge=0.05, le=60.0)] = 1.0
    tolerance: Annotated[float, Meta(ge=0.0, le=60.0)] = 0.5

    def code(self, key: str) -> Code | None:
        """Return the code with a key."""
        return next((code for code in self.codes if code.code == key), None)


def scheme_problems(codes: Sequence[Code]) -> Iterator[str]:
    """Yield what is wrong with the codes of a scheme, a sentence each."""
    if not codes:
        yield "The coding scheme has no codes."
    if len(codes) > MAX_CODES:
        yield f"A coding scheme has at most {MAX_CODES} codes."
    for code in codes:
        yield from (f"Code {code.code}: {problem}" for problem in _code_problems(code))
    yield from _repeated("code", [code.code for code in codes])
    yield from _repeated("name", [code.name.strip().casefold() for code in codes])
    yield from _repeated("key", [code.key.lower() for code in codes if code.key])


def _code_problems(code: Code) -> Iterator[str]:
    if not code.name.strip() or len(code.name) > MAX_NAME or not code.name.isprintable():
        yield f"enter a name of at most {MAX_NAME} characters."
    if len(code.key) > 1 or code.key.lower() in TAKEN_KEYS or not code.key.isprintable():
        yield "choose a single character as the key. The player already uses k, + and −."
    if len(code.description) > MAX_DESCRIPTION or "\x00" in code.description:
        yield f"the description is longer than {MAX_DESCRIPTION} characters."
    if len(code.group) > MAX_NAME or not code.group.isprintable():
        yield "the group's name is too long."
    if code.group and code.kind == "point":
        yield "a point event has no duration, so it cannot be in a group."
    if len(code.modifiers) > MAX_MODIFIERS:
        yield f"it has more than {MAX_MODIFIERS} modifiers."
    for modifier in code.modifiers:
        yield from _modifier_problems(modifier)
    yield from _repeated("modifier", [modifier.name for modifier in code.modifiers])


def _modifier_problems(modifier: Modifier) -> Iterator[str]:
    if not 1 <= len(modifier.values) <= MAX_VALUES:
        yield f"the modifier “{modifier.name}” needs 1 to {MAX_VALUES} values."
    for text in (modifier.name, *modifier.values):
        if not text.strip() or text != text.strip() or len(text) > MAX_NAME:
            yield (
                f"the modifier “{modifier.name}” has a text that is empty, too long, or has spaces"
                " around it."
            )
        elif not text.isprintable() or FORBIDDEN_IN_MODIFIERS & set(text) or text == "None":
            yield f"“{text}” cannot be used: it is “None”, or has one of ( | ) , ` ~."
    yield from _repeated("value", modifier.values)


def _repeated(what: str, names: Sequence[str]) -> Iterator[str]:
    for name, count in Counter(names).items():
        if count > 1:
            yield f"The {what} “{name}” is used {count} times."
