"""Differences between conditions, driving against the network, and what participants learn from
visit to visit.

A participant is one point in tests of means: several sessions under one condition are averaged
first. Within-subject conditions are compared over the participants who had them all. Proportions,
counts and times have tests of their own (drive_outcomes.py). p values of one family are corrected
by Holm's method.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from itertools import pairwise, product

import numpy as np

from experiments.analysis.metrics.definitions import label_of
from experiments.analysis.metrics.sessions import Measured
from experiments.analysis.statistics.comparisons import correlation
from experiments.analysis.statistics.descriptive import spread, wilson
from experiments.analysis.tables import drive_outcomes
from experiments.analysis.tables.comparisons import (
    READ_AS,
    TESTED,
    Compared,
    ComparedSide,
    comparison_table,
    corrected_for,
    family,
    tested,
)
from experiments.analysis.tables.table import (
    Cells,
    Table,
    number,
    people_in,
    percent_of,
    session_count,
    spoken,
)
from experiments.dataset.counting import visits_of
from experiments.dataset.grouping import by_key
from experiments.dataset.levels import WAYS
from experiments.dataset.records import COMPLETED, Dataset
from experiments.definition.factors import SideLayout, layout_of

OUTCOMES = (
    *("completed", "task_time", "time_to_motion", "docking_time", "path", "efficiency", "speed"),
    *("stops", "collisions", "near_seconds"),
)
# The metrics of the network, each with the bounds of its classes.
CAUSES: Mapping[str, tuple[float, ...]] = {
    "round_trip": (0.05, 0.1, 0.2, 0.4),
    "loss": (0.001, 0.01, 0.05),
    "command_age": (0.05, 0.1, 0.2, 0.4),
    "frame_age": (0.1, 0.2, 0.4, 1.0),
    "fps": (5.0, 10.0, 15.0, 25.0),
}
MEDIANS = ("task_time", "efficiency", "speed", "stops", "near_seconds", "collisions")
OF_CLASS = (
    *("Participants", "Sessions", "% completed"),
    *(f"{label_of(name)}, median" for name in MEDIANS),
)
LEARNT = ("completed", *MEDIANS)
MOST_VISITS = 6  # of a participant have a row of their own


def compare_conditions(
    dataset: Dataset, measured: Sequence[Measured], names: Sequence[str] = OUTCOMES
) -> Table:
    keys = _conditions(dataset, measured)
    sides = {key: [one for one in measured if one.session.condition == key] for key in keys}
    found = _tested(names, sides, layout_of(dataset.study, [{key} for key in keys]))
    averaged = "A participant's sessions under a condition are averaged first."
    about = (drive_outcomes.FIRST, drive_outcomes.CENSORED_AT_END, drive_outcomes.UNMOVED)
    notes = (averaged, *about, drive_outcomes.RATES)
    return comparison_table("conditions", "Metrics by condition.", "Metric", keys, found, notes)


def _tested(
    names: Sequence[str], sides: Mapping[str, Sequence[Measured]], layout: SideLayout
) -> list[tuple[str, Compared]]:
    test = partial(drive_outcomes.metric_test, sides=sides, layout=layout)
    return [(label_of(name), test(name)) for name in names]


def _conditions(dataset: Dataset, measured: Sequence[Measured]) -> list[str]:
    """Return the conditions that have sessions: those of the study in its order, then others."""
    present = {one.session.condition for one in measured} - {""}
    planned = [one.key for one in dataset.study.conditions if one.key in present]
    return planned + sorted(present - set(planned))


def outcomes_by_condition(dataset: Dataset, measured: Sequence[Measured]) -> Table:
    """Return how the sessions of each condition ended, with the share of completed ones."""
    sessions = [one.session for one in measured]
    outcomes = sorted({one.outcome for one in sessions}, key=lambda one: (one != COMPLETED, one))
    rows = []
    for key in (*_conditions(dataset, measured), None):
        own = [one for one in sessions if key in {None, one.condition}]
        ids = [one.id for one in own]
        ended = {name: [one.id for one in own if one.outcome == name] for name in outcomes}
        done = ended.get(COMPLETED, [])
        bounds = wilson(len(done), len(own)) or (math.nan, math.nan)
        cells = (people_in(own), session_count(ids))
        share = (percent_of(done, ids), *(number(100.0 * bound, 1) for bound in bounds))
        rows.append((key or "all", *cells, *share, *map(session_count, ended.values())))
    named = (spoken(name) or "not ended" for name in outcomes)
    head = ("Condition", "Participants", "Sessions", "% completed", "from", "to", *named)
    note = "from, to: 95 % interval of the share (Wilson), sessions taken as independent."
    return Table.of("outcomes", "Outcomes.", head, rows, (note, drive_outcomes.UNMOVED))


def against_network(measured: Sequence[Measured]) -> Table:
    """Return rank correlations of driving with the network, a participant one point."""
    pairs, found = list(product(CAUSES, OUTCOMES)), list[Compared]()
    for pair in pairs:
        first, second = (drive_outcomes.mean_side(measured, name).values for name in pair)
        shared = sorted(set(first) & set(second))
        sides = [ComparedSide({who: one[who] for who in shared}) for one in (first, second)]
        x, y = (np.array([*one.values.values()]) for one in sides)
        found.append((correlation(x, y), sides))
    corrected, members = corrected_for(found)
    printed = [at for at, head in enumerate(TESTED) if not head.startswith("Difference")]
    rows = []
    for (cause, name), (test, _), p in zip(pairs, found, corrected, strict=True):
        cells = tested(test, p)
        rows.append((cause, label_of(name), *(cells[at] for at in printed)))
    averaged = "Spearman's rank correlation over participants, whose sessions are averaged first."
    head = ("Of the network", "Of the driving", *(TESTED[at] for at in printed))
    notes = (averaged, family(members), READ_AS[0])
    return Table.of("network-effects", "Driving against the network.", head, rows, notes)


def by_network(measured: Sequence[Measured]) -> Table:
    """Return driving in classes of delay, loss and the like, and by the channel of commands."""
    rows = [row for cause in CAUSES for row in _classes(measured, cause)]
    for channel in WAYS:
        mostly = [one for one in measured if one.values[f"share_{channel}"] > 0.5]
        rows.append(_class_row("control way", channel, mostly))
    title = "Outcome and driving by class of network."
    return Table.of("network-classes", title, ("Of the network", "Class", *OF_CLASS), rows)


def _classes(measured: Sequence[Measured], cause: str) -> Iterator[Cells]:
    for low, high in pairwise((-math.inf, *CAUSES[cause], math.inf)):
        label = f"{low:g} – {high:g}"
        if low == -math.inf:
            label = f"< {high:g}"
        elif high == math.inf:
            label = f"≥ {low:g}"
        yield _class_row(cause, label, [one for one in measured if low <= one.values[cause] < high])


def _class_row(head: str, label: str, own: Sequence[Measured]) -> Cells:
    sessions = [one.session for one in own]
    ids = [one.id for one in sessions]
    done = [one.id for one in sessions if one.outcome == COMPLETED]
    medians = (
        number(spread([drive_outcomes.comparable(one, name) for one in own]).median, 3, ids)
        for name in MEDIANS
    )
    return head, label, people_in(sessions), session_count(ids), percent_of(done, ids), *medians


def learning(measured: Sequence[Measured]) -> Table:
    visits = visits_of(one.session for one in measured)
    groups = by_key((min(visits[one.session.id], MOST_VISITS + 1), one) for one in measured)
    rows = (
        _class_row("visit", str(n) if n <= MOST_VISITS else f"≥ {n}", own)
        for n, own in sorted(groups.items())
    )
    return Table.of("learning", "Metrics by visit.", ("", "", *OF_CLASS), rows)


def learnt(dataset: Dataset, measured: Sequence[Measured]) -> Table:
    """Return tests of the second against the first visits, in conditions driven on both."""
    visits = visits_of(one.session for one in measured)
    own: dict[int, dict[tuple[str, str], Measured]] = {}
    for one in measured:
        key = (one.session.participant, one.session.condition)
        own.setdefault(visits[one.session.id], {})[key] = one
    first, second = own.get(1, {}), own.get(2, {})
    sides = {
        "second": [one for key, one in second.items() if key in first],
        "first": [one for key, one in first.items() if key in second],
    }
    conditions = [one.key for one in dataset.study.conditions]
    is_single = layout_of(dataset.study, [conditions]).is_single
    found = _tested(LEARNT, sides, SideLayout(is_paired=True, is_single=is_single))
    who = "Participants who came back, in the conditions that they drove on both visits."
    less = "Difference: second less first visit."
    notes = (who, less, drive_outcomes.CENSORED_AT_END, drive_outcomes.RATES)
    title = "Second against first visit."
    return comparison_table("learning-tests", title, "Metric", tuple(sides), found, notes)
