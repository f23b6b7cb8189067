"""Tables that fit on a page: a wide one is printed as several, each of which begins with the
columns by which its rows are told apart.
"""

from dataclasses import replace
from itertools import groupby

from experiments.analysis.tables.table import Table

MOST_COLUMNS = 10
MOST_KEYS = 4  # columns that are repeated


def parts_of(table: Table) -> tuple[Table, ...]:
    """Return a table in parts of at most MOST_COLUMNS columns; notes are below the last one."""
    if len(table.head) <= MOST_COLUMNS:
        return (table,)
    keys = _keys(table)
    groups = _groups(table.head, keys)
    return tuple(
        replace(
            table,
            name=f"{table.name}-{number}",
            title=f"{table.title.removesuffix('.')} (part {number} of {len(groups)}).",
            head=tuple(table.head[place] for place in (*range(keys), *group)),
            rows=tuple(tuple(row[place] for place in (*range(keys), *group)) for row in table.rows),
            notes=table.notes if number == len(groups) else (),
        )
        for number, group in enumerate(groups, start=1)
    )


def _keys(table: Table) -> int:
    """Return how many columns name a row: the first ones that have words alone, at least one."""
    count = 1
    while count < MOST_KEYS and all(row[count].value is None for row in table.rows):
        count += 1
    return count


def _groups(head: tuple[str, ...], keys: int) -> list[list[int]]:
    """Return the places of the other columns, as many as fit in each part. Those of one subject
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
