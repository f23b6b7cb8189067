"""Pages of the instructions that only some conditions have."""

import pytest

from experiments.analysis.plan.preregistration import preregistration
from experiments.definition.problems import problems
from experiments.participation.assignment import stage_now
from surveys.document_forms.problem_text import sentences
from tests.support.studies.studies import STUDY, small_study

SHARED, OWN = {"text": {"en": "Drive."}}, {"text": {"en": "A door is shut."}}


def study_with(own: str = "shut", *, repeat: bool = False, **changes):
    pages = [SHARED, {**OWN, "conditions": [own]}]
    read = {"kind": "instructions", "key": "read", "title": {"en": "Read"}, "leaves": pages}
    steps = [{**read, "repeat": repeat}, {**STUDY["steps"][0], "repeat": repeat}, STUDY["steps"][1]]
    return small_study(steps=steps, **changes)


def test_a_page_for_some_conditions_is_part_of_a_study_without_problems():
    study = study_with()
    assert sentences(problems(study)) == []
    assert (study.has_condition_specific_pages, small_study().has_condition_specific_pages) == (
        True,
        False,
    )
    read = study.step("read")
    assert (read.own_pages("shut"), read.own_pages("all_open")) == ((2,), ())


def test_a_page_for_a_condition_that_does_not_exist_is_a_problem():
    assert sentences(problems(study_with("gone"))) == ["Step read: there is no condition gone."]


def test_participants_of_several_conditions_read_it_in_each_round():
    within = {"design": "within"}
    (found, *_) = sentences(problems(study_with(allocation=within)))
    assert "repeated" in found
    assert any(
        "Step read: it has pages for some conditions" in one
        for one in sentences(problems(study_with(allocation=within)))
    )
    assert sentences(problems(study_with(allocation=within, repeat=True))) == []


def test_preregistration_names_the_readers_of_pages_and_the_time_of_assignment():
    text = preregistration(study_with(), None)
    assert "pages 2 of the instructions `read`, for some conditions only" in text
    assert "Before reading instructions that depend on the condition, a participant" in text
    assert "On first getting the robot, a participant" in preregistration(small_study(), None)


@pytest.mark.parametrize(
    ("done", "is_gone", "stage"),
    [(0, True, "left"), (0, False, "under_way"), (1, True, "under_way")],
)
def test_informed_participant_frees_the_place_only_after_leaving_undriven(done, is_gone, stage):
    found = stage_now("under_way", conditions=1, done=done, is_gone=is_gone, knows_condition=True)
    assert found == stage
    assert stage_now("under_way", conditions=1, done=done, is_gone=is_gone) == "under_way"
