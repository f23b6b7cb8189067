"""Planted effects are found through the whole of the analysis, planted nothings are not, and small
studies break nothing.
"""

import math
from dataclasses import replace

import msgspec
import numpy as np
import pytest
from scipy import stats

from experiments.analysis.dataset.records import Dataset, SessionRecord
from experiments.analysis.metrics.definitions import METRICS
from experiments.analysis.metrics.milestones import Milestones
from experiments.analysis.metrics.sessions import Measured, measure_all
from experiments.analysis.tables.effects import (
    against_network,
    by_network,
    compare_conditions,
    learning,
    outcomes_by_condition,
)
from experiments.definition.shipped import shipped
from tests.support.study_dataset import made_up

STUDY = shipped()["exploration"]
WITHIN = shipped()["assistance"]
PAIR = msgspec.structs.replace(STUDY, conditions=STUDY.conditions[:2])


def measured(who, condition="", number=1, outcome="completed", **values):
    session = SessionRecord(
        f"{who}-{condition}-{number}",
        who,
        "giraff",
        condition=condition,
        number=number,
        outcome=outcome,
    )
    nothing = {column.name: math.nan for column in METRICS}
    return Measured(session, Milestones(), nothing | values, (), np.empty((0, 2)))


def row(table, *labels):
    return next(
        one for one in table.rows if [cell.text for cell in one[: len(labels)]] == list(labels)
    )


def cell(table, line, head):
    return line[table.head.index(head)].value


@pytest.mark.parametrize(("slower", "is_found"), [(1.4, True), (1.0, False)])
def test_a_condition_that_slows_driving_down_is_found_and_one_that_does_not_is_not(
    slower, is_found
):
    dataset = made_up(np.random.default_rng(31), 40, study=PAIR, slower=slower)
    table = compare_conditions(dataset, measure_all(dataset), ("speed", "moving_speed"))
    assert [cell(table, one, "p (Holm)") < 0.05 for one in table.rows] == [is_found, is_found]


def test_participants_not_sessions_are_compared():
    rng = np.random.default_rng(32)
    keys = [one.key for one in PAIR.conditions]
    level = rng.normal(0.0, 1.0, (2, 12))
    own = [
        measured(f"P{n}-{k}", keys[k], number, speed=level[k, n] + rng.normal(0.0, 0.01))
        for k in (0, 1)
        for n in range(12)
        for number in range(1, 9)
    ]
    table = compare_conditions(Dataset(PAIR), own, ("speed",))
    expected = stats.ttest_ind(level[0], level[1], equal_var=False).pvalue
    assert cell(table, table.rows[0], "p") == pytest.approx(expected, abs=0.02)
    assert cell(table, table.rows[0], f"{keys[0]}: n") == 12


def test_within_subjects_only_those_who_had_every_condition_are_compared():
    rng = np.random.default_rng(33)
    first, second = [one.key for one in WITHIN.conditions][:2]
    a, b = rng.normal(1.0, 1.0, 10), rng.normal(0.6, 1.0, 10)
    own = [measured(f"P{n}", first, 1, speed=a[n]) for n in range(10)] + [
        measured(f"P{n}", second, 2, speed=b[n]) for n in range(8)
    ]
    table = compare_conditions(Dataset(WITHIN), own, ("speed",))
    assert cell(table, table.rows[0], "p") == pytest.approx(stats.ttest_rel(a[:8], b[:8]).pvalue)


def test_outcomes_of_each_condition_sum_to_its_sessions():
    dataset = made_up(np.random.default_rng(34), 30)
    table = outcomes_by_condition(dataset, measure_all(dataset))
    outcomes = table.head[3:-3]
    for one in table.rows:
        assert sum(cell(table, one, name) for name in outcomes) == cell(table, one, "Sessions")
    assert cell(table, row(table, "all"), "Sessions") == len(dataset.sessions)


def test_delay_that_makes_tasks_longer_is_found_among_relations_that_are_none():
    rng = np.random.default_rng(35)
    trips = rng.gamma(2.0, 0.1, 40)
    own = [
        measured(
            f"P{n}",
            round_trip=trip,
            loss=rng.random(),
            task_time=60.0 + 200.0 * trip + rng.normal(0.0, 8.0),
            stops=rng.normal(),
        )
        for n, trip in enumerate(trips)
    ]
    table = against_network(own)
    assert cell(table, row(table, "round_trip", "task_time"), "p (Holm)") < 0.001
    assert cell(table, row(table, "round_trip", "task_time"), "ρ") > 0.8
    assert cell(table, row(table, "loss", "stops"), "p (Holm)") > 0.05


def test_every_session_with_a_known_delay_falls_into_one_class():
    dataset = made_up(np.random.default_rng(36), 30)
    found = measure_all(dataset)
    table = by_network(found)
    known = sum(math.isfinite(one.values["round_trip"]) for one in found)
    assert (
        sum(cell(table, one, "Sessions") for one in table.rows if one[0].text == "round_trip")
        == known
    )
    assert cell(table, row(table, "control way", "datachannel"), "Sessions") > 0


def test_what_visitors_learn_is_the_difference_of_the_same_visitors():
    rng = np.random.default_rng(37)
    first = rng.normal(100.0, 20.0, 15)
    second = first - rng.normal(10.0, 2.0, 15)
    own = [measured(f"P{n}", number=1, total_time=first[n]) for n in range(15)] + [
        measured(f"P{n}", number=2, total_time=second[n]) for n in range(12)
    ]
    table = learning(own)
    assert cell(table, row(table, "first to second"), "total_time, median") == pytest.approx(
        (second - first)[:12].mean()
    )
    assert cell(table, row(table, "", "p (Holm)"), "total_time, median") < 0.001
    assert cell(table, row(table, "session", "2"), "Sessions") == 12


@pytest.mark.parametrize("size", [0, 1, 2])
def test_studies_of_hardly_anybody_break_nothing(size):
    dataset = made_up(np.random.default_rng(38), size)
    found = measure_all(dataset)
    for table in (
        compare_conditions(dataset, found),
        outcomes_by_condition(dataset, found),
        against_network(found),
        by_network(found),
        learning(found),
    ):
        assert all(len(one) == len(table.head) for one in table.rows)


def test_sessions_without_a_condition_are_in_the_whole_and_in_no_group():
    table = outcomes_by_condition(
        Dataset(PAIR),
        [replace(measured("P"), session=SessionRecord("s", "P", "giraff", outcome="completed"))],
    )
    assert [one[0].text for one in table.rows] == ["all"]
