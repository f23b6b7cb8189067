"""The form of a value in a dataset: a number, a known word, a pseudonym, a time relative to the
grant, or nothing. experiments/extraction/allow_list.toml lists the form of each field.

A value that does not fit its form is left out, because a modified robot or page may have sent it.
"""

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any, Final

from django.conf import settings

from experiments.extraction.pseudonyms import Pseudonyms
from experiments.extraction.selection import Selection
from robots.api.reasons import ReasonCode, parts_of

NOTHING: Final = object()
NEAR = 86_400.0  # s: a clock with a larger difference was never set
LARGEST = 1e8  # of a measure or a count; a Unix time is larger, in any unit


@dataclass(frozen=True)
class Release:
    """The pseudonyms and the choice of a dataset, the names of the doors of its plans, and the
    keys of the steps of the study's script.
    """

    names: Pseudonyms
    choice: Selection
    doors: frozenset[str] = frozenset()
    steps: frozenset[str] = frozenset()


@dataclass(frozen=True)
class Origin:
    """The zero of times: `granted` in Unix seconds by the server's clock; `offset` is the sender's
    clock minus the server's in seconds.
    """

    granted: float
    offset: float = 0.0

    def relative(self, stamp: float) -> float:
        """Return a time of the sender's clock in seconds since the grant, to the microsecond."""
        return round(stamp - self.offset - self.granted, 6)


@dataclass(frozen=True)
class Form:
    """`leave` returns the part of a stored value that a dataset has, or NOTHING; `note` is that
    of the code book on a field of this form, which is not in it without `is_listed`.
    """

    leave: Callable[[Any, Release, Origin], Any]
    note: str = ""
    is_listed: bool = True


def _number(value: Any, _release: Release, _origin: Origin) -> Any:
    if value is None or isinstance(value, bool):
        return value
    return value if isinstance(value, int | float) and abs(value) < LARGEST else NOTHING


def _time(value: Any, _release: Release, origin: Origin) -> Any:
    if not isinstance(value, int | float) or isinstance(value, bool):
        return NOTHING
    relative = origin.relative(value)
    return relative if abs(relative) < NEAR else NOTHING


def _code(value: Any, release: Release, _origin: Origin) -> Any:
    return release.names.thing(value) if isinstance(value, str) and value else NOTHING


def _text(value: Any, release: Release, _origin: Origin) -> Any:
    is_wanted = isinstance(value, str) and release.choice.has_text
    return release.names.in_text(value) if is_wanted else NOTHING


def _robot_reason(value: Any, release: Release, origin: Origin) -> Any:
    if not isinstance(value, str):
        return NOTHING
    code, _value = parts_of(value)
    return str(code) if code else value and _text(value, release, origin)


def _door_state(value: Any, release: Release, _origin: Origin) -> Any:
    name, _, state = value.rpartition(" ") if isinstance(value, str) else ("", "", "")
    return value if state in {"open", "closed"} and name in release.doors else NOTHING


def _one_of(known: Callable[[Release], frozenset[str]], note: str) -> Form:
    """A word of a set; another one is left out."""

    def leave(value: Any, release: Release, _origin: Origin) -> Any:
        return value if isinstance(value, str) and value in known(release) else NOTHING

    return Form(leave, note)


@cache
def _page_words() -> frozenset[str]:
    """Return the keys that pages report: those of the templates, and of a sentence with several
    parts the part that their keys share.
    """
    found = {
        key
        for path in (settings.BASE_DIR / "templates").rglob("*.html")
        for key in re.findall(r'data-word="([a-z0-9_.]+)"', path.read_text())
    }
    found |= {f"reason.{code}" for code in ReasonCode}
    return frozenset(found | {re.sub(r"\.(?:title|text|one|other)$", "", key) for key in found})


withheld = Form(lambda *_: NOTHING, is_listed=False)
# The module that reads it makes a column of its own, so that it never leaves as it is stored.
in_columns = Form(lambda *_: NOTHING, is_listed=False)
# A measure, a count, yes or no, or unknown; a larger number may be a date or an id.
number = Form(_number)
time = Form(_time, " (s)")
code = Form(_code, " (pseudonym)")  # of an id, which has the same one in the whole study
text = Form(_text, " (only with free text)")  # written by a person, or by a robot's software
door = _one_of(lambda release: release.doors, " (a door of the floor plan)")
door_state = Form(_door_state, " (a door of the floor plan, and open or closed)")
# The value of a reason, such as the name of a door, is left out.
robot_reason = Form(_robot_reason, f" ({' | '.join(ReasonCode)})")
script_step = _one_of(lambda release: release.steps, " (a step of the study's script)")
page_word = _one_of(lambda _release: _page_words(), " (key of a sentence of the page)")


def words(*known: str, is_several: bool = False) -> Form:
    """One word of a list, or several with spaces between them; any other text is free text."""

    def leave(value: Any, release: Release, origin: Origin) -> Any:
        if not isinstance(value, str):
            return NOTHING
        is_known = set(value.split() if is_several else [value]) <= set(known)
        return value if is_known else _text(value, release, origin)

    note = " | ".join(filter(None, known))
    return Form(leave, f" (some of {note})" if is_several else f" ({note})" if note else "")


def fields(listed: Mapping[str, Form]) -> Form:
    """An object of which the listed fields leave."""

    def leave(value: Any, release: Release, origin: Origin) -> Any:
        return kept(listed, value, release, origin) if isinstance(value, Mapping) else NOTHING

    return Form(leave, f" ({in_words(listed)})")


def private(form: Form) -> Form:
    """A value that is in no public dataset."""

    def leave(value: Any, release: Release, origin: Origin) -> Any:
        return NOTHING if release.choice.public else form.leave(value, release, origin)

    return Form(leave, f"{form.note} (in no public dataset)")


def kept(
    listed: Mapping[str, Form], data: Mapping[str, Any], release: Release, origin: Origin
) -> dict[str, Any]:
    """Return the fields of an object that leave, in its own order."""
    known = {name: value for name, value in data.items() if name in listed}
    found = {name: listed[name].leave(value, release, origin) for name, value in known.items()}
    return {name: value for name, value in found.items() if value is not NOTHING}


def in_words(listed: Mapping[str, Form]) -> str:
    """Return the fields that leave, each with its note, for a code book."""
    return ", ".join(f"{name}{form.note}" for name, form in listed.items() if form.is_listed)
