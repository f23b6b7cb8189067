"""Statistical symbols with italics, sub- and superscripts, and wide tables in parts for a page."""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from itertools import chain, groupby
from typing import Literal

from experiments.analysis.tables.table import Table

MOST_COLUMNS = 10
MOST_KEYS = 4  # columns that each part of a table repeats
Position = Literal["", "sub", "super"]


@dataclass(frozen=True)
class Run:
    text: str
    italic: bool = False
    position: Position = ""


# Symbols as the APA sets them: Latin in italics, Greek and subscripts that are words
# upright (Publication Manual, 7th edition, section 6.44).
SYMBOLS: dict[str, tuple[Run, ...]] = {
    "p (Holm)": (Run("p", italic=True), Run("Holm", position="sub")),
    "p (family)": (Run("p", italic=True), Run("family", position="sub")),
    "d_z": (Run("d", italic=True), Run("z", italic=True, position="sub")),
    "η²p": (Run("η"), Run("2", position="super"), Run("p", italic=True, position="sub")),
    "W (Kendall)": (Run("W", italic=True),),
    "ρ": (Run("r", italic=True), Run("s", italic=True, position="sub")),
    "ε²": (Run("ε"), Run("2", position="super")),
    "χ²": (Run("χ"), Run("2", position="super")),
    **{one: (Run(one, italic=True),) for one in ("p", "t", "F", "n", "N", "M", "SD", "SE", "d")},
    **{one: (Run(one, italic=True),) for one in ("r", "df", "Mdn", "W", "U", "H", "V", "z")},
}
# What those symbols are called as heads of columns.
_HEADS = {"mean": "M", "Mean": "M", "median": "Mdn", "Median": "Mdn", "df 2": "df"}


_MARK = "\0"  # around the name of a symbol, in texts that become runs


def symbol(name: str) -> tuple[Run, ...]:
    return SYMBOLS.get(name, (Run(name),))


def marked(name: str) -> str:
    """Return a symbol as it is written into a text for `runs_of`."""
    return f"{_MARK}{name}{_MARK}"


def runs_of(text: str) -> tuple[Run, ...]:
    parts = enumerate(text.split(_MARK))
    runs = (symbol(part) if at % 2 else (Run(part),) for at, part in parts if part)
    return tuple(chain.from_iterable(runs))


def head_runs(name: str) -> tuple[Run, ...]:
    """Return the head of a column: `slow: mean` is the mean's symbol after the condition."""
    before, colon, last = name.rpartition(": ")
    second = (Run("2", position="sub"),) if name == "df 2" else ()
    return (*runs_of(f"{before}{colon}"), *symbol(_HEADS.get(last, last)), *second)


def plain(runs: Iterable[Run]) -> str:
    """Return text without styles: `d_z`, `χ²`, `η²p`."""
    forms = {"": "{}", "sub": "_{}", "super": "²"}  # the one superscript of SYMBOLS is 2
    joined = "".join(forms[run.position].format(run.text) for run in runs)
    return joined.replace("²_p", "²p")


def parts_of(table: Table) -> tuple[Table, ...]:
    """Return a table in parts of at most MOST_COLUMNS, each with the first columns of words, which
    name the row; notes are below the last part.
    """
    if len(table.head) <= MOST_COLUMNS:
        return (table,)
    keys = 1
    while keys < MOST_KEYS and not table.are_numeric[keys]:
        keys += 1
    groups = [[*range(keys), *group] for group in _groups(table.head, keys)]
    return tuple(
        replace(
            table,
            name=f"{table.name}-{number}",
            title=f"{table.title.removesuffix('.')} (part {number} of {len(groups)}).",
            head=tuple(table.head[place] for place in group),
            rows=tuple(tuple(row[place] for place in group) for row in table.rows),
            notes=table.notes if number == len(groups) else (),
        )
        for number, group in enumerate(groups, start=1)
    )


def _groups(head: tuple[str, ...], keys: int) -> list[list[int]]:
    """Return the places of the other columns, as many as fit in each part; those of one subject
    (`slow: n`, `slow: mean`) stay together where they can.
    """
    room, groups = MOST_COLUMNS - keys, [list[int]()]
    for _subject, places in groupby(range(keys, len(head)), lambda n: head[n].partition(":")[0]):
        same = list(places)
        if groups[-1] and len(groups[-1]) + len(same) > room:
            groups.append([])
        for place in same:
            if len(groups[-1]) == room:
                groups.append([])
            groups[-1].append(place)
    return groups
