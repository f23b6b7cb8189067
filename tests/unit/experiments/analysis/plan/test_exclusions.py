"""The rules of a plan find whom they exclude, with the value that they found."""

from dataclasses import replace

import pytest

from experiments.analysis.plan.reporting_sheet import reporting_sheet
from experiments.analysis.tables.flow import flow
from experiments.dataset.counting import counting
from experiments.dataset.exclusions import excluded_participants
from experiments.dataset.records import (
    Dataset,
    PageRecord,
    ParticipantRecord,
    ResponseRecord,
    SessionRecord,
)
from tests.support.analysis.every_ending import every_ending
from tests.support.analysis.planned import plan_with, planned_study
from tests.support.studies.studies import STUDY


def dataset(plan, *, seconds=(30.0, 32.0, 34.0), given=(2, 2, 2), **more):
    """Three participants, P0 to P2, who each drive one condition and answer about it."""
    people, sessions, pages, responses = [], [], [], []
    drive = {"condition": "shut", "outcome": "completed", "first_motion": 1.0}
    for who, time, answer in zip(("P0", "P1", "P2"), seconds, given, strict=True):
        session, asked = f"s-{who}", {"q1": answer}
        people.append(ParticipantRecord(who, cell="shut"))
        sessions.append(SessionRecord(session, who, "giraff", **drive))
        pages.append(PageRecord(who, "experience", session, time))
        responses.append(ResponseRecord(f"r-{who}", "experience", who, asked, session=session))
    return Dataset(
        planned_study(plan),
        participants=tuple(people),
        sessions=tuple(sessions),
        pages=tuple(pages),
        responses=tuple(responses),
        **more,
    )


def found(data):
    return [(one.participant, one.rule, one.value) for one in counting(data).exclusions]


def check(answer="2"):
    return {"questionnaire": "experience", "item": "q1", "answer": answer}


def test_a_wrong_answer_to_an_attention_check_excludes():
    data = dataset(plan_with(attention_checks=[check()]), given=(2, -1, 2.0))
    value = "experience.q1: -1, right is 2"
    assert found(data) == [("P1", "attention check", value)]


def test_an_attention_check_that_was_skipped_is_failed_and_one_not_asked_is_not():
    data = dataset(plan_with(attention_checks=[check()]))
    reasons = ("skipped", "not_asked", "withheld")
    silent = tuple(
        replace(one, values={}, missing={"q1": reason})
        for one, reason in zip(data.responses, reasons, strict=True)
    )
    data = replace(data, responses=silent)
    assert [who for who, *_ in found(data)] == ["P0"]


def test_fast_page_of_a_round_without_a_drive_excludes_nobody():
    rule = {"questionnaire": "experience", "seconds": 10}
    data = dataset(plan_with(speeders=[rule]))
    assert found(replace(data, pages=(*data.pages, PageRecord("P0", "experience", "", 3.0)))) == []
    earlier = tuple(replace(one, session="", seconds=3.0) for one in data.pages)
    assert len(found(replace(data, pages=earlier))) == 3, "earlier releases noted no session"


HALF = "experience: 4.0 s, less than 16.0 s (0.5 of the median of 32.0 s)"


@pytest.mark.parametrize(
    ("rule", "answer"),
    [
        ({"seconds": 10}, "experience: 4.0 s, less than 10 s"),
        ({"median_share": 0.5}, HALF),
        ({"seconds": 10, "median_share": 0.5}, HALF),
    ],
)
def test_a_speeder_is_faster_than_seconds_or_a_share_of_the_median(rule, answer):
    plan = plan_with(speeders=[{"questionnaire": "experience", **rule}])
    assert found(dataset(plan, seconds=(4.0, 32.0, 40.0))) == [("P0", "speeder", answer)]
    assert found(dataset(plan, seconds=(30.0, 32.0, 40.0))) == []


def test_pages_about_drives_that_do_not_count_are_not_judged():
    plan = plan_with(speeders=[{"questionnaire": "experience", "seconds": 10}])
    data = dataset(plan, seconds=(4.0, 4.0, 4.0))
    never, excluded, counts = data.sessions
    sessions = (replace(never, practice=True), replace(excluded, excluded="a visitor"), counts)
    assert [
        who for who, rule, _ in found(replace(data, sessions=sessions)) if rule == "speeder"
    ] == ["P2"]


def test_each_step_that_asks_a_questionnaire_has_a_median_of_its_own():
    plan = plan_with(speeders=[{"questionnaire": "experience", "median_share": 0.5}])
    data = dataset(plan, seconds=(30.0, 32.0, 34.0))
    before = {"kind": "questionnaire", "key": "before", "questionnaire": "experience"}
    steps = [{**before, "title": {"en": "Before"}}, *STUDY["steps"]]
    first = [replace(one, step="experience") for one in data.responses]
    pages = [replace(one, step="before", seconds=one.seconds / 10.0) for one in data.pages]
    again = [replace(one, id=f"{one.id}-before", step="before") for one in data.responses]
    study = planned_study(plan, steps=steps)
    both = {"pages": (*data.pages, *pages), "responses": (*first, *again)}
    assert found(replace(data, study=study, **both)) == []


def test_incomplete_cases_lack_a_drive_or_answers():
    data = dataset(plan_with(incomplete="answers"))
    still = replace(data.sessions[0], first_frame=1.0, first_motion=float("nan"))
    rows = {"sessions": (still, *data.sessions[1:]), "responses": data.responses[:2]}
    data = Dataset(data.study, participants=data.participants, **rows)
    assert found(data) == [
        ("P0", "incomplete", "no drive of shut"),
        ("P2", "incomplete", "no answers to experience (shut)"),
    ]


def test_nobody_is_incomplete_who_was_not_exposed_or_still_drives():
    found = counting(every_ending(plan_with(incomplete="drives")))
    lacking = [one.participant for one in found.exclusions if one.rule == "incomplete"]
    assert lacking == ["fault", "still", "visitor"]
    sheet = {
        row[1].text: row[2].text for row in reporting_sheet(found, (), found.participants).rows
    }
    assert sheet["excluded by the plan's rules"] == "3 participants"
    assert sheet["incomplete"] == "3 cases"
    lines = {(row[0].text, row[2].text): row[3].value for row in flow(found).rows}
    assert lines["all", "among them: excluded by the plan's rules"] == 3


def test_reporting_sheet_and_flow_count_the_same_drivers():
    found = counting(every_ending())
    sheet = {
        row[1].text: row[2].text for row in reporting_sheet(found, (), found.participants).rows
    }
    lines = {(row[0].text, row[1].text): row[3].value for row in flow(found).rows}
    assert int(sheet["drove a robot"]) == lines["all", "drove"] == 9


def test_platform_faults_and_researchers_exclude_sessions_but_no_participant():
    data = dataset(None)
    first, second, third = data.sessions
    first = replace(first, fault_side="platform", fault_part="web_process")
    second = replace(second, excluded="a visitor looked on")
    data = replace(data, sessions=(first, second, third))
    assert found(data) == [
        ("P0", "platform fault", "platform fault: web process away"),
        ("P1", "researcher's decision", "a visitor looked on"),
    ]
    assert excluded_participants(counting(data).exclusions) == frozenset()
    assert not any(one.planned for one in counting(data).exclusions)
