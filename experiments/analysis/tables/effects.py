"""What changes with what: conditions compared, driving against the network, and what
participants learn from visit to visit.

A participant is one point in tests of means: several sessions under one condition are averaged
first. Within-subject conditions are compared over the participants who had them all. Proportions,
counts and times have tests of their own (drive_outcomes.py). p values of one family are corrected
by Holm's method.
"""

import math
from collections.abc import Mapping, Sequence
from itertools import pairwise

import numpy as np

from experiments.analysis.metrics.definitions import label_of
from experiments.analysis.metrics.sessions import Measured
from experiments.analysis.statistics.comparisons import correlation, holm
from experiments.analysis.statistics.descriptive import spread, wilson
from experiments.analysis.tables.comparisons import (
    READ_AS,
    TESTED,
    Comparison,
    comparison_table,
    family,
    tested,
)
from experiments.analysis.tables.drive_outcomes import (
    CENSORED_AT_END,
    RATES,
    UNMOVED,
    comparable,
    metric_test,
    values_by_participant,
)
from experiments.analysis.tables.table import Table, TableCell, count, number, words
from experiments.dataset.counting import visits_of
from experiments.dataset.levels import WAYS
from experiments.dataset.records import COMPLETED, Dataset

OUTCOMES = (
    "completed",
    "task_time",
    "time_to_motion",
    "docking_time",
    "path",
    "efficiency",
    "speed",
    "stops",
    "collisions",
    "near_seconds",
)
CAUSES = ("round_trip", "loss", "command_age", "frame_age", "fps")
BINS: Mapping[str, tuple[float, ...]] = {
    "round_trip": (0.05, 0.1, 0.2, 0.4),
    "loss": (0.001, 0.01, 0.05),
    "command_age": (0.05, 0.1, 0.2, 0.4),
    "frame_age": (0.1, 0.2, 0.4, 1.0),
    "fps": (5.0, 10.0, 15.0, 25.0),
}
MEDIANS = ("task_time", "efficiency", "speed", "stops", "near_seconds", "collisions")
LEARNT = ("completed", *MEDIANS)
MOST_VISITS = 6  # of a participant have a row of their own


def compare_conditions(
    dataset: Dataset, measured: Sequence[Measured], names: Sequence[str] = OUTCOMES
) -> Table:
    """Return every metric by condition, with a test of the difference."""
    keys = _conditions(dataset, measured)
    sides = {key: [one for one in measured if one.session.condition == key] for key in keys}
    found = _tested(names, sides, is_paired=dataset.study.allocation.design == "within")
    notes = (
        "A participant's sessions under a condition are averaged first.",
        CENSORED_AT_END,
        UNMOVED,
        RATES,
    )
    return comparison_table("conditions", "Metrics by condition.", "Metric", keys, found, notes)


def _tested(
    names: Sequence[str], sides: Mapping[str, Sequence[Measured]], *, is_paired: bool
) -> list[Comparison]:
    """Return each metric compared between sides of sessions."""
    return [(label_of(name), *metric_test(name, sides, is_paired=is_paired)) for name in names]


def _conditions(dataset: Dataset, measured: Sequence[Measured]) -> list[str]:
    present = {one.session.condition for one in measured}
    return [one.key for one in dataset.study.conditions if one.key in present] + sorted(
        present - {one.key for one in dataset.study.conditions} - {""}
    )


def outcomes_by_condition(dataset: Dataset, measured: Sequence[Measured]) -> Table:
    """Return how the sessions of each condition ended, the share of completed ones, and its
    interval.
    """
    outcomes = sorted(
        {one.session.outcome for one in measured}, key=lambda word: (word != COMPLETED, word)
    )
    rows = []
    for key in [*_conditions(dataset, measured), None]:
        own = [one.session for one in measured if key in {None, one.session.condition}]
        done = [one.id for one in own if one.outcome == COMPLETED]
        bounds = wilson(len(done), len(own)) or (None, None)
        cells = [
            count(len(ids), ids)
            for word in outcomes
            if (ids := [one.id for one in own if one.outcome == word]) is not None
        ]
        people = count(len({one.participant for one in own}), [one.id for one in own])
        share = number(100.0 * len(done) / len(own) if own else None, 1, done)
        limits = (number(None if bound is None else 100.0 * bound, 1) for bound in bounds)
        rows.append(
            (
                words(key or "all"),
                people,
                count(len(own), [one.id for one in own]),
                *cells,
                share,
                *limits,
            )
        )
    head = (
        "Condition",
        "Participants",
        "Sessions",
        *(word or "not ended" for word in outcomes),
        "% completed",
        "from",
        "to",
    )
    return Table(
        "outcomes",
        "Outcomes.",
        head,
        tuple(rows),
        ("from, to: 95 % interval of the share (Wilson), sessions taken as independent.", UNMOVED),
    )


def against_network(measured: Sequence[Measured], names: Sequence[str] = OUTCOMES) -> Table:
    """Return the rank correlation of driving with the network, a participant one point."""
    pairs = [(cause, name) for cause in CAUSES for name in names]
    tests, members = [], []
    for cause, name in pairs:
        first, second = (
            values_by_participant(measured, cause),
            values_by_participant(measured, name),
        )
        shared = sorted(set(first) & set(second))
        x, y = ([one[who] for who in shared] for one in (first, second))
        tests.append(correlation(np.array(x), np.array(y)))
        members.append((tuple(x), tuple(y)))
    corrected = holm([test.p for test in tests], members)
    kept = [place for place, head in enumerate(TESTED) if not head.startswith("Difference")]
    rows = []
    for (cause, name), test, p in zip(pairs, tests, corrected, strict=True):
        cells = tested(test, p)
        rows.append((words(cause), words(label_of(name)), *(cells[place] for place in kept)))
    different = len({one for one, test in zip(members, tests, strict=True) if test.is_known})
    below = (
        "Spearman's rank correlation over participants, whose sessions are averaged first.",
        family(different),
        READ_AS[0],
    )
    return Table(
        "network-effects",
        "Driving against the network.",
        ("Of the network", "Of the driving", *(TESTED[place] for place in kept)),
        tuple(rows),
        below,
    )


def by_network(measured: Sequence[Measured]) -> Table:
    """Return outcome and driving in classes of delay, loss, command age and the like, and by the
    way that most commands took.
    """
    rows = [row for cause in CAUSES for row in _classes(measured, cause)]
    mostly = {way: [one for one in measured if one.values[f"share_{way}"] > 0.5] for way in WAYS}
    rows += [_class_row("control way", way, own) for way, own in mostly.items()]
    head = (
        "Of the network",
        "Class",
        "Participants",
        "Sessions",
        "% completed",
        *(f"{label_of(name)}, median" for name in MEDIANS),
    )
    return Table("network-classes", "Outcome and driving by class of network.", head, tuple(rows))


def _classes(measured: Sequence[Measured], cause: str) -> list[tuple[TableCell, ...]]:
    edges = (-math.inf, *BINS[cause], math.inf)
    rows = []
    for low, high in pairwise(edges):
        label = (
            f"< {high:g}"
            if low == -math.inf
            else f"≥ {low:g}"
            if high == math.inf
            else f"{low:g} – {high:g}"
        )
        rows.append(
            _class_row(cause, label, [one for one in measured if low <= one.values[cause] < high])
        )
    return rows


def _class_row(head: str, label: str, own: Sequence[Measured]) -> tuple[TableCell, ...]:
    ids = [one.session.id for one in own]
    done = [one.session.id for one in own if one.session.outcome == COMPLETED]
    medians = (
        number(spread([comparable(one, name) for one in own]).median, 3, ids) for name in MEDIANS
    )
    share = number(100.0 * len(done) / len(ids) if ids else None, 1, done)
    return (
        words(head),
        words(label),
        count(len({one.session.participant for one in own}), ids),
        count(len(ids), ids),
        share,
        *medians,
    )


def learning(measured: Sequence[Measured]) -> Table:
    """Return metrics by the number of a participant's visit: the learning curve."""
    visits = visits_of(one.session for one in measured)
    groups: dict[int, list[Measured]] = {}
    for one in measured:
        groups.setdefault(min(visits[one.session.id], MOST_VISITS + 1), []).append(one)
    rows = tuple(
        _class_row("visit", str(n) if n <= MOST_VISITS else f"≥ {n}", own)
        for n, own in sorted(groups.items())
    )
    medians = (f"{label_of(name)}, median" for name in MEDIANS)
    head = ("", "", "Participants", "Sessions", "% completed", *medians)
    return Table("learning", "Metrics by visit.", head, rows)


def learnt(measured: Sequence[Measured]) -> Table:
    """Return the test of each metric on the second against the first visits of the same
    participants, in the conditions that they drove on both.
    """
    visits = visits_of(one.session for one in measured)
    own = {
        n: {
            (one.session.participant, one.session.condition): one
            for one in measured
            if visits[one.session.id] == n
        }
        for n in (2, 1)
    }
    both = set(own[1]) & set(own[2])
    sides = {
        name: [one for key, one in own[n].items() if key in both]
        for name, n in (("second", 2), ("first", 1))
    }
    found = _tested(LEARNT, sides, is_paired=True)
    notes = (
        "Participants who came back, in the conditions that they drove on both visits.",
        "Difference: second less first visit.",
        CENSORED_AT_END,
        RATES,
    )
    title = "Second against first visit."
    return comparison_table("learning-tests", title, "Metric", tuple(sides), found, notes)
