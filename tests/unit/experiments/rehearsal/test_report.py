import dataclasses

import pytest

from experiments.bots.diary import Diary, Leg, PageVisit
from experiments.definition.shipped import shipped
from experiments.rehearsal.report import DriveRecord, Findings, judge

STUDY = shipped()["exploration"]
KEYS = [condition.key for condition in STUDY.conditions]
ALL = (1, 2, 3, 4)


def diary(number, key, *, seconds=150.0, passed=ALL, outcome="completed", **more):
    leg = Leg(
        seconds=seconds,
        outcome=outcome,
        passed=passed,
        session=f"s{number}",
        closed=STUDY.condition(key).doors_closed,
    )
    entries = [
        PageVisit("About you", "/q/", 0.0, 3.0, words=200, questions=6),
        PageVisit("Exploration", "/drive/", 0.0, seconds),
    ]
    return Diary(number, "completes", code="ABCD", entries=entries, legs=[leg], **more)


def played(*diaries, **more):
    records = {
        one.legs[0].session: DriveRecord(KEYS[one.number % len(KEYS)], one.legs[0].outcome)
        for one in diaries
        if one.legs
    }
    return judge(STUDY, diaries, Findings(records, **more))


def one_bot_for_each_condition():
    return [diary(number, key) for number, key in enumerate(KEYS)]


def test_a_study_that_every_bot_gets_through_passes():
    report = played(*one_bot_for_each_condition(), drawn=("table_1",))
    assert report.passed, report.problems
    assert [one.completed for one in report.conditions] == [1] * len(KEYS)
    assert report.drawn == ["table_1"]


def test_times_of_people_are_estimated_from_words_questions_and_the_drive():
    report = played(*one_bot_for_each_condition())
    assert [step.expected_minutes for step in report.steps if step.heading == "About you"] == [1.7]
    assert report.conditions[0].expected_minutes == 4.5
    assert report.expected_minutes == pytest.approx(1.7 + 4.5, abs=0.1)


def test_the_page_before_a_drive_and_the_page_of_the_drive_are_separate_steps():
    one = diary(0, KEYS[0])
    one.entries = [
        PageVisit("Exploration", "/studies/exploration/step/", 0.0, words=80),
        PageVisit("Exploration", "/studies/exploration/drive/", 1.0, words=10, drives=True),
    ]
    steps = played(one).steps
    assert [(step.heading, step.drives, step.words) for step in steps] == [
        ("Exploration", False, 80),
        ("Exploration", True, 10),
    ]


def test_a_checkpoint_that_no_bot_passes_is_a_problem():
    bots = one_bot_for_each_condition()
    bots[1].legs[0].passed, bots[1].legs[0].outcome = (1, 2), "timed_out"
    report = played(*bots)
    assert not report.passed
    assert report.conditions[1].missed == [3, 4]
    assert any(KEYS[1] in problem and "checkpoint 3" in problem for problem in report.problems)


def test_a_condition_without_a_completed_drive_is_a_problem():
    report = played(*one_bot_for_each_condition()[:-1])
    assert [
        problem
        for problem in report.problems
        if KEYS[-1] in problem and "No bot completed the task" in problem
    ]


def test_a_short_time_limit_is_a_problem_with_a_longer_one_proposed():
    bots = one_bot_for_each_condition()
    bots[0].legs[0].seconds = 500.0
    (problem,) = played(*bots).problems
    assert "allow 21" in problem


def test_a_stuck_form_is_a_problem_that_names_the_bot():
    bots = [
        *one_bot_for_each_condition(),
        Diary(9, "completes", stuck="“About you” does not continue"),
    ]
    assert any("Bot 9" in problem and "About you" in problem for problem in played(*bots).problems)


def test_a_bot_that_got_no_code_is_a_problem():
    bots = one_bot_for_each_condition()
    bots[2] = dataclasses.replace(bots[2], code="")
    assert played(*bots).problems == ["Bot 2 finished the study but got no completion code."]


def test_a_setting_that_was_not_applied_as_assigned_is_a_problem():
    bots = one_bot_for_each_condition()
    records = {
        one.legs[0].session: DriveRecord(
            KEYS[one.number], "completed", mismatches=("assist",) if one.number == 0 else ()
        )
        for one in bots
    }
    assert judge(STUDY, bots, Findings(records)).problems == [
        f"Condition {KEYS[0]}: A setting was not applied as assigned: assist."
    ]


def test_empty_columns_are_notes_and_missing_figures_are_problems():
    report = played(
        *one_bot_for_each_condition(),
        empty_columns=("ict.use",),
        not_drawn=("figure_7, because of an error",),
    )
    assert "No bot gave a value for ict.use." in report.notes
    assert report.problems == ["Not drawn: figure_7, because of an error."]


def test_practice_counts_as_no_drive_of_the_condition():
    bots = one_bot_for_each_condition()
    records = {
        one.legs[0].session: DriveRecord(KEYS[one.number], "completed", practice=one.number == 0)
        for one in bots
    }
    assert judge(STUDY, bots, Findings(records)).conditions[0].drives == 0


def test_the_report_has_the_participants_that_an_effect_needs():
    assert [need["effect"] for need in played(*one_bot_for_each_condition()).power] == [
        0.2,
        0.5,
        0.8,
    ]


def test_a_rehearsal_without_bots_does_not_pass():
    report = judge(STUDY, [], Findings())
    assert not report.passed
    assert report.expected_minutes == 0.0


def test_a_drive_whose_replay_differs_from_its_record_is_a_problem():
    sentence = "Session s1: a replay ends as cancelled, but completed is stored."
    assert (
        played(*one_bot_for_each_condition(), discrepancies=(sentence,))
        .problems[-1]
        .endswith(sentence)
    )
