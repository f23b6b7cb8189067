"""What the numbers of a session and of a segment are called, with unit and meaning: metrics.csv.

VERSION changes with any definition, so that numbers of two releases are not mixed.

A session that was cut short drove less, collided less and took less time than one that completed
the task, so it is never averaged with others as if it had. The column `compared` names the
alternative: `proportions` are tested as such; in place of `counts`, and of other amounts that grow
with the time driven (`per minute`), comparisons take rates per minute; `times` are at least as long
as the session if they never came; amounts of the whole task are those of `completed` ones.
"""

import csv
from collections.abc import Mapping
from pathlib import Path
from typing import Literal, get_args

from experiments.dataset.columns import Column, amount_of, flag, share

VERSION = 6
MetricKind = Literal["proportions", "counts", "times"]
with Path(__file__).with_name("metrics.csv").open(encoding="utf-8", newline="") as _file:
    _ROWS = tuple(csv.DictReader(_file))


def _column(row: Mapping[str, str]) -> Column:
    kind, name, unit, meaning = (row[key] for key in ("kind", "name", "unit", "meaning"))
    if kind in {"flag", "share"}:
        return (flag if kind == "flag" else share)(name, meaning)
    return amount_of(name, unit, meaning) if kind == "amount" else Column(name, unit, meaning)


def _compared(*how: str) -> frozenset[str]:
    return frozenset(row["name"] for row in _ROWS if row["compared"] in how)


METRICS = tuple(map(_column, _ROWS))
GROUPS = {row["name"]: row["group"] for row in _ROWS}  # of what researchers choose from
SEGMENT_METRICS = (
    Column("seconds", "s", "time that it took"),
    *(_column(row) for row in _ROWS if row["in_segments"] == "yes"),
)
PER_MINUTE = _compared("counts", "per minute")
CENSORED = _compared("times")
OF_COMPLETED = _compared("completed")
KINDS: Mapping[str, MetricKind] = {
    name: kind for kind in get_args(MetricKind) for name in _compared(kind)
}


def unfit_for(test: str, measure: str) -> str:
    """Return which tests a measure has instead of one that does not fit it; nothing if it fits."""
    kind = KINDS.get(measure)
    fitting = [] if kind == "proportions" else ["means", "ranks", "mixed"]
    fitting += [] if kind is None else [kind]
    return "" if test in fitting else ", ".join(fitting)


def label_of(name: str) -> str:
    """Return what a metric is called in comparisons: a rate, or of completed sessions alone."""
    if name in PER_MINUTE:
        return f"{name} per min"
    return f"{name} (completed)" if name in OF_COMPLETED else name
