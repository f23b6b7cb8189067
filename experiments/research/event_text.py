"""The data of an event in words (event_words.csv), for the reader of a replay."""

import re
from collections.abc import Iterator, Mapping
from typing import Any

from django.utils.translation import gettext as _, gettext_lazy, pgettext_lazy

from accounts.models import GUEST_NAMES
from robots.readiness_text import in_words as readiness
from sessions.leases import terms
from sessions.models import Session
from surveys.document_forms.guide import words_by_kind

# Left out: drawn on the map, the id of a row, or long and of no use to a reader.
LEFT_OUT = frozenset(
    {"pose", "sha256", "actionId", "id", "user", "by", "boot", "ranges", "photo", "lastSeq"}
)
LONGEST = 160
UNITS = {
    **dict.fromkeys(("seconds", "latency", "remaining"), "s"),
    **dict.fromkeys(("width", "height", "screen_width", "screen_height"), "px"),
    "minutes": "min",
}
# Fields whose values need no name.
PLAIN = frozenset(
    {"name", "detail", "reason", "text", "type", "why", "outcome", "method"}
    | {"choice", "state", "status", "word", "layout"}
)
_WORDS = words_by_kind(__file__, "event_words.csv", gettext_lazy)
FIELDS = _WORDS["field"] | {"hidden": pgettext_lazy("a page", "hidden")}
CUES = _WORDS["cue"]
VALUES = _WORDS["value"] | {
    "closed": pgettext_lazy("a door", "closed"),
    "FINISHED": pgettext_lazy("an action", "finished"),
}
_KEY = re.compile(r"[A-Za-z0-9]+([_.-][A-Za-z0-9]+)+")


def in_words(data: Mapping[str, Any]) -> str:
    return " · ".join(part for part in _parts(data) if part)[:LONGEST]


def _parts(data: Mapping[str, Any]) -> Iterator[str]:
    cue = str(data.get("name") or data.get("word") or "").removeprefix("cue.")
    is_cue = cue in CUES
    if is_cue:
        yield str(CUES[cue]).replace("{k}", str(data.get("number") or ""))
    for name, value in data.items():
        if name in LEFT_OUT or value is None or (is_cue and name in {"name", "word", "number"}):
            continue
        text = _value_text(value, name)
        yield text if name in PLAIN or not text else f"{_field(name)} {text}"


def _field(name: str) -> str:
    return str(FIELDS.get(name, name.replace("_", " ")))


def _value_text(value: Any, field: str = "") -> str:
    if isinstance(value, bool):
        return _("yes") if value else _("no")
    if isinstance(value, Mapping):
        return ", ".join(
            f"{_field(name)} {_value_text(part, name)}" for name, part in value.items()
        )
    if isinstance(value, list | tuple):
        return ", ".join(_value_text(part) for part in value)
    if isinstance(value, int | float):
        number = f"{value:.3g}" if value % 1 else f"{value:.0f}"
        return f"{number} {UNITS.get(field, '')}".rstrip()
    if field == "reason":  # of a robot that is not ready, what it waits for
        return readiness(str(value).removeprefix(f"{terms.START}: ")) if value else ""
    return _word(str(value))


def _word(text: str) -> str:
    """Return a text with each known word translated, and keys such as `a_b` as words."""
    known = {**dict(Session.Outcome.choices), **VALUES, **GUEST_NAMES}
    if text in known:
        return str(known[text])
    return " ".join(
        str(known.get(word) or (re.sub(r"[_.-]", " ", word) if _KEY.fullmatch(word) else word))
        for word in text.split(" ")
    )
