"""What goes into a dataset: pseudonymous unless somebody who may decides otherwise."""

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from experiments.dataset.pseudonyms import Pseudonyms

SOURCES = ("task", "server", "robot", "page")
_WORD = re.compile(r"^[A-Za-z0-9_.+-]{1,40}$")
_PERSONAL = frozenset(
    {
        "user",
        "who",
        "by",
        "username",
        "email",
        "address",
        "ip",
        "user_agent",
        "text",
        "message",
        "name",
    }
)
_NAMES = frozenset({"id", "action", "actionId", "action_id", "boot", "session", "peer"})
_LATCH = frozenset({"estop", "estop_cleared"})  # their detail names who it was
_NEAR = 86_400.0  # s: a number so near to the grant is a time


@dataclass(frozen=True)
class Selection:
    """What a dataset holds beside numbers and words from lists.

    `identified` adds who the participants are and leaves out nothing; `sources` are those of the
    events, `formats` the names of those that were asked for (experiments/export/formats/).
    """

    identified: bool = False
    free_text: bool = False
    formats: frozenset[str] = frozenset()
    sources: tuple[str, ...] = SOURCES

    @property
    def has_text(self) -> bool:
        """Tell whether free text is kept."""
        return self.identified or self.free_text


def words_of(reason: str, choice: Selection) -> str:
    """Return a reason that is a word; a sentence, which a person wrote, only where free text is
    kept.
    """
    return reason if choice.has_text or _WORD.match(reason) else ""


def event_data(
    source: str,
    kind: str,
    data: Mapping[str, Any],
    *,
    granted: float,
    choice: Selection,
    names: Pseudonyms,
) -> dict[str, Any]:
    """Return what is kept of an event's data: times relative to the grant (Unix seconds), names as
    codes, and no text that a person wrote.
    """
    if choice.identified:
        return {name: _relative(value, granted) for name, value in data.items()}
    if source == "task":  # made by the task engine: nobody's words are in it
        return {
            name: names.in_text(value) if isinstance(value, str) else value
            for name, value in data.items()
        }
    return dict(_withheld(kind, data, granted, choice, names))


def _withheld(
    kind: str, data: Mapping[str, Any], granted: float, choice: Selection, names: Pseudonyms
) -> Iterator[tuple[str, Any]]:
    for name, value in data.items():
        if (
            name in _PERSONAL
            or (name == "detail" and kind in _LATCH)
            or (name == "reason" and kind.startswith("operator"))
        ):
            continue
        if isinstance(value, str):
            if name in _NAMES:
                yield name, names.thing(value)
            elif choice.free_text or _WORD.match(value):
                yield name, names.in_text(value)
        else:
            yield name, _relative(value, granted)


def _relative(value: Any, granted: float) -> Any:
    is_time = isinstance(value, float) and abs(value - granted) < _NEAR
    return round(value - granted, 6) if is_time else value
