"""A report as a page needs it: what is printed in each cell, and the sessions behind it by the
number of their set.

<selection>/page/summary.json        tables without their rows, figures with what is behind each
part, verdicts, sessions <selection>/page/sets.json           sets of sessions, by number
<selection>/page/table-<name>.json   rows of a table: [text, number of the set or null] a cell
"""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from experiments.analysis.tables.table import Table

if TYPE_CHECKING:  # it draws with matplotlib, which whoever only reads a page does not need
    from experiments.analysis.report import Report

PAGE = "page"


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
            [[(cell.text, place(cell.sessions)) for cell in row] for row in table.rows],
        )
    figures = [
        {
            "name": one.name,
            "title": one.title,
            "notes": one.numbers.notes,
            "behind": {gid: place(ids) for gid, ids in one.behind.items()},
        }
        for one in found.figures
    ]
    yield (
        "summary",
        {
            "tables": [_head(table) for table in found.tables],
            "figures": figures,
            "sessions": _sessions(found),
        },
    )
    yield "sets", list(sets)


def _head(table: Table) -> dict[str, Any]:
    return {
        "name": table.name,
        "title": table.title,
        "head": table.head,
        "notes": table.notes,
        "rows": len(table.rows),
    }


def _sessions(found: "Report") -> dict[str, dict[str, Any]]:
    """Every session by its code, with what a list of them shows."""
    return {
        one.session.id: {
            "participant": one.session.participant,
            "number": one.session.number,
            "robot": one.session.robot,
            "condition": one.session.condition,
            "outcome": one.session.outcome,
            "kind": one.session.kind,
            "excluded": one.session.excluded,
            "problems": found.verdicts[one.session.id].problems,
            "start": one.milestones.start if one.milestones.start == one.milestones.start else 0.0,
            "segments": [segment.start for segment in one.segments],
        }
        for one in found.measured
    }
