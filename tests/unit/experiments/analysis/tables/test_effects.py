"""Planted effects are found through the whole of the analysis, planted nothings are not, and small
studies break nothing.
"""

import functools
import math

import msgspec
import numpy as np
import pytest
from scipy import stats

from experiments.analysis.metrics.sessions import measure_all
from experiments.analysis.tables.effects import (
    against_network,
    by_network,
    compare_conditions,
    learning,
    learnt,
    outcomes_by_condition,
)
from experiments.dataset.levels import OUTCOMES
from experiments.dataset.records import Dataset, SessionRecord
from experiments.definition.factors import conditions_together
from experiments.definition.shipped import shipped
from tests.support.analysis.planted_effects.study import success_study
from tests.support.analysis.study_dataset import made_up
from tests.support.analysis.tables import measured, rows

STUDY = shipped()["exploration"]
WITHIN = shipped()["assistance"]
PAIR = msgspec.structs.replace(STUDY, conditions=STUDY.conditions[:2])


def session_with(who, condition="", number=1, outcome="completed", **values):
    place = {"condition": condition, "number": number, "visit": number, "outcome": outcome}
    session = SessionRecord(f"{who}-{condition}-{number}", who, "giraff", **place)
    known = {"completed": float(outcome == "completed"), "total_time": 60.0, "seen": 1.0}
    return measured(session, **known | values)


def row(table, *labels):
    return next(one for one in table.rows if texts(one[: len(labels)]) == labels)


def texts(cells):
    return tuple(cell.text for cell in cells)


@functools.cache
def thirty():
    """A study of thirty participants, and the numbers of their sessions."""
    dataset = made_up(np.random.default_rng(34), 30)
    return dataset, measure_all(dataset)


def cell(table, line, head):
    return line[table.head.index(head)].value


@pytest.mark.slow
@pytest.mark.parametrize(("slower", "is_found"), [(1.4, True), (1.0, False)])
def test_a_condition_that_slows_driving_down_is_found_and_one_that_does_not_is_not(
    slower, is_found
):
    dataset = made_up(np.random.default_rng(31), 28, study=PAIR, slower=slower)
    table = compare_conditions(dataset, measure_all(dataset), ("speed", "moving_speed"))
    assert [cell(table, one, "p (Holm)") < 0.05 for one in table.rows] == [is_found, is_found]


def test_participants_not_sessions_are_compared():
    rng = np.random.default_rng(32)
    keys = [one.key for one in PAIR.conditions]
    level = rng.normal(0.0, 1.0, (2, 12))
    own = [
        session_with(f"P{n}-{k}", keys[k], number, speed=level[k, n] + rng.normal(0.0, 0.01))
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
    own = [session_with(f"P{n}", first, 1, speed=a[n]) for n in range(10)]
    own += [session_with(f"P{n}", second, 2, speed=b[n]) for n in range(8)]
    table = compare_conditions(Dataset(WITHIN), own, ("speed",))
    assert cell(table, table.rows[0], "p") == pytest.approx(stats.ttest_rel(a[:8], b[:8]).pvalue)


@pytest.mark.slow
def test_outcomes_of_each_condition_sum_to_its_sessions():
    dataset, found = thirty()
    table = outcomes_by_condition(dataset, found)
    outcomes = table.head[6:]
    for one in table.rows:
        assert sum(cell(table, one, name) for name in outcomes) == cell(table, one, "Sessions")
    places = {(one.participant, one.condition) for one in dataset.sessions}
    assert cell(table, row(table, "all"), "Sessions") == len(places)


def test_share_of_success_has_an_interval_only_where_participants_have_one_drive_each():
    first, second = [one.key for one in WITHIN.conditions][:2]
    ended = {first: ["timed_out", "completed"], second: ["completed"]}
    own = [
        session_with(f"P{n}", key, visit, outcome=outcome)
        for n in range(10)
        for key, outcomes in ended.items()
        for visit, outcome in enumerate(outcomes, start=1)
    ]
    table = outcomes_by_condition(Dataset(WITHIN), own)
    for key, share, bounds in ((first, 0.0, (0.0, 27.8)), (second, 100.0, (72.2, 100.0))):
        assert cell(table, row(table, key), "Sessions") == 10
        assert cell(table, row(table, key), "% completed") == share
        assert tuple(
            cell(table, row(table, key), name) for name in ("from", "to")
        ) == pytest.approx(bounds, abs=0.1)
    assert cell(table, row(table, "all"), "% completed") == 50.0
    assert {one.text for one in row(table, "all")[4:6]} == {"–"}


def test_delay_that_makes_tasks_longer_is_found_among_relations_that_are_none():
    rng = np.random.default_rng(35)
    trips = rng.gamma(2.0, 0.1, 40)
    own = []
    for n, trip in enumerate(trips):
        network = {"round_trip": trip, "loss": rng.random()}
        time = 60.0 + 200.0 * trip + rng.normal(0.0, 8.0)
        own.append(session_with(f"P{n}", **network, task_time=time, stops=rng.normal()))
    table = against_network(own)
    line = row(table, "round_trip", "task_time")
    assert cell(table, line, "p (Holm)") < 0.001
    low, size, high = (cell(table, line, head) for head in ("Size: from", "Size", "Size: to"))
    assert size > 0.8
    assert low < size < high
    assert (cell(table, line, "n tested"), cell(table, line, "df")) == (40, 38)
    assert cell(table, row(table, "loss", "stops per min"), "p (Holm)") > 0.05


def test_every_session_with_a_known_delay_falls_into_one_class():
    _, found = thirty()
    table = by_network(found)
    known = sum(math.isfinite(one.values["round_trip"]) for one in found)
    classes = [one for one in table.rows if one[0].text == "round_trip"]
    assert sum(cell(table, one, "Sessions") for one in classes) == known
    assert cell(table, row(table, "control way", "datachannel"), "Sessions") > 0


def test_mixed_design_is_compared_by_a_mixed_model_and_by_clusters():
    """Two groups of participants, who each drive two of the four conditions."""
    rng = np.random.default_rng(36)
    study = success_study()
    dataset = Dataset(study)
    own = [
        session_with(
            f"{kind[0]}{n}",
            key,
            speed=rng.normal(place, 0.5) + level,
            outcome="completed" if n % 4 else "timed_out",
            task_time=math.nan,
        )
        for place, kind in enumerate(conditions_together(study))
        for n, level in enumerate(rng.normal(0.0, 1.0, 12).tolist())
        for key in kind
    ]
    table = compare_conditions(dataset, own, ("speed", "completed", "stops"))
    speed, completed, _stops = table.rows
    texts_of = [dict(zip(table.head, texts(one), strict=True)) for one in (speed, completed)]
    assert [(one["Test"], one["n tested"]) for one in texts_of] == [
        ("Wald F", "24"),
        ("score F (logistic)", "24"),
    ]
    assert cell(table, speed, "p") < 0.05


def test_learning_is_the_difference_within_visitors():
    rng = np.random.default_rng(37)
    first = rng.normal(100.0, 20.0, 15)
    second = first - rng.normal(10.0, 2.0, 15)
    own = [session_with(f"P{n}", number=1, efficiency=first[n]) for n in range(15)]
    own += [session_with(f"P{n}", number=2, efficiency=second[n]) for n in range(12)]
    table = learnt(Dataset(STUDY), own)
    line = row(table, "efficiency")
    assert cell(table, line, "Difference") == pytest.approx((second - first)[:12].mean())
    assert cell(table, line, "p (Holm)") < 0.001
    assert (cell(table, line, "n tested"), cell(table, line, "second: n")) == (12, 12)
    sessions = learning(own)
    assert cell(sessions, row(sessions, "visit", "2"), "Sessions") == 12


def test_row_has_test_pairs_degrees_of_freedom_effect_and_both_intervals():
    rng = np.random.default_rng(39)
    keys = [one.key for one in WITHIN.conditions][:2]
    own = [
        session_with(f"P{n}", key, 1 + k, speed=rng.normal(0.5 * k, 1.0))
        for n in range(14)
        for k, key in enumerate(keys)
        if (n, k) not in {(0, 1), (1, 0)}
    ]
    table = compare_conditions(Dataset(WITHIN), own, ("speed",))
    (line,) = table.rows
    assert rows(table, "Test", "n tested", "df", "Effect") == [("paired t", "12", "11", "d_z")]
    for what in ("Difference", "Size"):
        bounds = [cell(table, line, f"{what}{end}") for end in (": from", "", ": to")]
        assert bounds == sorted(bounds)


def test_a_condition_of_one_participant_does_not_take_the_others_tests_away():
    rng = np.random.default_rng(40)
    keys = [one.key for one in STUDY.conditions][:3]
    own = [session_with(f"P{n}", keys[n % 2], speed=rng.normal()) for n in range(16)]
    own.append(session_with("P16", keys[2], speed=1.0))
    table = compare_conditions(Dataset(STUDY), own, ("speed",))
    (line,) = table.rows
    assert cell(table, line, "n tested") == 16
    assert math.isfinite(cell(table, line, "p"))
    assert line[table.head.index("Remark")].text == f"{keys[2]}: left out, n = 1"


def test_metrics_with_the_same_values_are_one_member_of_the_family():
    rng = np.random.default_rng(41)
    keys = [one.key for one in PAIR.conditions]
    own = []
    for n in range(20):
        time = rng.normal(100.0 + 9.0 * (n % 2), 10.0)
        same = {"efficiency": time, "moving_speed": time}
        own.append(session_with(f"P{n}", keys[n % 2], **same, speed=rng.normal()))
    table = compare_conditions(Dataset(PAIR), own, ("efficiency", "moving_speed", "speed"))
    first, second, third = table.rows
    assert cell(table, first, "p (Holm)") == cell(table, second, "p (Holm)")
    smaller = min(cell(table, first, "p"), cell(table, third, "p"))
    assert min(cell(table, one, "p (Holm)") for one in table.rows) == pytest.approx(
        min(1.0, 2.0 * smaller)
    )
    assert any("2 different tests" in note for note in table.notes)


@pytest.mark.parametrize("size", [0, 1, 2])
def test_studies_of_up_to_two_participants_have_tables(size):
    dataset = made_up(np.random.default_rng(38), size)
    found = measure_all(dataset)
    for table in (
        compare_conditions(dataset, found),
        outcomes_by_condition(dataset, found),
        against_network(found),
        by_network(found),
        learning(found),
        learnt(dataset, found),
    ):
        assert all(len(one) == len(table.head) for one in table.rows)


def test_sessions_without_a_condition_are_in_the_whole_and_in_no_group():
    session = SessionRecord("s", "P", "giraff", outcome="completed")
    table = outcomes_by_condition(Dataset(PAIR), [measured(session)])
    assert [one[0].text for one in table.rows] == ["all"]


def test_outcomes_are_named_in_words():
    sessions = [SessionRecord(name, name, "giraff", outcome=name) for name in OUTCOMES]
    table = outcomes_by_condition(Dataset(PAIR), [measured(one) for one in sessions])
    assert {"completed", "timed out", "connection lost"} <= set(table.head)
    assert not any("_" in head for head in table.head)


def drive(who, condition, *, completed, seconds, **values):
    time = {"task_time": seconds} if completed else {}
    outcome = "completed" if completed else "timed_out"
    return session_with(who, condition, outcome=outcome, total_time=seconds, **time, **values)


def test_drives_that_were_cut_short_are_not_averaged_as_if_complete():
    """In the second condition half of the participants leave after a minute; no more differs."""
    rng = np.random.default_rng(42)
    keys = [one.key for one in PAIR.conditions]
    own = []
    for n in range(48):
        is_cut = n % 2 == 1 and n % 4 == 1
        seconds = 60.0 if is_cut else 300.0 + rng.normal(0.0, 20.0)
        counted = {"stops": rng.poisson(seconds / 30.0), "path": seconds / 10.0}
        own.append(drive(f"P{n}", keys[n % 2], completed=not is_cut, seconds=seconds, **counted))
    table = compare_conditions(Dataset(PAIR), own, ("completed", "task_time", "stops", "path"))
    tests = {one[0].text: one[table.head.index("Test")].text for one in table.rows}
    assert tests == {
        "completed": "N−1 χ²",
        "task_time": "log-rank χ²",
        "stops per min": "score F (Poisson)",
        "path (completed)": "Welch t",
    }
    assert cell(table, row(table, "completed"), f"{keys[1]}: mean") == pytest.approx(0.5)
    assert cell(table, row(table, "completed"), "p") < 0.001
    stops = row(table, "stops per min")
    assert cell(table, stops, f"{keys[1]}: mean") == pytest.approx(2.0, abs=0.5)
    assert cell(table, stops, "p") > 0.05
    assert cell(table, row(table, "path (completed)"), f"{keys[1]}: n") == 12
    times = row(table, "task_time")
    assert cell(table, times, f"{keys[1]}: n") == 24
    assert cell(table, times, f"{keys[1]}: mean") is None
    assert cell(table, times, f"{keys[1]}: median") > 290.0
