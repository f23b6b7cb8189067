"""Labels, hints and layout of forms of documents; studies and questionnaires have a guide each."""

import csv
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

Words = Mapping[str, Any]
Names = Mapping[type[Any], frozenset[str]]


@dataclass(frozen=True)
class FormGuide:
    """Fields are named by `key` or, where classes differ, `Class.key`."""

    labels: Words
    hints: Words
    items: Words  # of one part of a list
    choices: Mapping[str, Words]  # by field, then value
    kinds: Mapping[str, Words] = field(default_factory=dict)  # that can be added to a list
    hidden: Names = field(default_factory=dict)  # in no form
    # By class: fields that a part lacks where it has another one.
    instead: Mapping[type[Any], Mapping[str, frozenset[str]]] = field(default_factory=dict)
    details: frozenset[str] = frozenset()  # folded away
    last: frozenset[str] = frozenset()  # at the end of a form
    long: frozenset[str] = frozenset()  # on several lines
    spaced: frozenset[str] = frozenset()  # lists of names that may contain spaces
    angles: frozenset[str] = frozenset()  # shown in degrees

    def label(self, called: str) -> Any:
        return _of(self.labels, called, called.rpartition(".")[2])

    def hint(self, called: str) -> Any:
        return _of(self.hints, called, "")

    def item(self, called: str) -> Any:
        return _of(self.items, called, self.label(called))

    def added(self, called: str) -> list[tuple[str, Any]]:
        """Return the kinds of parts that can be added to a list, with labels; none for most."""
        return list(self.kinds.get(called, {}).items())

    def word(self, called: str, value: str) -> Any:
        return _of(self.choices, called, {}).get(value, value)

    def is_hidden(self, cls: type[Any], key: str) -> bool:
        return any(key in self.hidden.get(base, ()) for base in cls.__mro__)

    def left_out(self, cls: type[Any], has: Callable[[str], Any]) -> frozenset[str]:
        """Return the fields that a part lacks; `has` tells whether it has another one."""
        instead = self.instead.get(cls, {})
        return frozenset().union(*(others for key, others in instead.items() if has(key)))


def is_among(names: frozenset[str], called: str) -> bool:
    return called in names or called.rpartition(".")[2] in names


def _of(words: Mapping[str, Any], called: str, otherwise: Any) -> Any:
    return words.get(called, words.get(called.rpartition(".")[2], otherwise))


def word_table(module: str, name: str) -> list[dict[str, str]]:
    """Return the rows of a table beside a module (its file). Columns called `words`, `label`,
    `item` and `hint` have texts of pages, which deploy/messages.sh brings into the catalogue.
    """
    with Path(module).with_name(name).open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def column_of(
    table: Iterable[Mapping[str, str]], name: str, translate: Callable[[str], Any]
) -> dict[str, Any]:
    """Return the texts in a column by the first column, without the empty ones."""
    return {next(iter(row.values())): translate(row[name]) for row in table if row[name]}


def words_by_kind(
    module: str, name: str, translate: Callable[[str], Any]
) -> dict[str, dict[str, Any]]:
    """Return the texts of a table beside a module by its first column, then its second one."""
    found: dict[str, dict[str, Any]] = {}
    for row in word_table(module, name):
        kind, key, words = row.values()
        found.setdefault(kind, {})[key] = translate(words)
    return found
