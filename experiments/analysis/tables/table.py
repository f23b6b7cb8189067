"""A table of a report: cells with their text, their number and the sessions behind it."""

import math
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass

from experiments.dataset.records import Dataset, SessionRecord
from robots.files.csv_text import csv_text

NOTHING = "–"


@dataclass(frozen=True)
class TableCell:
    """Text, the number that it shows (None for words), and the sessions behind the number."""

    text: str
    value: float | None = None
    sessions: tuple[str, ...] = ()


Row = tuple[TableCell, ...]
Cells = tuple[object, ...]  # of a row, for Table.of


@dataclass(frozen=True)
class Table:
    name: str
    title: str
    head: tuple[str, ...]
    rows: tuple[Row, ...]
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if any(len(row) != len(self.head) for row in self.rows):
            raise ValueError(f"{self.name}: every row needs {len(self.head)} cells")

    @classmethod
    def of(
        cls,
        name: str,
        title: str,
        head: Iterable[str],
        rows: Iterable[Iterable[object]],
        notes: Iterable[str] = (),
    ) -> "Table":
        """Return a table; texts in its rows become `words`, whole numbers `count`; other values but
        cells raise a TypeError.
        """
        cells = tuple(tuple(map(_cell, row)) for row in rows)
        return cls(name, title, tuple(head), cells, tuple(notes))

    @property
    def are_numeric(self) -> list[bool]:
        """Tell of each column whether it has numbers."""
        values = ([row[at].value for row in self.rows] for at in range(len(self.head)))
        return [any(value is not None for value in column) for column in values]


class SessionSets:
    """Sets of sessions, each stored once; `number` is its index in `list(sets)`, None if empty."""

    def __init__(self) -> None:
        self._numbers: dict[tuple[str, ...], int] = {}

    def __iter__(self) -> Iterator[tuple[str, ...]]:
        return iter(self._numbers)

    def number(self, sessions: Iterable[str]) -> int | None:
        key = tuple(dict.fromkeys(sessions))
        return self._numbers.setdefault(key, len(self._numbers)) if key else None


def words(text: str, sessions: Iterable[str] = ()) -> TableCell:
    return TableCell(text, None, tuple(sessions))


def number(value: float | None, decimals: int = 2, sessions: Iterable[str] = ()) -> TableCell:
    """Return a cell of a number; a dash where it is unknown."""
    if value is None or not math.isfinite(value):
        return words(NOTHING, sessions)
    text = f"{value:.{decimals}f}"
    text = text.removeprefix("-") if float(text) == 0.0 else text.replace("-", "−")
    return TableCell(text, float(value), tuple(sessions))


def count(value: int, sessions: Iterable[str] = ()) -> TableCell:
    return TableCell(str(value), float(value), tuple(sessions))


def session_count(sessions: Collection[str]) -> TableCell:
    return count(len(sessions), sessions)


def people_count(dataset: Dataset, participants: Collection[str]) -> TableCell:
    """Return the number of some participants, with all of their sessions behind it."""
    return count(len(participants), dataset.sessions_of(participants))


def people_in(sessions: Sequence[SessionRecord]) -> TableCell:
    """Return the number of the participants of some sessions, which are behind it."""
    ids = [one.id for one in sessions]
    return count(len({one.participant for one in sessions}), ids)


def percent_of(some: Collection[str], every: Collection[str]) -> TableCell:
    """Return the percentage of some sessions among all; a dash without any."""
    return number(100.0 * len(some) / len(every) if every else None, 1, some)


def probability(value: float) -> TableCell:
    return TableCell("<0.001", value) if value < 0.001 else number(value, 3)


def _cell(entry: object) -> TableCell:
    if isinstance(entry, str):
        return words(entry)
    if isinstance(entry, int):
        return count(entry)
    if not isinstance(entry, TableCell):
        raise TypeError(f"{entry!r} is no cell")
    return entry


def amount(value: int, noun: str) -> str:
    """Return a number with its noun: `1 session`, `2 sessions`."""
    return f"{value} {noun}" if value == 1 else f"{value} {noun}s"


def spoken(key: str) -> str:
    """Return a key of the data as a reader reads it: `timed_out` is "timed out"."""
    return key.replace("_", " ")


def as_csv(table: Table) -> str:
    """Return a table as CSV with all digits of its numbers; none of its cells is a formula."""
    return csv_text([table.head, *(map(_exact, row) for row in table.rows)])


def _exact(cell: TableCell) -> str | float:
    if cell.value is None:
        return "" if cell.text == NOTHING else cell.text
    return int(cell.value) if cell.value.is_integer() and "." not in cell.text else cell.value
