"""The configuration of the drive page for a study."""

import json

import msgspec
import pytest
from django.core.serializers.json import DjangoJSONEncoder

from experiments.definition.course import CourseError
from experiments.definition.shipped import shipped
from experiments.definition.steps.practice import Practice
from experiments.participation import drive_config
from robots.world.sites import load_plan
from tests.support.studies.studies import STUDY, cabin, small_study

STEP = "/studies/cabin-study/step/"


def guide(study=None, *keys, language="en", **changes):
    study = study or small_study(**changes)
    conditions = [study.condition(key) for key in keys or ("all_open",)]
    return drive_config.guide(
        study, study.task, conditions, cabin(), language=language, step_url=STEP
    )


def test_the_page_gets_the_course_with_the_docks_place_and_where_the_study_goes_on():
    page = guide()
    assert page["kind"] == "task"
    assert [
        (stop["number"], stop["x"], stop["y"], stop["radius"]) for stop in page["checkpoints"]
    ] == [
        (0, 0.5, 2, 0.6),
        (1, 3, 1, 0.6),
        (2, 7, 2, 0.6),
    ]
    assert page["dock"] == {"x": 0.5, "y": 2.0, "theta": pytest.approx(3.14159)}
    assert page["doors"] == ("door",)
    assert page["photo"] == {"checkpoint": 2}
    assert (page["minutes"], page["lastMinutes"]) == (5, 2)
    assert page["urls"] == {"step": STEP}


def test_all_of_it_can_be_written_into_the_page():
    for study in shipped().values():
        for condition in study.conditions:
            page = drive_config.guide(
                study,
                study.task,
                [condition],
                load_plan(condition.site)[0],
                language="es",
                step_url=STEP,
            )
            assert json.loads(json.dumps(page, cls=DjangoJSONEncoder))["controllers"]


def test_texts_are_in_the_participants_language():
    study = shipped()["exploration"]
    page = drive_config.guide(
        study,
        study.task,
        [study.condition("giraff_open")],
        load_plan("office")[0],
        language="es",
        step_url=STEP,
    )
    assert page["title"] == "Exploración"
    assert page["checkpoints"][4]["title"] == "Delante del espejo"
    assert [zone["title"] for zone in page["zones"]] == ["Pasillo", "Laboratorio", "Sala de estar"]


def test_a_condition_says_what_may_be_used_and_stops_and_photos_are_never_kept_from_anybody():
    page = guide()
    assert (page["controllers"], page["ownActions"], page["assist"], page["interface"]) == (
        ["keyboard"],
        [],
        "off",
        "standard",
    )
    assert {"stop", "estop", "photo", "relocalize"} <= set(page["actions"])
    assert not {"goto", "dock", "undock"} & set(page["actions"])


def test_before_the_assignment_the_page_offers_what_any_condition_allows_and_fixes_what_all_share():
    first, second = STUDY["conditions"]
    conditions = [
        {**first, "actions": ["places"]},
        {**second, "controllers": ["stick"], "assist": "slow"},
    ]
    page = guide(None, "all_open", "shut", conditions=conditions)
    assert page["controllers"] == ["keyboard", "stick"]
    assert page["ownActions"] == ["places"]
    assert "goto" in page["actions"]
    assert page["assist"] is None
    assert page["interface"] == "standard"


def test_a_practice_drive_has_no_checkpoints_and_no_photo():
    study = small_study()
    page = drive_config.guide(
        study,
        Practice(key="try", title={"en": "Try it"}),
        [study.conditions[0]],
        cabin(),
        language="en",
        step_url=STEP,
    )
    assert (page["kind"], page["minutes"], page["checkpoints"], page["photo"], page["dock"]) == (
        "practice",
        3.0,
        [],
        None,
        None,
    )


def test_a_drive_without_conditions_is_refused():
    study = small_study()
    with pytest.raises(CourseError, match="conditions: none"):
        drive_config.guide(study, study.task, [], cabin(), language="en", step_url=STEP)


def test_conditions_on_different_courses_give_no_page():
    study = shipped()["exploration"]
    both = [study.condition("giraff_open"), study.condition("rhodon_open")]
    with pytest.raises(CourseError, match="has no single course"):
        drive_config.guide(
            study, study.task, both, load_plan("office")[0], language="en", step_url=STEP
        )


def test_a_plan_without_the_courses_station_is_refused():
    study = small_study()
    bare = msgspec.structs.replace(cabin(), docks=())
    with pytest.raises(CourseError, match="no charging station"):
        drive_config.guide(
            study, study.task, [study.conditions[0]], bare, language="en", step_url=STEP
        )


def test_after_a_drive_the_page_says_what_really_comes_next():
    steps = {step.key: step for step in shipped()["assistance"].steps}

    def after(*keys):
        return drive_config.what_follows([steps[key] for key in keys])

    assert after(
        "workload", "experience", "practice", "task", "workload", "experience", "thanks"
    ) == ("Questions are next, then you drive again.")
    assert after("workload", "experience", "thanks") == "The last questions are next."
    assert after("task", "workload", "thanks") == "Another drive is next."
    assert after("instructions", "task") == "The study continues with the next step."
    assert after("thanks") == after() == "That was the last part of the study."
