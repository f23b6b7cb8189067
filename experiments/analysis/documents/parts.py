"""Tables that fit on a page: a wide one is printed as several, each of which begins with the
columns by which its rows are told apart.
"""

from collections.abc import Iterator
from dataclasses import replace

from experiments.analysis.tables.table import Table

MOST_COLUMNS = 10
MOST_KEYS = 4  # columns that are repeated


def parts_of(table: Table) -> tuple[Table, ...]:
    """Return a table in parts of at most MOST_COLUMNS columns; notes stand below the last one."""
    if len(table.head) <= MOST_COLUMNS:
        return (table,)
    keys = _keys(table)
    groups = list(_groups(table.head, len(keys)))
    return tuple(
        replace(
            _selected(table, (*keys, *group)),
            name=f"{table.name}-{number}",
            title=f"{table.title.removesuffix('.')} (part {number} of {len(groups)}).",
            notes=table.notes if number == len(groups) else (),
        )
        for number, group in enumerate(groups, start=1)
    )


def _keys(table: Table) -> tuple[int, ...]:
    """Return the places of the columns that name a row: the first ones that hold words alone, and
    the first one always.
    """
    count = 1
    while count < MOST_KEYS and all(row[count].value is None for row in table.rows):
        count += 1
    return tuple(range(count))


def _groups(head: tuple[str, ...], first: int) -> Iterator[tuple[int, ...]]:
    """Yield the places of the other columns, as many as fit. Those of one subject (`slow: n`,
    `slow: mean`) stay together where they can.
    """
    room, group = MOST_COLUMNS - first, list[int]()
    for subject in _subjects(head, first):
        if group and len(group) + len(subject) > room:
            yield tuple(group)
            group = []
        group += subject
        while len(group) > room:
            yield tuple(group[:room])
            group = group[room:]
    if group:
        yield tuple(group)


def _subjects(head: tuple[str, ...], first: int) -> list[list[int]]:
    found: list[list[int]] = []
    for place in range(first, len(head)):
        same = found and _subject(head[place]) == _subject(head[found[-1][-1]])
        if same:
            found[-1].append(place)
        else:
            found.append([place])
    return found


def _subject(name: str) -> str:
    return name.partition(":")[0]


def _selected(table: Table, places: tuple[int, ...]) -> Table:
    return replace(
        table,
        head=tuple(table.head[place] for place in places),
        rows=tuple(tuple(row[place] for place in places) for row in table.rows),
    )
