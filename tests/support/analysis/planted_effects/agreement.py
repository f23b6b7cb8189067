"""What our report says, number by number, against what R computed from the exported folder alone
(stranger.R, which shares nothing with the code of the report).
"""

import csv
import math
import os
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path

from tests.support.paths import ROOT

SCRIPT = ROOT / "tests" / "support" / "analysis" / "planted_effects" / "stranger.R"
PACKAGES = (
    "r-base-core r-cran-lme4 r-cran-survival r-cran-clubsandwich r-cran-jsonlite"  # of Debian
)
# How many of the first columns label a row, in each table that R computes. The other tables of the
# report are counts (participants, pages, rules) or lists of measures.
LABELS = {
    "conditions": 1,
    "answers": 1,
    "metrics": 1,
    "outcomes": 1,
    "safety-limits": 1,
    "learning-tests": 1,
    "learning": 2,
    "network-effects": 2,
    "network-classes": 2,
    "ages": 3,
    "reliability": 4,
}
PREFIXES = {"analysis-": 2, "scores-": 3, "score-tests-": 1, "table-5": 1}
NO_NUMBERS = {"Unit", "Robot", "Test", "Effect", "Remark", "Plan"}
RELATIVE, ABSOLUTE = 1e-6, 1e-9
FITTED = 1e-4  # of lme4, and of the factor model behind ω
Numbers = dict[tuple[str, str, str], float]


def by_a_stranger(dataset: Path, kind: str, out: Path) -> Numbers:
    """Let R compute, and return its numbers by table, row and column."""
    command = ["Rscript", str(SCRIPT), str(dataset), kind, str(out)]
    environment = {**os.environ, "LC_ALL": "C.UTF-8"}
    done = subprocess.run(
        command, env=environment, capture_output=True, text=True, timeout=900, check=False
    )
    assert done.returncode == 0, done.stderr
    return numbers_of(out)


def has_r() -> bool:
    return shutil.which("Rscript") is not None


def numbers_of(path: Path) -> Numbers:
    """What R has written; what it does not know is left out."""
    with path.open(encoding="utf-8", newline="") as file:
        found = {
            (row["table"], row["row"], row["column"]): float(row["value"].replace("NA", "nan"))
            for row in csv.DictReader(file)
        }
    return {key: value for key, value in found.items() if not math.isnan(value)}


def labels_of(table: str) -> int:
    """How many columns say what a row is about; 0 for a table that R does not compute."""
    return LABELS.get(table) or next(
        (n for start, n in PREFIXES.items() if table.startswith(start)), 0
    )


def by_the_report(folder: Path) -> Numbers:
    """Every number of the tables (CSV, in a folder) that R computes too."""
    found: Numbers = {}
    for path in sorted(folder.glob("*.csv")):
        labels = labels_of(path.stem)
        with path.open(encoding="utf-8", newline="") as file:
            head, *rows = csv.reader(file)
        for row in rows if labels else ():
            name = "|".join(row[:labels])
            for column, cell in zip(head[labels:], row[labels:], strict=True):
                if cell and column not in NO_NUMBERS:
                    found[path.stem, name, column] = float(cell)
    return found


def differing(ours: Numbers, theirs: Numbers) -> Iterator[str]:
    """Every number that only one of the two has, or that is another one."""
    for key in sorted(set(ours) ^ set(theirs)):
        where = "the report" if key in ours else "R"
        yield f"{' / '.join(key)}: only in {where} ({(ours | theirs)[key]!r})"
    fitted = {table for table, _row, column in ours if column in {"Observations", "SE"}}
    for key in sorted(set(ours) & set(theirs)):
        table, row, column = key
        is_fitted = table in fitted or column.startswith("ω")
        is_modelled = (table, row, "df 2") in ours
        if not _agree(ours[key], theirs[key], column, is_fitted or is_modelled):
            yield f"{' / '.join(key)}: {ours[key]!r}, R {theirs[key]!r}"


def _agree(ours: float, theirs: float, column: str, is_fitted: bool) -> bool:
    if is_fitted and column.startswith("p"):
        # so far out, a p value moves with every digit of F
        return math.isclose(ours, theirs, rel_tol=50.0 * FITTED, abs_tol=1e-15)
    if is_fitted:
        return math.isclose(ours, theirs, rel_tol=FITTED, abs_tol=FITTED)
    return math.isclose(ours, theirs, rel_tol=RELATIVE, abs_tol=ABSOLUTE)
