"""What a report has found in the planted study."""

import csv
from pathlib import Path

ALPHA = 0.05


def found_in(folder: Path, table: str, alpha: float = ALPHA) -> set[tuple[str, ...]]:
    """The rows of a table whose corrected p value is significant, by their words."""
    return {
        (row[0], row[1]) if "Effect" in head[:2] else (row[0],)
        for head, row in _rows(folder, table)
        if (p := row[head.index("p (Holm)")]) and float(p) < alpha
    }


def hypotheses_in(folder: Path) -> dict[str, str]:
    """Whether each hypothesis was confirmed."""
    return {
        row[head.index("Hypothesis")]: row[head.index("Significant")]
        for head, row in _rows(folder, "hypotheses")
    }


def _rows(folder: Path, table: str) -> list[tuple[list[str], list[str]]]:
    with (folder / f"{table}.csv").open(encoding="utf-8", newline="") as file:
        head, *rows = csv.reader(file)
    return [(head, row) for row in rows]
