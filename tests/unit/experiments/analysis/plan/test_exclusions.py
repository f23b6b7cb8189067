"""The rules of a plan find whom they exclude, with the value that they found."""

from dataclasses import replace

import pytest

from experiments.dataset.counting import counting
from experiments.dataset.exclusions import excluded_participants
from experiments.dataset.records import (
    Dataset,
    PageRecord,
    ParticipantRecord,
    ResponseRecord,
    SessionRecord,
)
from tests.support.analysis.planned import plan_with, planned_study


def dataset(plan, *, seconds=(30.0, 32.0, 34.0), given=(2, 2, 2), **more):
    """Three participants, P0 to P2, who each drive one condition and answer about it."""
    people = [f"P{n}" for n in range(3)]
    return Dataset(
        planned_study(plan),
        participants=tuple(ParticipantRecord(who, cell="shut") for who in people),
        sessions=tuple(
            SessionRecord(
                f"s-{who}", who, "giraff", condition="shut", outcome="completed", first_motion=1.0
            )
            for who in people
        ),
        pages=tuple(
            PageRecord(who, "experience", f"s-{who}", time)
            for who, time in zip(people, seconds, strict=True)
        ),
        responses=tuple(
            ResponseRecord(f"r-{who}", "experience", who, {"q1": answer}, session=f"s-{who}")
            for who, answer in zip(people, given, strict=True)
        ),
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
    silent = [
        ResponseRecord(
            f"r-{n}", "experience", f"P{n}", {}, session=f"s-P{n}", missing={"q1": reason}
        )
        for n, reason in enumerate(("skipped", "not_asked", "withheld"))
    ]
    data = replace(data, responses=tuple(silent))
    assert [who for who, *_ in found(data)] == ["P0"]


@pytest.mark.parametrize(
    ("rule", "answer"),
    [
        ({"seconds": 10}, "experience: 4.0 s, less than 10 s"),
        (
            {"median_share": 0.5},
            "experience: 4.0 s, less than 16.0 s (0.5 of the median of 32.0 s)",
        ),
        (
            {"seconds": 10, "median_share": 0.5},
            "experience: 4.0 s, less than 16.0 s (0.5 of the median of 32.0 s)",
        ),
    ],
)
def test_a_speeder_is_faster_than_seconds_or_a_share_of_the_median(rule, answer):
    plan = plan_with(speeders=[{"questionnaire": "experience", **rule}])
    assert found(dataset(plan, seconds=(4.0, 32.0, 40.0))) == [("P0", "speeder", answer)]
    assert found(dataset(plan, seconds=(30.0, 32.0, 40.0))) == []


def test_incomplete_cases_lack_a_drive_or_answers():
    data = dataset(plan_with(incomplete="answers"))
    data = Dataset(
        data.study,
        participants=(*data.participants, ParticipantRecord("P3")),
        sessions=data.sessions[1:],
        responses=data.responses[:2],
    )
    assert found(data) == [
        ("P0", "incomplete", "no drive of shut"),
        ("P2", "incomplete", "no answers to experience (shut)"),
        ("P3", "incomplete", "never assigned to a condition"),
    ]


def test_platform_faults_and_researchers_exclude_a_session_and_nobody():
    data = dataset(None)
    first, second, third = data.sessions
    data = replace(
        data,
        sessions=(
            replace(first, fault_side="platform", fault_part="web_process"),
            replace(second, excluded="a visitor looked on"),
            third,
        ),
    )
    assert found(data) == [
        ("P0", "platform fault", "platform fault: web process away"),
        ("P1", "researcher's decision", "a visitor looked on"),
    ]
    assert excluded_participants(counting(data).exclusions) == frozenset()
    assert not any(one.planned for one in counting(data).exclusions)
