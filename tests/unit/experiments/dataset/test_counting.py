"""One rule decides which drives and answers count, whatever became of a participant."""

from dataclasses import replace

import pytest

from experiments.analysis.metrics.definitions import METRICS
from experiments.analysis.metrics.sessions import measure_all
from experiments.analysis.report import reports
from experiments.analysis.tables.effects import compare_conditions, learning
from experiments.analysis.tables.paper_tables import table_1, table_5
from experiments.analysis.tables.people import participants_table
from experiments.dataset.counting import attempted, counting, visits_of, with_reasons
from experiments.dataset.folder import read, write
from experiments.dataset.levels import UNCOUNTED
from experiments.dataset.records import ResponseRecord
from experiments.definition.shipped import shipped
from tests.support.analysis.every_ending import drive, every_ending
from tests.support.analysis.planned import plan_with

COUNTING = {"done-1", "late-1", "anew-1", "again-1", "again-2", "replaced-1"}
CHECK = {"questionnaire": "experience", "item": "q1", "answer": "2"}


def counted(dataset):
    return {one.id for one in dataset.sessions}


def test_only_ended_task_drives_in_which_the_robot_moved_count():
    assert counted(counting(every_ending())) == COUNTING


def test_each_other_drive_has_a_reason():
    found = {one.id: one.counts_why for one in counting(every_ending()).others}
    assert found == {
        "waiting-1": "running",
        "frozen-1": "not_exposed",
        "still-1": "not_driven",
        "anew-0": "not_exposed",
        "fault-1": "platform_fault",
        "visitor-1": "excluded",
    }


def test_exposed_participant_who_never_moved_the_robot_did_not_succeed():
    (found, _) = reports(every_ending())
    tables = {one.name: one for one in found.tables}
    conditions = tables["conditions"]
    completed, task_time, *_, near = conditions.rows
    n, mean = (conditions.head.index(f"shut: {word}") for word in ("n", "mean"))
    assert (completed[n].value, completed[mean].value) == (2, 0.5)
    assert {"done-1", "still-1"} == set(completed[n].sessions) == set(task_time[n].sessions)
    assert set(near[n].sessions) == {"done-1"}
    (shut,) = (row for row in tables["outcomes"].rows if row[0].text == "shut")
    assert shut[tables["outcomes"].head.index("% completed")].value == 50.0


def test_unmoved_drive_is_no_failure_beside_one_that_counts():
    dataset = every_ending()
    first = drive("done", visit=0, first_motion=float("nan"), outcome="cancelled")
    found = counting(replace(dataset, sessions=(first, *dataset.sessions)))
    assert {one.id for one in attempted(found)} == COUNTING | {"still-1"}
    other_cell = replace(first, condition="all_open")
    found = counting(replace(dataset, sessions=(other_cell, *dataset.sessions)))
    assert {one.id for one in attempted(found)} == COUNTING | {"still-1"}


def test_excluded_participant_who_never_moved_the_robot_is_no_failure():
    dataset = every_ending()
    sessions = [
        replace(one, excluded="the room was dark") if one.id == "still-1" else one
        for one in dataset.sessions
    ]
    dataset = replace(dataset, sessions=tuple(sessions))
    assert {one.id for one in attempted(counting(dataset))} == COUNTING
    every = attempted(counting(dataset, with_excluded=True))
    assert {one.id for one in every} == COUNTING | {"visitor-1", "still-1"}


def test_chosen_kinds_alone_count():
    dataset = every_ending()
    assert counted(counting(dataset, ("pilot",))) == {"pilot-1"}
    assert counted(counting(dataset, ("participant", "bot"))) == COUNTING | {"bot-1"}


def test_every_session_has_the_reason_why_it_does_not_count():
    found = {one.id: one.counts_why for one in with_reasons(every_ending()).sessions}
    assert {key for key, why in found.items() if not why} == COUNTING
    assert (found["practice"], found["pilot-1"], found["bot-1"]) == ("practice", "pilot", "bot")
    assert set(found.values()) <= {"", *UNCOUNTED}


def test_the_reasons_survive_a_folder(tmp_path):
    dataset = with_reasons(every_ending())
    write(dataset, tmp_path)
    again = read(tmp_path)
    assert [(one.id, one.counts_why, one.visit) for one in again.sessions] == [
        (one.id, one.counts_why, one.visit) for one in dataset.sessions
    ]
    head, *rows = (tmp_path / "data/description-sessions_data.csv").read_text().splitlines()
    at = head.split(",").index("counts")
    assert sum(row.split(",")[at] == "1" for row in rows) == len(COUNTING)


@pytest.mark.parametrize(
    ("rule", "missing"), [("first", {"again-2"}), ("last", {"again-1"}), ("all", set())]
)
def test_study_decides_which_of_several_drives_in_a_condition_counts(rule, missing):
    dataset = every_ending(analysis={"drives": rule})
    assert counted(counting(dataset)) == COUNTING - missing
    assert {one.id for one in counting(dataset).others if one.counts_why == "repeated"} == missing


def test_the_first_drive_that_counts_is_the_first_in_which_the_robot_moved():
    dataset = every_ending(analysis={"drives": "first"})
    sessions = tuple(
        replace(one, first_motion=float("nan")) if one.id == "again-1" else one
        for one in dataset.sessions
    )
    assert "again-2" in counted(counting(replace(dataset, sessions=sessions)))


def test_a_participant_of_two_cells_counts_in_the_first_alone():
    dataset = every_ending()
    both = drive("anew", "shut", 2)
    dataset = replace(dataset, sessions=(*dataset.sessions, both))
    found = counting(dataset)
    assert {one.condition for one in found.sessions if one.participant == "anew"} == {"all_open"}
    assert {one.id: one.counts_why for one in found.others}["anew-2"] == "drawn_anew"
    table = compare_conditions(found, measure_all(found), ("total_time",))
    sessions = [{one for cell in row for one in cell.sessions} for row in table.rows]
    assert sessions == [counted(found)], "anew-2 is behind no number"


def test_answers_count_only_with_the_drive_that_they_are_about():
    found = counting(every_ending())
    assert {one.session for one in found.responses} == COUNTING
    assert "again-1" in table_5(found).rows[0][-1].sessions


def test_an_answer_about_no_drive_counts_only_where_it_is_about_the_person():
    dataset = every_ending()
    lonely = ResponseRecord("r-x", "experience", "still", {"q1": -2})
    dataset = replace(dataset, responses=(*dataset.responses, lonely))
    assert "r-x" not in {one.id for one in counting(dataset).responses}


def test_the_first_answer_is_the_first_about_a_drive_that_counts():
    dataset = every_ending(analysis={"counts": "first"})
    never = drive("late", "all_open", 1, id="late-0", first_motion=float("nan"))
    bad = ResponseRecord("r-bad", "experience", "late", {"q1": -2}, session="late-0")
    dataset = replace(
        dataset, sessions=(never, *dataset.sessions), responses=(bad, *dataset.responses)
    )
    found = table_5(counting(dataset))
    assert "late-0" not in {one for row in found.rows for cell in row for one in cell.sessions}


def test_rules_of_the_plan_exclude_by_default_and_not_in_a_sensitivity_analysis():
    dataset = every_ending(plan_with(attention_checks=[CHECK]))
    found = counting(dataset)
    assert counted(found) == set()
    assert {one.counts_why for one in found.others if one.id in COUNTING} == {"excluded_by_plan"}
    every = counting(dataset, with_excluded=True)
    assert counted(every) == COUNTING | {"visitor-1"}
    assert found.exclusions == every.exclusions
    assert {(one.participant, one.rule) for one in found.exclusions} == {
        *((who, "attention check") for who in ("done", "late", "anew", "again", "replaced")),
        ("fault", "platform fault"),
        ("visitor", "researcher's decision"),
    }


def test_a_round_is_no_visit():
    study = shipped()["assistance"]
    keys = [one.key for one in study.conditions]
    dataset = replace(
        every_ending(),
        study=study,
        participants=every_ending().participants[:1],
        sessions=tuple(drive("done", key, id=key) for key in keys),
        responses=(),
    )
    dataset = counting(dataset)
    assert [one.number for one in dataset.sessions] == [1] * len(keys)
    assert set(visits_of(dataset.sessions).values()) == {1}
    rows = {row[1].text: row[2].value for row in participants_table(dataset).rows}
    assert (rows["with a drive that counts"], rows["came back"]) == (1, 0)


def test_participant_who_returns_has_a_second_visit():
    found = counting(every_ending())
    assert visits_of(found.sessions)["again-2"] == 2
    rows = {row[1].text: row[2] for row in participants_table(found).rows}
    assert rows["came back"].value == 1
    assert [row[1].text for row in learning(measure_all(found)).rows] == ["1", "2"]


def test_older_datasets_have_visits_by_the_drives_in_a_condition():
    dataset = every_ending()
    old = replace(dataset, sessions=tuple(replace(one, visit=0) for one in dataset.sessions))
    found = {one.id: one.visit for one in counting(old).sessions}
    assert (found["again-1"], found["again-2"], found["anew-1"]) == (1, 2, 1)


def test_every_table_and_figure_is_made_of_drives_that_count():
    (found, every) = reports(every_ending())
    others = {"practice", "pilot-1", "bot-1", "still-1", "frozen-1", "anew-0", "fault-1"}
    flows = {"flow", "funnel", "fault-sides", "quality", "sessions", "exclusions"}
    for table in found.tables:
        behind = {one for row in table.rows for cell in row for one in cell.sessions}
        allowed = flows | {"participants", "table-2", "orders"}
        attempts = {"still-1"} if table.name in {"conditions", "outcomes"} else set()
        assert table.name in allowed or behind <= COUNTING | attempts, table.name
    for figure in found.figures:
        assert {one for ids in figure.behind.values() for one in ids} <= COUNTING, figure.name
    assert {one.session.id for one in found.measured} == COUNTING
    assert {one.session.id for one in every.measured} == COUNTING | {"visitor-1"}
    assert not others & {one.session.id for one in every.measured}


def test_a_robot_for_practice_is_in_no_table():
    dataset = every_ending()
    practice = replace(dataset.sessions[0], robot="practice-1")
    found = counting(replace(dataset, sessions=(practice, *dataset.sessions[1:])))
    assert table_1(found).head == ("", "giraff")


def test_metrics_have_one_value_a_drive_that_counts():
    found = counting(every_ending())
    assert len(measure_all(found)) == len(COUNTING)
    assert all(len(one.values) == len(METRICS) for one in measure_all(found))
