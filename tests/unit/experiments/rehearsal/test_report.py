import dataclasses

import pytest

from experiments.bots.diary import Diary, Leg, PageVisit
from experiments.definition.shipped import shipped
from experiments.rehearsal.report import DriveRecord, Findings, judge

STUDY = shipped()["exploration"]
KEYS = [condition.key for condition in STUDY.conditions]
ALL = (1, 2, 3, 4)


def diary(number, key, *, seconds=150.0, passed=ALL, outcome="completed", **more):
    closed = STUDY.condition(key).doors_closed
    drive = {"seconds": seconds, "outcome": outcome, "passed": passed}
    leg = Leg(session=f"s{number}", closed=closed, **drive)
    entries = [
        PageVisit("About you", "/q/", 0.0, 3.0, words=200, questions=6),
        PageVisit("Exploration", "/drive/", 0.0, seconds),
    ]
    return Diary(number, "completes", code="ABCD", entries=entries, legs=[leg], **more)


def played(*diaries, first=None, **more):
    """The report on bots; `first` replaces fields of the record of the first one's drive."""
    records = {
        one.legs[0].session: DriveRecord(KEYS[one.number % len(KEYS)], one.legs[0].outcome)
        for one in diaries
        if one.legs
    }
    if first:
        records["s0"] = dataclasses.replace(records["s0"], **first)
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
    (problem,) = (one for one in report.problems if "No bot completed the task" in one)
    assert KEYS[-1] in problem


def test_a_short_time_limit_is_a_problem_with_a_longer_one_proposed():
    bots = one_bot_for_each_condition()
    bots[0].legs[0].seconds = 500.0
    (problem,) = played(*bots).problems
    assert "allow 21" in problem


def test_a_stuck_form_is_a_problem_that_names_the_bot():
    stuck = Diary(9, "completes", stuck="“About you” does not continue")
    problems = played(*one_bot_for_each_condition(), stuck).problems
    assert any("Bot 9" in problem and "About you" in problem for problem in problems)


def test_a_bot_that_got_no_code_is_a_problem():
    bots = one_bot_for_each_condition()
    bots[2] = dataclasses.replace(bots[2], code="")
    assert played(*bots).problems == ["Bot 2 finished the study but got no completion code."]


def test_a_setting_that_was_not_applied_as_assigned_is_a_problem():
    report = played(*one_bot_for_each_condition(), first={"mismatches": ("assist",)})
    sentence = f"Condition {KEYS[0]}: A setting was not applied as assigned: assist."
    assert report.problems == [sentence]


def test_empty_columns_are_notes_and_missing_figures_are_problems():
    more = {"empty_columns": ("ict.use",), "not_drawn": ("figure_7, because of an error",)}
    report = played(*one_bot_for_each_condition(), **more)
    assert "No bot gave a value for ict.use." in report.notes
    assert report.problems == ["Not drawn: figure_7, because of an error."]


def test_practice_counts_as_no_drive_of_the_condition():
    report = played(*one_bot_for_each_condition(), first={"practice": True})
    assert report.conditions[0].drives == 0


def test_the_report_has_the_participants_that_an_effect_needs():
    power = played(*one_bot_for_each_condition()).power
    assert [need["effect"] for need in power] == [0.2, 0.5, 0.8]


def test_a_rehearsal_without_bots_does_not_pass():
    report = judge(STUDY, [], Findings())
    assert not report.passed
    assert report.expected_minutes == 0.0


def test_a_drive_whose_replay_differs_from_its_record_is_a_problem():
    sentence = "Session s1: a replay ends as cancelled, but completed is stored."
    report = played(*one_bot_for_each_condition(), discrepancies=(sentence,))
    assert report.problems[-1].endswith(sentence)
