"""What drives came to, as tests take it. Sessions that were cut short are never averaged with
others as if they were complete: metrics/definitions.py says what takes the place of each metric.
"""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Literal

from experiments.analysis.metrics.definitions import KINDS, OF_COMPLETED, PER_MINUTE
from experiments.analysis.metrics.sessions import Measured
from experiments.analysis.statistics.comparisons import Test
from experiments.analysis.statistics.conditions import compare
from experiments.analysis.statistics.regression import (
    DriveOutcome,
    Family,
    compare_drives,
    median_time,
)
from experiments.analysis.tables.comparisons import ComparedSide
from experiments.dataset.records import COMPLETED

MetricTest = Literal["means"] | Family
CENSORED_AT_END = (
    "Times that never came are censored at the end of the session; their medians are by Kaplan and"
    " Meier."
)
ONLY_KNOWN = "Times are those of sessions in which they came."
UNMOVED = (
    "In proportions and times, a participant who saw the video and never moved the robot under a"
    " condition is one who did not succeed."
)
RATES = (
    "Sessions that were cut short: counts and durations are per minute that has states;"
    f" {', '.join(sorted(OF_COMPLETED))} are those of completed sessions."
)


def sessions_of(name: str, attempts: Iterable[Measured]) -> list[Measured]:
    """Return those attempts (counting.attempted) that have a metric: of driving, the drives that
    count.
    """
    is_of_all = KINDS.get(name) in {"proportions", "times"}
    return [one for one in attempts if is_of_all or one.session.counts]


def comparable(one: Measured, name: str) -> float:
    """Return a metric of a session as it may be compared with that of a longer one; NaN where it
    may not.
    """
    value = one.values[name]
    if name in PER_MINUTE:
        minutes = _minutes(one)
        return value / minutes if minutes > 0.0 else math.nan
    if name in OF_COMPLETED and one.session.outcome != COMPLETED:
        return math.nan
    return value


def _minutes(one: Measured) -> float:
    """Return for how long something could be counted in a session: the time that has states."""
    return one.values["total_time"] * one.values["seen"] / 60.0


def values_by_participant(
    measured: Sequence[Measured], name: str, condition: str | None = None
) -> dict[str, float]:
    """Return the mean of a metric over each participant's sessions, of all or of one condition."""
    found: dict[str, list[float]] = {}
    for one in measured:
        if condition in {None, one.session.condition}:
            value = comparable(one, name)
            if math.isfinite(value):
                found.setdefault(one.session.participant, []).append(value)
    return {who: math.fsum(values) / len(values) for who, values in found.items()}


def outcomes(measured: Sequence[Measured], family: Family, name: str) -> Iterator[DriveOutcome]:
    """Yield what the sessions came to in a metric, as a model of a family takes it."""
    for one in measured:
        who, value, total = one.session.participant, one.values[name], one.values["total_time"]
        if family == "times" and not math.isfinite(value) and total > 0.0:
            yield DriveOutcome(who, total, 0.0)
        elif family == "counts":
            minutes = _minutes(one)
            if math.isfinite(value) and minutes > 0.0:
                yield DriveOutcome(who, value, minutes)
        elif math.isfinite(value):
            yield DriveOutcome(who, value)


def metric_test(
    name: str, sides: Mapping[str, Sequence[Measured]], *, is_paired: bool
) -> tuple[Test, list[ComparedSide]]:
    """Return the test of a metric between sides of sessions, by what kind of number it is, and what
    is printed of each side.
    """
    family = KINDS.get(name)
    sides = {key: sessions_of(name, side) for key, side in sides.items()}
    ids = [tuple(one.session.id for one in side) for side in sides.values()]
    if family is None:
        means = {key: values_by_participant(side, name) for key, side in sides.items()}
        test = compare(means, is_paired=is_paired)
        return test, [
            ComparedSide(own, these) for own, these in zip(means.values(), ids, strict=True)
        ]
    drives = {key: tuple(outcomes(side, family, name)) for key, side in sides.items()}
    test = compare_drives(family, drives)
    groups = [
        replace(group_of(family, own), sessions=these)
        for own, these in zip(drives.values(), ids, strict=True)
    ]
    return test, groups


def group_of(family: Family, drives: Sequence[DriveOutcome]) -> ComparedSide:
    """Return what is printed of the drives of a side: of times only their number and median."""
    found: dict[str, list[float]] = {}
    for one in drives:
        value = one.value / one.weight if family == "counts" else one.value
        found.setdefault(one.who, []).append(value)
    values = {who: math.fsum(own) / len(own) for who, own in found.items()}
    if family != "times":
        return ComparedSide(values)
    return ComparedSide(values, is_censored=True, median=median_time(drives))
