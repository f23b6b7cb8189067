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


def guide(study=None, *keys, step=None, plan=None, language="en", **changes):
    study = study or small_study(**changes)
    conditions = [study.condition(key) for key in keys]
    plan, about = plan or cabin(), {"language": language, "step_url": STEP}
    return drive_config.guide(study, step or study.task, conditions, plan, **about)


def test_the_page_gets_the_course_with_the_docks_place_and_where_the_study_goes_on():
    page = guide(None, "all_open")
    assert page["kind"] == "task"
    stops = [
        [stop[name] for name in ("number", "x", "y", "radius")] for stop in page["checkpoints"]
    ]
    assert stops == [[0, 0.5, 2, 0.6], [1, 3, 1, 0.6], [2, 7, 2, 0.6]]
    assert page["dock"] == {"x": 0.5, "y": 2.0, "theta": pytest.approx(3.14159)}
    assert page["doors"] == ("door",)
    assert page["photo"] == {"checkpoint": 2}
    assert (page["minutes"], page["lastMinutes"]) == (5, 2)
    assert page["urls"] == {"step": STEP}


def test_all_of_it_can_be_written_into_the_page():
    for study in shipped().values():
        for condition in study.conditions:
            page = guide(study, condition.key, plan=load_plan(condition.site)[0], language="es")
            assert json.loads(json.dumps(page, cls=DjangoJSONEncoder))["controllers"]


def test_texts_are_in_the_participants_language():
    study = shipped()["exploration"]
    page = guide(study, "giraff_open", plan=load_plan("office")[0], language="es")
    assert page["title"] == "Exploración"
    assert page["checkpoints"][4]["title"] == "Delante del espejo"
    assert [zone["title"] for zone in page["zones"]] == ["Pasillo", "Laboratorio", "Sala de estar"]


def test_condition_limits_controls_but_never_stops_and_photos():
    page = guide(None, "all_open")
    assert (page["controllers"], page["ownActions"]) == (["keyboard"], [])
    assert (page["assist"], page["interface"]) == ("off", "standard")
    assert {"stop", "estop", "photo", "relocalize"} <= set(page["actions"])
    assert not {"goto", "dock", "undock"} & set(page["actions"])


def test_page_before_assignment_offers_what_any_condition_allows():
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
    page = guide(None, "all_open", step=Practice(key="try", title={"en": "Try it"}))
    assert (page["kind"], page["minutes"], page["checkpoints"]) == ("practice", 3.0, [])
    assert (page["photo"], page["dock"]) == (None, None)


def test_a_drive_without_conditions_is_refused():
    with pytest.raises(CourseError, match="conditions: none"):
        guide()


def test_conditions_on_different_courses_give_no_page():
    study, plan = shipped()["exploration"], load_plan("office")[0]
    with pytest.raises(CourseError, match="has no single course"):
        guide(study, "giraff_open", "rhodon_open", plan=plan)


def test_a_plan_without_the_courses_station_is_refused():
    bare = msgspec.structs.replace(cabin(), docks=())
    with pytest.raises(CourseError, match="no charging station"):
        guide(None, "all_open", plan=bare)


def test_page_after_a_drive_names_the_next_step():
    steps = {step.key: step for step in shipped()["assistance"].steps}

    def after(*keys):
        return drive_config.what_follows([steps[key] for key in keys])

    again = ("workload", "experience", "practice", "task", "workload", "experience", "thanks")
    assert after(*again) == "Questions are next, then you drive again."
    assert after("workload", "experience", "thanks") == "The last questions are next."
    assert after("task", "workload", "thanks") == "Another drive is next."
    assert after("instructions", "task") == "The study continues with the next step."
    assert after("thanks") == after() == "That was the last part of the study."
