"""A report as a page needs it: what is printed in each cell, and the sessions behind it by the
number of their set. Files name conditions by their keys, pages by their titles.

<selection>/page/summary.json        tables without their rows, figures with what is behind each
part, verdicts, sessions <selection>/page/sets.json           sets of sessions, by number
<selection>/page/table-<name>.json   rows of a table: [text, number of the set or null] a cell
"""

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from experiments.analysis.tables.table import Table

if TYPE_CHECKING:  # it draws with matplotlib, which whoever only reads a page does not need
    from experiments.analysis.report import Report

PAGE = "page"
LAYOUT = 7  # of these files; a report whose page has another one is made again
OF_CONDITIONS = frozenset({"Condition", "condition"})  # columns that hold keys of conditions
REMARKS = "Remark"  # the column whose parts begin with a key, and a colon


def write_page(found: "Report", folder: Path) -> None:
    """Write what the page needs of a report into its folder."""
    sets: dict[tuple[str, ...], int] = {}
    for name, content in _files(found, sets):
        path = folder / PAGE / f"{name}.json"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(
            json.dumps(content, ensure_ascii=False, separators=(",", ":")),
            encoding="utf-8",
            newline="",
        )


def _files(found: "Report", sets: dict[tuple[str, ...], int]) -> Iterator[tuple[str, Any]]:
    def place(sessions: tuple[str, ...]) -> int | None:
        return sets.setdefault(tuple(dict.fromkeys(sessions)), len(sets)) if sessions else None

    for table in found.tables:
        yield (
            f"table-{table.name}",
            [
                [
                    (_shown(head, cell.text, found.titles), at)
                    for head, cell, at in zip(
                        table.head, row, [place(cell.sessions) for cell in row], strict=True
                    )
                ]
                for row in table.rows
            ],
        )
    figures = [
        {
            "name": one.name,
            "title": one.title,
            "notes": one.numbers.notes,
            "empty": is_empty(one.numbers),
            "behind": {gid: place(ids) for gid, ids in one.behind.items()},
        }
        for one in found.figures
    ]
    yield (
        "summary",
        {
            "tables": [_head(table, found.titles) for table in found.tables],
            "figures": figures,
            "sessions": _sessions(found),
        },
    )
    yield "sets", list(sets)


def is_empty(table: Table) -> bool:
    """Tell whether a table says nothing: it has no rows, or is one of numbers without a number in
    it that is known and not 0.
    """
    cells = [cell for row in table.rows for cell in row]
    is_of_numbers = any(cell.value is not None for cell in cells)
    return not cells or (is_of_numbers and not any(cell.value or cell.sessions for cell in cells))


def _head(table: Table, titles: Mapping[str, str]) -> dict[str, Any]:
    return {
        "name": table.name,
        "title": _title(table, titles),
        "head": [_column(name, titles) for name in table.head],
        "notes": table.notes,
        "rows": len(table.rows),
        "empty": is_empty(table),
    }


def _shown(head: str, text: str, titles: Mapping[str, str]) -> str:
    """Return the text of a cell with the titles of the conditions that it names."""
    if head == REMARKS:
        return "; ".join(_column(part, titles) for part in text.split("; "))
    return _named(text, titles) if head in OF_CONDITIONS else text


def _named(text: str, titles: Mapping[str, str]) -> str:
    """Return the title of a condition, or those of several in their order, for its key or their
    keys with hyphens between; other text as it is.
    """
    keys = text.split("-")
    return " → ".join(titles[key] for key in keys) if all(key in titles for key in keys) else text


def _column(name: str, titles: Mapping[str, str]) -> str:
    """Return the head of a column, such as `slow: mean`."""
    key, colon, what = name.partition(": ")
    return f"{_named(key, titles)}{colon}{what}" if colon else name


def _title(table: Table, titles: Mapping[str, str]) -> str:
    """Return a table's title; a table of one condition is named for it (`table_5`)."""
    start, found, key = table.title.rstrip(".").partition(", condition ")
    return f"{start}: {_named(key, titles)}." if found else table.title


def _sessions(found: "Report") -> dict[str, dict[str, Any]]:
    """Every session by its code, with what a list of them shows."""
    return {
        one.session.id: {
            "participant": one.session.participant,
            "number": one.session.visit,
            "robot": one.session.robot,
            "condition": _named(one.session.condition, found.titles),
            "outcome": one.session.outcome,
            "kind": one.session.kind,
            "excluded": one.session.uncounted_because,
            "problems": found.verdicts[one.session.id].problems,
            "start": one.milestones.start if one.milestones.start == one.milestones.start else 0.0,
            "segments": [segment.start for segment in one.segments],
        }
        for one in (*found.measured, *found.others)
    }
