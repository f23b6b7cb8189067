"""A report as files for a page: the text of each cell, and the number of its set of
sessions. Files name conditions by their keys, pages by their titles.

<selection>/page/summary.json        tables without their rows, figures with the sessions of each
part, verdicts, sessions <selection>/page/sets.json           sets of sessions, by number
<selection>/page/table-<name>.json   rows of a table: [text, number of the set or null] a cell
"""

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from experiments.analysis.tables.table import SessionSets, Table

if TYPE_CHECKING:  # it imports matplotlib, which readers of a page do not need
    from experiments.analysis.figures.drawing import Drawing
    from experiments.analysis.report import Report

PAGE = "page"
LAYOUT = 7  # of these files; a report whose page has another one is made again
OF_CONDITIONS = frozenset({"Condition", "condition"})  # columns that hold keys of conditions
REMARKS = "Remark"  # the column whose parts begin with a key, and a colon


def write_page(found: "Report", folder: Path) -> None:
    for name, content in _files(found, SessionSets()):
        path = folder / PAGE / f"{name}.json"
        path.parent.mkdir(parents=True, exist_ok=True)
        text = json.dumps(content, ensure_ascii=False, separators=(",", ":"))
        path.write_text(text, encoding="utf-8", newline="")


def _files(found: "Report", sets: SessionSets) -> Iterator[tuple[str, Any]]:
    for table in found.tables:
        rows = [
            [
                (_shown(head, cell.text, found.titles), sets.number(cell.sessions))
                for head, cell in zip(table.head, row, strict=True)
            ]
            for row in table.rows
        ]
        yield f"table-{table.name}", rows
    tables = [_head(table, found.titles) for table in found.tables]
    figures = [_figure(one, sets) for one in found.figures]
    yield "summary", {"tables": tables, "figures": figures, "sessions": _sessions(found)}
    yield "sets", list(sets)


def _figure(one: "Drawing", sets: SessionSets) -> dict[str, Any]:
    return {
        "name": one.name,
        "title": one.title,
        "notes": one.numbers.notes,
        "empty": is_empty(one.numbers),
        "behind": {gid: sets.number(ids) for gid, ids in one.behind.items()},
    }


def is_empty(table: Table) -> bool:
    """Tell whether a table has no rows, or numbers of which none is known and not 0."""
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
    """Return the titles of conditions for their keys, with hyphens between; other text as it is."""
    keys = text.split("-")
    return " → ".join(titles[key] for key in keys) if all(key in titles for key in keys) else text


def _column(name: str, titles: Mapping[str, str]) -> str:
    """Return the head of a column, such as `slow: mean`."""
    key, colon, what = name.partition(": ")
    return f"{_named(key, titles)}{colon}{what}" if colon else name


def _title(table: Table, titles: Mapping[str, str]) -> str:
    """Return a table's title, in which a condition may be named (`table_5`)."""
    start, found, key = table.title.rstrip(".").partition(", condition ")
    return f"{start}: {_named(key, titles)}." if found else table.title


def _sessions(found: "Report") -> dict[str, dict[str, Any]]:
    return {
        one.session.id: {
            "participant": one.session.participant,
            "number": one.session.visit,
            "robot": one.session.robot,
            "condition": _named(one.session.condition, found.titles),
            "outcome": one.session.outcome,
            "kind": one.session.kind,
            "excluded": one.session.uncounted_because,
            "problems": list(found.problems[one.session.id].items()),
            "start": one.milestones.start if one.milestones.start == one.milestones.start else 0.0,
            "segments": [segment.start for segment in one.segments],
        }
        for one in (*found.measured, *found.others)
    }
