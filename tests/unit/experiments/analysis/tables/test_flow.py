"""The flow counts every participant, and the funnel shows where they left."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

from experiments.analysis.metrics.sessions import measure_all
from experiments.analysis.report import reports
from experiments.analysis.tables.flow import FLOW, STILL_THERE, fault_sides, flow, funnel, orders
from experiments.dataset.counting import counting
from experiments.dataset.records import Dataset, PageRecord, ParticipantRecord
from experiments.definition.shipped import shipped
from tests.support.analysis.every_ending import drive, every_ending
from tests.support.analysis.planned import plan_with
from tests.support.analysis.study_dataset import made_up

STUDY = shipped()["exploration"]


def flow_of(dataset):
    return flow(counting(dataset))


def lines(table, cell="all"):
    return [
        (row[1].text or row[2].text, int(row[3].value)) for row in table.rows if row[0].text == cell
    ]


DATASETS = {
    "every ending": every_ending(),
    "excluded": every_ending(plan_with(incomplete="answers")),
    "made up": made_up(np.random.default_rng(41), 40),
}


@pytest.mark.parametrize("dataset", DATASETS.values(), ids=list(DATASETS))
def test_every_line_is_the_one_above_less_those_who_are_named_between(dataset):
    table = flow_of(dataset)
    for cell in dict.fromkeys(row[0].text for row in table.rows):
        left = None
        for label, number in lines(table, cell):
            if label in FLOW:
                assert left is None or number == left
                left = number
            elif left is not None and label.startswith(("left: ", "excluded: ")):
                left -= number


def test_each_participant_is_at_the_last_stage_that_they_reached():
    table = flow_of(every_ending())
    assert {stage: dict(lines(table))[stage] for stage in FLOW} == {
        "arrived": 12,
        "assigned": 11,
        "exposed": 10,
        "drove": 9,
        "ended": 8,
        "counted": 5,
        "answered": 5,
    }
    found = dict(lines(table))
    assert found["left: declined"] == 1
    assert found["left: withdrew"] == 1
    assert found["excluded: platform fault: web process away"] == 1
    assert found["excluded: researcher's decision"] == 1


def test_a_participant_who_finished_and_then_withdrew_was_exposed_and_ended():
    rows = [row[2].text or row[1].text for row in flow_of(every_ending()).rows]
    assert rows.index("left: withdrew") > rows.index("ended")


def test_a_withdrawal_before_exposure_is_a_loss_before_exposure():
    early = ParticipantRecord("w", cell="shut", stage="assigned", withdrawn=True)
    dataset = replace(every_ending(), participants=(early,), sessions=(), responses=())
    rows = [row[2].text or row[1].text for row in flow_of(dataset).rows]
    assert rows.index("assigned") < rows.index("left: withdrew") < rows.index("exposed")


def test_participants_are_in_the_condition_that_was_drawn_first():
    table = flow_of(every_ending())
    assert dict(lines(table, "shut"))["among them: drawn anew"] == 1
    assert dict(lines(table, "all_open"))["among them: replaced by another participant"] == 1
    assert "among them: drawn anew" not in dict(lines(table, "all_open"))
    assigned = [dict(lines(table, cell))["assigned"] for cell in ("shut", "all_open")]
    assert assigned == [8, 3]


def test_finishers_are_not_counted_as_not_having_continued():
    dataset = every_ending()
    finished = [one for one in dataset.participants if one.finished]
    table = flow_of(replace(dataset, participants=tuple(finished)))
    assert not [label for label, _ in lines(table) if STILL_THERE in label]
    assert dict(lines(table))["left: never moved the robot"] == 1


def test_flow_shows_how_many_participants_each_outcome_has():
    plan = plan_with(incomplete="answers")
    without = [one for one in every_ending().responses if one.participant != "late"]
    dataset = replace(every_ending(plan), responses=tuple(without))
    found = dict(lines(flow_of(dataset)))
    assert found["excluded: incomplete"] == 1
    assert found["analysed: success and times"] == 6
    assert found["analysed: driving"] == found["analysed: answers to experience"] == 4
    (report, _) = reports(dataset)
    conditions = next(one for one in report.tables if one.name == "conditions")
    completed = dict(zip(conditions.head, conditions.rows[0], strict=True))
    assert completed["all_open: n"].value + completed["shut: n"].value == 6


def test_drives_ended_by_the_platform_are_only_counted_in_the_flow():
    found = counting(every_ending())
    assert "1 session (platform fault: web process away)" in " ".join(flow(found).notes)
    row = next(row for row in flow(found).rows if row[2].text.startswith("excluded: platform"))
    assert row[3].sessions == ("fault-1",)
    (report, _) = reports(every_ending())
    quality = next(table for table in report.tables if table.name == "quality")
    uncounted = {row[1].text: row[2].sessions for row in quality.rows if "not" in row[0].text}
    assert uncounted["platform fault: web process away"] == ("fault-1",)
    assert uncounted["a visitor looked on"] == ("visitor-1",)


def test_sessions_that_were_not_completed_stand_by_outcome_and_side():
    rows = {
        (row[0].text, row[1].text): row[2].sessions
        for row in fault_sides(counting(every_ending())).rows
    }
    assert rows["connection lost", "platform"] == ("fault-1",)
    assert rows["robot fault", "robot"] == ("replaced-1",)
    assert rows["timed out", "nobody"] == ("late-1",)


def test_outcomes_are_those_of_the_first_tasks_that_were_driven():
    found = dict(lines(flow_of(every_ending())))
    assert found["first task: timed out"] == found["first task: robot fault"] == 1
    assert "first task: cancelled" not in found


def test_orders_show_how_many_had_each_and_how_many_were_complete():
    study = shipped()["assistance"]
    first, second = (one.key for one in study.conditions[:2])
    order = f"{first}-{second}"
    dataset = Dataset(
        study,
        participants=tuple(ParticipantRecord(who, cell=order) for who in ("a", "b", "c")),
        sessions=(drive("a", first, id="a1"), drive("a", second, id="a2"), drive("b", first)),
    )
    (row,) = orders(counting(dataset)).rows
    assert [cell.text for cell in row] == [order, "3", "2", "1"]
    assert orders(counting(every_ending())).rows == ()


def test_the_funnel_counts_who_came_who_went_on_and_how_long_it_took():
    pages = (
        PageRecord("P1", "link", seconds=2.0),
        PageRecord("P2", "link", seconds=4.0),
        PageRecord("P3", "link", finished=False),
        PageRecord("P1", "consent", seconds=30.0),
        PageRecord("P2", "consent", finished=False),
    )
    table = funnel(Dataset(STUDY, pages=pages), [])
    found = {row[0].text: [cell.value for cell in row[1:]] for row in table.rows}
    assert found["link"] == [3, 2, 1, 3.0]
    assert found["Consent"] == [2, 1, 1, 30.0]
    assert found["docked"] == [0, 0, 0, None]


def test_participants_on_the_last_page_did_not_leave():
    (last,) = (row for row in funnel(counting(every_ending()), []).rows if row[0].text == "Bye")
    assert (last[1].value, last[2].value, last[3].value) == (5, 5, 0)


@pytest.mark.slow
def test_milestones_stand_between_the_task_and_what_follows_it_and_only_fall():
    dataset = made_up(np.random.default_rng(42), 30)
    table = funnel(dataset, measure_all(dataset))
    names = [row[0].text for row in table.rows]
    assert (
        names.index("Exploration")
        < names.index("first video frame")
        < names.index("checkpoint 1")
        < names.index("docked")
        < names.index("Your experience")
    )
    milestones = table.rows[names.index("first video frame") : names.index("docked") + 1]
    assert all(
        before[2].value == after[1].value for before, after in itertools.pairwise(milestones)
    )
    assert all(row[1].value == row[2].value + row[3].value for row in milestones)
