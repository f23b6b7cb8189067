"""Outcomes of drives for tests; metrics/definitions.py says how those cut short are compared."""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence

from experiments.analysis.metrics.definitions import KINDS, OF_COMPLETED, PER_MINUTE
from experiments.analysis.metrics.sessions import Measured
from experiments.analysis.statistics.conditions import compare
from experiments.analysis.statistics.regression import (
    DriveOutcome,
    Family,
    compare_drives,
    median_time,
)
from experiments.analysis.tables.comparisons import Compared, ComparedSide, participant_means
from experiments.dataset.records import COMPLETED
from experiments.definition.factors import SideLayout

CENSORED_AT_END = (
    "Times that never came are censored at the end of the session, which takes those who gave up as"
    " if they would have gone on like the others: see the table success-sensitivity. Medians are by"
    " Kaplan and Meier."
)
ONLY_KNOWN = "Times are those of sessions in which they came."
UNMOVED = (
    "In proportions and times, a participant who saw the video and never moved the robot under a"
    " condition is one who did not succeed, as in a drive that the robot, the network or an"
    " operator ended; participants who are excluded as incomplete stay in."
)
FIRST = (
    "Outcomes and comparisons of proportions and times have one drive of a participant in a"
    " condition: the first that counts, unless the study counts the last."
)
OF_SUCCESS = frozenset({"proportions", "times"})
RATES = (
    "Sessions that were cut short: counts and durations are per minute that has states;"
    f" {', '.join(sorted(OF_COMPLETED))} are those of completed sessions."
)


def sessions_of(name: str, attempts: Iterable[Measured]) -> list[Measured]:
    """Return the attempts that have a metric: of metrics of driving, only drives that count."""
    is_of_all = KINDS.get(name) in OF_SUCCESS
    return [one for one in attempts if is_of_all or one.session.counts]


def compared_of(name: str, attempts: Iterable[Measured]) -> list[Measured]:
    """Return the attempts that comparisons of conditions have: of success and times, the first of a
    participant in a condition, so that the test does not depend on who returns.
    """
    found = sessions_of(name, attempts)
    if KINDS.get(name) not in OF_SUCCESS:
        return found
    first: dict[tuple[str, str], Measured] = {}
    for one in found:
        first.setdefault((one.session.participant, one.session.condition), one)
    return [*first.values()]


def comparable(one: Measured, name: str) -> float:
    """Return a metric of a session as it may be compared with that of a longer one, or NaN."""
    value = one.values[name]
    if name in PER_MINUTE:
        minutes = _minutes(one)
        return value / minutes if minutes > 0.0 else math.nan
    if name in OF_COMPLETED and one.session.outcome != COMPLETED:
        return math.nan
    return value


def _minutes(one: Measured) -> float:
    """Return for how long events could be counted in a session: the time that has states."""
    return one.values["total_time"] * one.values["seen"] / 60.0


def mean_side(measured: Sequence[Measured], name: str) -> ComparedSide:
    known = ((one.session.participant, comparable(one, name)) for one in measured)
    values = participant_means((who, value) for who, value in known if math.isfinite(value))
    return ComparedSide(values, [one.session.id for one in measured])


def drive_side(
    measured: Sequence[Measured], family: Family, name: str
) -> tuple[list[DriveOutcome], ComparedSide]:
    """Return the outcomes of sessions, and the side to print: of times, only number and median."""
    drives = list(outcomes(measured, family, name))
    values = participant_means(
        (one.who, one.value / one.weight if family == "counts" else one.value) for one in drives
    )
    ids, is_censored = [one.session.id for one in measured], family == "times"
    median = median_time(drives) if is_censored else None
    return drives, ComparedSide(values, ids, is_censored, median)


def outcomes(measured: Sequence[Measured], family: Family, name: str) -> Iterator[DriveOutcome]:
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


def metric_test(name: str, sides: Mapping[str, Sequence[Measured]], layout: SideLayout) -> Compared:
    """Return the test of a metric between sides, by its kind of number, and the sides to print."""
    family = KINDS.get(name)
    sides = {key: compared_of(name, side) for key, side in sides.items()}
    if family is None:
        means = {key: mean_side(side, name) for key, side in sides.items()}
        values = {key: one.values for key, one in means.items()}
        return compare(values, is_paired=layout.is_paired), [*means.values()]
    found = {key: drive_side(side, family, name) for key, side in sides.items()}
    drives = {key: own for key, (own, _) in found.items()}
    return compare_drives(family, drives, **layout._asdict()), [side for _, side in found.values()]
