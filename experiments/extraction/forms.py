"""In which form a value leaves in a dataset: as a number, a known word, a pseudonym, a time
relative to the grant, or not at all. experiments/extraction/allow_list.py lists which field has
which form.

A form takes a value as it is stored and returns what leaves, or `NOTHING`. A value that is not what
its form expects does not leave: who sent it may be a robot, or a page, that somebody changed.
"""

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any, Final

from django.conf import settings

from experiments.extraction.pseudonyms import Pseudonyms
from experiments.extraction.selection import Selection

NOTHING: Final = object()
NEAR = 86_400.0  # s: clocks that differ by more have not been set
LARGEST = 1e8  # of a measure or a count; a Unix time is larger, in whatever unit


@dataclass(frozen=True)
class Release:
    """What a dataset is made with: its pseudonyms, what was asked for, the names of the doors of
    the study's floor plans, which the dataset has as well, and the keys of the steps of its script.
    """

    names: Pseudonyms
    choice: Selection
    doors: frozenset[str] = frozenset()
    steps: frozenset[str] = frozenset()


@dataclass(frozen=True)
class Origin:
    """Where times count from: `granted` in Unix seconds by the server's clock; `offset` is the
    sender's clock minus the server's in seconds.
    """

    granted: float
    offset: float = 0.0

    def relative(self, stamp: float) -> float:
        """Return a time of the sender's clock in seconds since the grant, to the microsecond."""
        return round(stamp - self.offset - self.granted, 6)


Form = Callable[[Any, Release, Origin], Any]


def withheld(_value: Any, _release: Release, _origin: Origin) -> Any:
    """Never leaves."""
    return NOTHING


def in_columns(_value: Any, _release: Release, _origin: Origin) -> Any:
    """Leaves in a column of its own, made by the module that reads it; never as it is stored."""
    return NOTHING


def number(value: Any, _release: Release, _origin: Origin) -> Any:
    """A measure, a count, yes or no, or unknown; what is so large may be a date or an id."""
    if value is None or isinstance(value, bool):
        return value
    return value if isinstance(value, int | float) and abs(value) < LARGEST else NOTHING


def time(value: Any, _release: Release, origin: Origin) -> Any:
    """A time of the sender's clock, in seconds since the grant."""
    if not isinstance(value, int | float) or isinstance(value, bool):
        return NOTHING
    relative = origin.relative(value)
    return relative if abs(relative) < NEAR else NOTHING


def code(value: Any, release: Release, _origin: Origin) -> Any:
    """An id, as the pseudonym that it has everywhere in the study."""
    return release.names.thing(value) if isinstance(value, str) and value else NOTHING


def text(value: Any, release: Release, _origin: Origin) -> Any:
    """What a person wrote, or a robot said in its own words: only where free text is asked for."""
    is_wanted = isinstance(value, str) and release.choice.has_text
    return release.names.in_text(value) if is_wanted else NOTHING


@dataclass(frozen=True)
class WordForm:
    """Words of a list; anything else is free text. With `several`, some of them with spaces between
    them; else one.
    """

    known: tuple[str, ...]
    several: bool = False

    def __call__(self, value: Any, release: Release, origin: Origin) -> Any:
        """Return the words, or what `text` makes of it."""
        said = [] if not isinstance(value, str) else value.split() if self.several else [value]
        is_known = isinstance(value, str) and set(said) <= set(self.known)
        return value if is_known else text(value, release, origin)


def words(*known: str) -> WordForm:
    """One of these words."""
    return WordForm(known)


def several(*known: str) -> WordForm:
    """Some of these words with spaces between them."""
    return WordForm(known, several=True)


def door(value: Any, release: Release, _origin: Origin) -> Any:
    """The name of a door of the study's floor plans."""
    return value if isinstance(value, str) and value in release.doors else NOTHING


def door_state(value: Any, release: Release, origin: Origin) -> Any:
    """The name of a door, and whether it is open or closed now."""
    name, _, state = value.rpartition(" ") if isinstance(value, str) else ("", "", "")
    is_known = state in {"open", "closed"} and door(name, release, origin) is not NOTHING
    return value if is_known else NOTHING


def script_step(value: Any, release: Release, _origin: Origin) -> Any:
    """The key of a step of the study's own script for a hidden operator."""
    return value if isinstance(value, str) and value in release.steps else NOTHING


def page_word(value: Any, _release: Release, _origin: Origin) -> Any:
    """The key of a sentence of the page, as it stands in the templates."""
    return value if isinstance(value, str) and value in _page_words() else NOTHING


_WORD_KEY = re.compile(r'data-word="([a-z0-9_.]+)"')
_PART = re.compile(r"\.(?:title|text|one|other)$")


@cache
def _page_words() -> frozenset[str]:
    """The keys that pages report: those of the templates, and of a sentence with several parts the
    one that they share.
    """
    found = {
        key
        for path in (settings.BASE_DIR / "templates").rglob("*.html")
        for key in _WORD_KEY.findall(path.read_text())
    }
    return frozenset(found | {_PART.sub("", key) for key in found})


@dataclass(frozen=True)
class ObjectForm:
    """An object of which the listed fields leave."""

    listed: Mapping[str, Form]

    def __call__(self, value: Any, release: Release, origin: Origin) -> Any:
        """Return these fields."""
        return kept(self.listed, value, release, origin) if isinstance(value, Mapping) else NOTHING


@dataclass(frozen=True)
class PrivateForm:
    """What leaves in a form, but in no public dataset."""

    form: Form

    def __call__(self, value: Any, release: Release, origin: Origin) -> Any:
        """Return the value in its form."""
        return NOTHING if release.choice.public else self.form(value, release, origin)


def fields(listed: Mapping[str, Form]) -> ObjectForm:
    """An object of which the listed fields leave."""
    return ObjectForm(listed)


def kept(
    listed: Mapping[str, Form], data: Mapping[str, Any], release: Release, origin: Origin
) -> dict[str, Any]:
    """Return what leaves of an object, in its own order."""
    found = {
        name: listed[name](value, release, origin) for name, value in data.items() if name in listed
    }
    return {name: value for name, value in found.items() if value is not NOTHING}


def in_words(listed: Mapping[str, Form]) -> str:
    """Return the fields that leave of an object, with the words that one may have, for a code
    book.
    """
    return ", ".join(
        f"{name}{_told(form)}" for name, form in listed.items() if form not in KEPT_BACK
    )


def _told(form: Form) -> str:
    if isinstance(form, PrivateForm):
        return _told(form.form) + " (in no public dataset)"
    if isinstance(form, ObjectForm):
        return f" ({in_words(form.listed)})"
    if isinstance(form, WordForm):
        known = " | ".join(word for word in form.known if word)
        return f" (some of {known})" if form.several else f" ({known})" if known else ""
    return f" ({TOLD[form]})" if form in TOLD else ""


KEPT_BACK = (withheld, in_columns)
TOLD: Mapping[Form, str] = {
    time: "s",
    code: "pseudonym",
    text: "only with free text",
    door: "a door of the floor plan",
    door_state: "a door of the floor plan, and open or closed",
    script_step: "a step of the study's script",
    page_word: "key of a sentence of the page",
}
