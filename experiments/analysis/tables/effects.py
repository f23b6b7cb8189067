"""What changes with what: conditions compared, driving against the network, and what visitors learn
from session to session.

A participant is one point in every test: several sessions under one condition are averaged first.
Within-subject conditions are compared over the participants who had them all. p values of one
family are corrected by Holm's method.
"""

import math
from collections.abc import Mapping, Sequence
from itertools import pairwise

import numpy as np

from experiments.analysis.dataset.columns import WAYS
from experiments.analysis.dataset.records import COMPLETED, Dataset, Floats
from experiments.analysis.metrics.sessions import Measured
from experiments.analysis.statistics.descriptive import (
    Test,
    between,
    correlation,
    holm,
    several_between,
    several_within,
    spread,
    wilson,
    within,
)
from experiments.analysis.tables.table import Table, TableCell, count, number, probability, words

OUTCOMES = (
    "total_time",
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
LEARNT = ("total_time", "task_time", "efficiency", "speed", "stops", "near_seconds", "collisions")
MOST_SESSIONS = 6  # of a visitor have a row of their own


def compare_conditions(
    dataset: Dataset, measured: Sequence[Measured], names: Sequence[str] = OUTCOMES
) -> Table:
    """Return every metric by condition, with a test of the difference."""
    keys = _conditions(dataset, measured)
    ids = {
        key: [one.session.id for one in measured if one.session.condition == key] for key in keys
    }
    paired = dataset.study.allocation.design == "within"
    groups = {
        name: [(_by_participant(measured, name, key), ids[key]) for key in keys] for name in names
    }
    tests = [difference([values for values, _ids in groups[name]], paired=paired) for name in names]
    corrected = holm([test.p for test in tests])
    rows = tuple(
        compared(name, groups[name], test, p)
        for name, test, p in zip(names, tests, corrected, strict=True)
    )
    below = (
        (
            "A participant's sessions under a condition are averaged first. p (Holm): corrected for"
            " the number of metrics."
        ),
    )
    return Table("conditions", "Metrics by condition.", ("Metric", *head_of(keys)), rows, below)


def head_of(keys: Sequence[str]) -> tuple[str, ...]:
    """Return the head of `compared`, without its first word."""
    return (
        *(part for key in keys for part in (f"{key}: n", f"{key}: mean", f"{key}: SD")),
        "Test",
        "Statistic",
        "p",
        "p (Holm)",
        "Effect",
    )


def compared(
    label: str,
    groups: Sequence[tuple[Mapping[str, float], Sequence[str]]],
    test: Test,
    corrected: float,
) -> tuple[TableCell, ...]:
    """Return a row: what was compared, each group (a value a participant, and the sessions behind
    them), and the test.
    """
    cells: list[TableCell] = []
    for values, ids in groups:
        about = spread(list(values.values()))
        cells += [count(about.n, ids), number(about.mean, 3, ids), number(about.sd, 3)]
    numbers = (
        number(test.statistic, 2),
        probability(test.p),
        probability(corrected),
        number(test.effect, 2),
    )
    return words(label), *cells, words(test.name), *numbers


def _conditions(dataset: Dataset, measured: Sequence[Measured]) -> list[str]:
    present = {one.session.condition for one in measured}
    return [one.key for one in dataset.study.conditions if one.key in present] + sorted(
        present - {one.key for one in dataset.study.conditions} - {""}
    )


def _by_participant(
    measured: Sequence[Measured], name: str, condition: str | None = None
) -> dict[str, float]:
    """The mean of a metric over a participant's sessions."""
    found: dict[str, list[float]] = {}
    for one in measured:
        if condition in {None, one.session.condition} and math.isfinite(one.values[name]):
            found.setdefault(one.session.participant, []).append(one.values[name])
    return {who: math.fsum(values) / len(values) for who, values in found.items()}


def difference(groups: Sequence[Mapping[str, float]], *, paired: bool) -> Test:
    """Return the test of a difference between conditions, each with a value a participant."""
    if len(groups) < 2:
        return Test("–", sum(len(group) for group in groups), math.nan, math.nan, math.nan)
    if paired:
        shared = sorted(set.intersection(*(set(group) for group in groups)))
        table = np.array(
            [[group[who] for group in groups] for who in shared], dtype=np.float64
        ).reshape(len(shared), len(groups))
        return within(table[:, 0], table[:, 1]) if len(groups) == 2 else several_within(table)
    arrays: list[Floats] = [np.array(list(group.values()), dtype=np.float64) for group in groups]
    return between(arrays[0], arrays[1]) if len(arrays) == 2 else several_between(arrays)


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
        ("from, to: 95 % interval of the share (Wilson), sessions taken as independent.",),
    )


def against_network(measured: Sequence[Measured], names: Sequence[str] = OUTCOMES) -> Table:
    """Return the rank correlation of driving with the network, a participant one point."""
    pairs = [(cause, name) for cause in CAUSES for name in names]
    tests = []
    for cause, name in pairs:
        first, second = _by_participant(measured, cause), _by_participant(measured, name)
        shared = sorted(set(first) & set(second))
        tests.append(
            correlation(
                np.array([first[who] for who in shared]), np.array([second[who] for who in shared])
            )
        )
    corrected = holm([test.p for test in tests])
    rows = tuple(
        (
            words(cause),
            words(name),
            count(test.n),
            number(test.effect, 2),
            probability(test.p),
            probability(p),
        )
        for (cause, name), test, p in zip(pairs, tests, corrected, strict=True)
    )
    below = ("Spearman's rank correlation over participants, whose sessions are averaged first.",)
    return Table(
        "network-effects",
        "Driving against the network.",
        ("Of the network", "Of the driving", "n", "ρ", "p", "p (Holm)"),
        rows,
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
        *(f"{name}, median" for name in LEARNT),
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
    medians = (number(spread([one.values[name] for one in own]).median, 3, ids) for name in LEARNT)
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
    """Return metrics by the number of a visitor's session: the learning curve, of those who came
    back as well.
    """
    rows = []
    for number_ in range(1, MOST_SESSIONS + 1):
        own = [one for one in measured if one.session.number == number_]
        if own:
            rows.append(_class_row("session", str(number_), own))
    later = [one for one in measured if one.session.number > MOST_SESSIONS]
    if later:
        rows.append(_class_row("session", f"≥ {MOST_SESSIONS + 1}", later))
    tests = [_first_to_second(measured, name) for name in LEARNT]
    blank = (
        words("first to second"),
        words("difference"),
        count(max((test.n for test in tests), default=0)),
        words(""),
        words(""),
    )
    rows.append((*blank, *(number(test.difference, 3) for test in tests)))
    rows.append(
        (
            words(""),
            words("p (Holm)"),
            *(words("") for _ in range(3)),
            *(probability(p) for p in holm([test.p for test in tests])),
        )
    )
    head = (
        "",
        "",
        "Participants",
        "Sessions",
        "% completed",
        *(f"{name}, median" for name in LEARNT),
    )
    below = (
        (
            "The difference is that of the same participants' second and first sessions, mean;"
            " negative: less in the second. Paired t test."
        ),
    )
    return Table("learning", "Metrics by session number.", head, tuple(rows), below)


def _first_to_second(measured: Sequence[Measured], name: str) -> Test:
    first, second = (
        {one.session.participant: one.values[name] for one in measured if one.session.number == n}
        for n in (1, 2)
    )
    shared = sorted(
        who
        for who in set(first) & set(second)
        if math.isfinite(first[who]) and math.isfinite(second[who])
    )
    return within(
        np.array([second[who] for who in shared], dtype=np.float64),
        np.array([first[who] for who in shared], dtype=np.float64),
    )
