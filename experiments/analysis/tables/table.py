"""A table: rows of cells that know what they say, what they are worth, and which sessions they come
from. As CSV; for papers, see experiments/analysis/documents/.
"""

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from robots.files.csv_text import csv_text

NOTHING = "–"


@dataclass(frozen=True)
class TableCell:
    """What is printed, the number behind it (None for words), and the ids of the sessions behind
    that.
    """

    text: str
    value: float | None = None
    sessions: tuple[str, ...] = ()


@dataclass(frozen=True)
class Table:
    """A table with a name for its files, a title, column heads, rows of as many cells, and notes
    that are printed below.
    """

    name: str
    title: str
    head: tuple[str, ...]
    rows: tuple[tuple[TableCell, ...], ...]
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if any(len(row) != len(self.head) for row in self.rows):
            raise ValueError(f"{self.name}: every row needs {len(self.head)} cells")


class SessionSets:
    """Sets of sessions, each once, because many cells share one: `sets.number(ids)` is the place of
    one in `list(sets)`, None for no sessions.
    """

    def __init__(self) -> None:
        self._numbers: dict[tuple[str, ...], int] = {}

    def __iter__(self) -> Iterator[tuple[str, ...]]:
        return iter(self._numbers)

    def number(self, sessions: Iterable[str]) -> int | None:
        """Return the number of a set of sessions."""
        key = tuple(dict.fromkeys(sessions))
        return self._numbers.setdefault(key, len(self._numbers)) if key else None


def words(text: str, sessions: Iterable[str] = ()) -> TableCell:
    """Return a cell of words."""
    return TableCell(text, None, tuple(sessions))


def number(value: float | None, decimals: int = 2, sessions: Iterable[str] = ()) -> TableCell:
    """Return a cell of a number; a dash when there is none."""
    if value is None or not math.isfinite(value):
        return TableCell(NOTHING, None, tuple(sessions))
    text = f"{value:.{decimals}f}"
    return TableCell(
        text.removeprefix("-") if float(text) == 0.0 else text.replace("-", "−"),
        float(value),
        tuple(sessions),
    )


def count(value: int, sessions: Iterable[str] = ()) -> TableCell:
    """Return a cell of a count."""
    return TableCell(str(value), float(value), tuple(sessions))


def amount(value: int, noun: str) -> str:
    """Return how many there are of something, as one says it: `1 session`, `2 sessions`."""
    return f"{value} {noun}" if value == 1 else f"{value} {noun}s"


def spoken(key: str) -> str:
    """Return a key of the data as it is read: `timed_out` is "timed out"."""
    return key.replace("_", " ")


def probability(value: float) -> TableCell:
    """Return a cell of a p value."""
    if math.isfinite(value) and value < 0.001:
        return TableCell("<0.001", value)
    return number(value, 3)


def as_csv(table: Table) -> str:
    """Return a table as CSV with all digits of its numbers; none of its cells is a formula."""
    return csv_text([table.head, *(map(_exact, row) for row in table.rows)])


def _exact(cell: TableCell) -> str | float:
    if cell.value is None:
        return "" if cell.text == NOTHING else cell.text
    return int(cell.value) if cell.value.is_integer() and "." not in cell.text else cell.value
