"""What the forms of a family of documents say, leave out and put last: all that the classes do not
tell themselves. Study and questionnaire have a guide each.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

Words = Mapping[str, Any]
Names = Mapping[type[Any], frozenset[str]]


@dataclass(frozen=True)
class FormGuide:
    """Words are looked up by `key` or, where classes differ, `Class.key`.

    `labels` and `hints` are of fields, `items` of one part of a list, `choices` by the field and
    then the value. `kinds` are what can be added to a list as one of several. No form asks for what
    is `hidden`; a part does not have what it has another field `instead` of. `details` are folded
    away, `last` are asked after all others, `long` is written on several lines, in `spaced` lists
    only commas are between names, and `angles` are shown in degrees.
    """

    labels: Words
    hints: Words
    items: Words
    choices: Mapping[str, Words]
    kinds: Mapping[str, Words] = field(default_factory=dict)
    hidden: Names = field(default_factory=dict)
    instead: Mapping[type[Any], Mapping[str, frozenset[str]]] = field(default_factory=dict)
    details: frozenset[str] = frozenset()
    last: frozenset[str] = frozenset()
    long: frozenset[str] = frozenset()
    spaced: frozenset[str] = frozenset()
    angles: frozenset[str] = frozenset()

    def label(self, called: str) -> Any:
        return _of(self.labels, called, called.rpartition(".")[2])

    def hint(self, called: str) -> Any:
        return _of(self.hints, called, "")

    def item(self, called: str) -> Any:
        return _of(self.items, called, self.label(called))

    def added(self, called: str) -> list[tuple[str, Any]]:
        """Return the kinds of which a part of a list is added, and their words; none for most."""
        return list(self.kinds.get(called, {}).items())

    def word(self, called: str, value: str) -> Any:
        return _of(self.choices, called, {}).get(value, value)

    def is_detail(self, called: str) -> bool:
        return _is_among(self.details, called)

    def is_long(self, called: str) -> bool:
        return _is_among(self.long, called)

    def is_angle(self, called: str) -> bool:
        return _is_among(self.angles, called)

    def is_hidden(self, cls: type[Any], key: str) -> bool:
        return any(key in self.hidden.get(base, ()) for base in cls.__mro__)

    def left_out(self, cls: type[Any], has: Callable[[str], Any]) -> frozenset[str]:
        """Return the fields that a part does not have; `has` tells whether it has another."""
        instead = self.instead.get(cls, {})
        return frozenset().union(*(others for key, others in instead.items() if has(key)))


def _is_among(names: frozenset[str], called: str) -> bool:
    return called in names or called.rpartition(".")[2] in names


def _of(words: Mapping[str, Any], called: str, otherwise: Any) -> Any:
    """Return the words for a field, `key` or `Class.key`: of this class, or of any."""
    return words.get(called, words.get(called.rpartition(".")[2], otherwise))
