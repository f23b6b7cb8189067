"""Questionnaires that a study asks before and after the drive, or once after all conditions, in the
export and in the report.
"""

import csv
import datetime
import io
import json

import msgspec
import pytest
from django.utils import timezone

from experiments.analysis.quality import answer_flags
from experiments.analysis.report import reports
from experiments.export.archive import unpacked
from experiments.export.files import export_files
from experiments.extraction.build import dataset_of
from experiments.extraction.selection import Selection
from experiments.models import Participant, StepVisit
from experiments.resources import measures_here
from tests.support.analysis.tables import rows, value
from tests.support.people import person
from tests.support.studies import participants as p

pytestmark = pytest.mark.django_db
BEFORE = {"kind": "questionnaire", "key": "before", "title": {"en": "Before", "es": "Antes"}}
TLX = ("mental", "physical", "temporal", "performance", "effort", "frustration")
STATEMENTS = [f"q{n}" for n in range(1, 9)]


def at(participant, step, number=0):
    Participant.objects.filter(pk=participant.pk).update(step=step, round=number)
    participant.refresh_from_db()


def drives(robot, participant, number=0, **how):
    at(participant, "task", number)
    how = {"outcome": "completed", "moved": True, **how}
    return p.drive_of(robot, participant, number=number + 1, **how)


def table(study, folder, path):
    list(unpacked(export_files(study, Selection()), folder))
    return list(csv.DictReader(io.StringIO((folder / "data" / f"{path}_data.csv").read_text())))


def tables_of(study):
    return {one.name: one for one in next(reports(dataset_of(study))).tables}


@pytest.fixture
def pre_post():
    """A study between participants that asks `experience` before and after the task; one
    participant answered −2 before and +2 after it, and another only before.
    """
    steps = msgspec.to_builtins(p.of("exploration"))["steps"]
    task = [one["kind"] for one in steps].index("task")
    steps = [*steps[:task], {**BEFORE, "questionnaire": "experience"}, *steps[task:]]
    study = p.published(p.of("exploration", steps=steps, analyses=[], plan=None))
    robot = p.site()
    one = p.assign(p.comer(study, person()), "giraff_open")
    p.respond(one, "before", dict.fromkeys(STATEMENTS, -2))
    drives(robot, one)
    p.respond(one, "experience", dict.fromkeys(STATEMENTS, 2))
    other = p.assign(p.comer(study, person("bob")), "giraff_open")
    p.respond(other, "before", dict.fromkeys(STATEMENTS, -2))
    drives(robot, other)
    return study


def test_a_questionnaire_before_and_after_the_drive_is_two_variables(pre_post, tmp_path):
    found = tables_of(pre_post)
    before = found["scores-experience-before"]
    after = found["scores-experience-experience"]
    assert [value(one, 0, "Mean") for one in (before, after)] == [-2.0, 2.0]
    assert "Asked at the step before (Before), before the task." in before.notes
    assert "Asked at the step experience (Your experience), after the task." in after.notes
    assert value(found["table-5"], 0, "Mean") == 2.0, "of the last step"
    flow = dict(rows(found["flow"], "Reason", "Participants"))
    assert flow["analysed: answers to experience.before"] == "2"
    assert flow["analysed: answers to experience.experience"] == "1"
    both = table(pre_post, tmp_path, "description-conditions")
    scores = [
        (row["experience.before.overall"], row["experience.experience.overall"]) for row in both
    ]
    assert sorted(scores) == [("-2", ""), ("-2", "2")]


def test_researchers_choose_the_measures_of_each_step_in_its_order(pre_post):
    groups = measures_here(pre_post.as_definition())
    steps = [title for title in groups if title.endswith((" (before)", " (experience)"))]
    first, second = (groups[title] for title in steps)
    assert "– Before (before)" in steps[0]
    assert "experience.before.overall" in first
    assert "experience.experience.overall" in second
    assert max(len(group) for group in groups.values()) < 20, "metrics have several groups"


def test_an_export_has_the_step_that_asked_in_the_order_of_the_study(pre_post, tmp_path):
    responses = table(pre_post, tmp_path, "questionnaire-experience")
    assert {row["step"]: row["q1"] for row in responses} == {"before": "-2", "experience": "2"}
    answers = table(pre_post, tmp_path, "description-answers")
    assert {row["step"]: row["value"] for row in answers if row["item"] == "q1"} == {
        "before": "-2",
        "experience": "2",
    }
    book = json.loads((tmp_path / "dataset_description.json").read_text())["variableMeasured"]
    (step,) = (
        one
        for one in book
        if one["name"] == "step" and one["description"].startswith("experience: ")
    )
    assert [one["description"] for one in step["valueReference"]] == [
        "questionnaire, before the task: Before",
        "questionnaire, after the task: Your experience",
    ]


@pytest.fixture
def asked_once():
    """A study within participants that asks `workload` once, after both conditions, and what the
    robot has of two participants who drove both, and of one who drove `alone` only.
    """
    steps = [*msgspec.to_builtins(p.of("assistance"))["steps"]]
    (workload,) = (one for one in steps if one["key"] == "workload")
    steps.remove(workload)
    steps.insert(len(steps) - 1, {**workload, "repeat": False})
    study = p.published(p.of("assistance", steps=steps, analyses=[], plan=None))
    robot = p.site()
    for n in range(3):
        one = p.assign(p.comer(study, person(f"p{n}")), *("alone", "assisted")[:: 1 - n % 2 * 2])
        drives(robot, one)
        if n < 2:
            drives(robot, one, 1)
        p.respond(one, "workload", dict.fromkeys(TLX, 10 + 30 * n), number=1, finished=n < 2)
    return study


def test_a_questionnaire_asked_once_belongs_to_no_condition(asked_once, tmp_path):
    assert {one.session for one in dataset_of(asked_once).responses} == {""}
    scores = tables_of(asked_once)["scores-tlx"]
    assert rows(scores, "Condition", "n", "Mean")[0] == ("–", "2", "25.00")
    assert "score-tests-tlx" not in tables_of(asked_once)
    row, *_ = table(asked_once, tmp_path, "description-conditions")
    assert not [name for name in row if name.startswith("tlx.")]


def test_a_condition_without_a_drive_says_so_and_has_no_values(asked_once, tmp_path):
    found = table(asked_once, tmp_path, "description-conditions")
    (lacking,) = (row for row in found if row["sessions"] == "0")
    assert (lacking["condition"], lacking["counts"], lacking["counts_why"]) == (
        "assisted",
        "0",
        "no_drive",
    )
    assert not any(lacking[name] for name in ("completed", "path", "session"))


def test_unfinished_responses_and_drives_that_do_not_count_have_no_score(tmp_path):
    study, robot = p.published(p.of("exploration")), p.site()
    for n in range(4):
        one = p.assign(p.comer(study, person(f"p{n}")), "giraff_open")
        outcome = "completed" if n < 2 else "cancelled"
        drives(robot, one, outcome=outcome, moved=n != 2, exposed_at=timezone.now())
        p.respond(one, "experience", dict.fromkeys(STATEMENTS, n - 1), finished=n != 1)
        if n == 3:
            one.drives.update(excluded_reason="a visitor")
    lines = table(study, tmp_path, "description-conditions")
    found = {(row["counts"], row["attempted"], row["counts_why"]): row for row in lines}
    scores = {key: row["experience.overall"] for key, row in found.items()}
    assert scores[("0", "1", "not_driven")] == scores[("0", "0", "excluded")] == ""
    assert found[("0", "1", "not_driven")]["completed"] == "0"
    assert found[("0", "0", "excluded")]["completed"] == ""
    counting = [row["experience.overall"] for row in lines if row["counts"] == "1"]
    assert sorted(counting) == ["", "-1"], "an unfinished response has no score"


@pytest.mark.parametrize(("rule", "score"), [("first", "1"), ("last", "2"), ("all", "1.5")])
def test_an_export_counts_the_same_response_as_the_report(rule, score, tmp_path):
    study = p.published(p.of("exploration", analysis={"counts": rule, "drives": "all"}))
    robot = p.site()
    one = p.assign(p.comer(study, person()), "giraff_open")
    for visit in (1, 2):
        Participant.objects.filter(pk=one.pk).update(visit=visit)
        one.refresh_from_db()
        drives(robot, one)
        p.respond(one, "experience", dict.fromkeys(STATEMENTS, visit))
    (row,) = table(study, tmp_path, "description-conditions")
    assert row["experience.overall"] == score
    assert float(score) == value(tables_of(study)["scores-experience"], 0, "Mean")


def test_fast_answers_are_flagged_in_a_study_between_participants():
    study, robot, now = p.published(p.of("exploration")), p.site(), timezone.now()
    one = p.assign(p.comer(study, person()), "giraff_open")
    drive = drives(robot, one)
    p.respond(one, "experience", dict.fromkeys(STATEMENTS, 1))
    finished = now + datetime.timedelta(seconds=0.5)
    place = {"visit": 1, "round": 0, "step": "experience"}
    StepVisit.objects.create(participant=one, **place, began_at=now, finished_at=finished)
    dataset = dataset_of(study)
    (flag,) = (one for one in answer_flags(dataset) if one.name == "speeding")
    assert flag.session == dataset.sessions[0].id
    assert drive.participant == one
