"""The tables of docs/explanation/safety.md, the one place where hazards, safety functions and the
tests that cover them are written.
"""

import re
from dataclasses import dataclass
from pathlib import Path

from django.conf import settings

PAGE = Path("docs/explanation/safety.md")
_LINK = re.compile(r"\[([^\]]+)\]\([^)]*\)")
_TEST = re.compile(r"`(?:tests/[^`:]+::)?(test_\w+(?:\.py)?)`")
_LETTER = re.compile(r"^- ([A-Z]): ((?:.|\n(?=  ))+)", re.MULTILINE)


@dataclass(frozen=True)
class SafetyRow:
    """One row of a table, its cells as plain text, and the names of its tests: functions, or files
    whose every test counts.
    """

    cells: tuple[str, ...]
    tests: tuple[str, ...]


@dataclass(frozen=True)
class SafetyDocument:
    hazards: tuple[SafetyRow, ...]  # what fails, what stops the robot, within
    functions: tuple[SafetyRow, ...]  # rule, bound, code, figure
    parts: tuple[SafetyRow, ...]  # what fails, detected by, what the robot does, within


def read(path: Path | None = None) -> SafetyDocument:
    """Read the document of this installation. Raises OSError when it is not there, ValueError when
    it has no such tables.
    """
    return parsed((path or settings.BASE_DIR / PAGE).read_text(encoding="utf-8"))


def parsed(text: str) -> SafetyDocument:
    """Return the tables of the page's text. Raises ValueError."""
    letters = {letter: _TEST.findall(tests) for letter, tests in _LETTER.findall(text)}
    parts = tuple(
        SafetyRow(
            tuple(_plain(cell) for cell in cells[:4]),
            tuple(test for letter in cells[6].split(", ") for test in letters.get(letter, ())),
        )
        for cells in _table(text, "| What fails | Detected by |")
    )
    return SafetyDocument(
        hazards=_rows(text, "| What fails | What stops the robot |", shown=(0, 1, 2), tests=3),
        functions=_rows(text, "| Rule | Bound |", shown=(0, 1, 2, 4), tests=3),
        parts=parts,
    )


def _rows(text: str, heading: str, *, shown: tuple[int, ...], tests: int) -> tuple[SafetyRow, ...]:
    return tuple(
        SafetyRow(tuple(_plain(cells[at]) for at in shown), tuple(_TEST.findall(cells[tests])))
        for cells in _table(text, heading)
    )


def _table(text: str, heading: str) -> list[list[str]]:
    _, found, rest = text.partition(f"\n{heading}")
    if not found:
        raise ValueError(f"{PAGE} has no table that begins with {heading!r}")
    lines = rest.partition("\n\n")[0].splitlines()[2:]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]


def _plain(cell: str) -> str:
    """Return a cell without the signs of Markdown."""
    return _LINK.sub(r"\1", cell).replace("`", "").replace("**", "")
