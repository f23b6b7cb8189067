"""What the drive page is told of a study."""

import datetime
import json

import msgspec
import pytest
from django.core.serializers.json import DjangoJSONEncoder

from accounts.models import User
from experiments.definition import schema
from experiments.definition.course import CourseError
from experiments.definition.shipped import shipped
from experiments.definition.steps.practice import Practice
from experiments.models import Drive, Participant
from experiments.models import Study as StudyRow
from experiments.participation import drive_config
from robots.world.sites import load_plan
from tests.support.studies.studies import STUDY, cabin, small_study

NOW = datetime.datetime(2026, 3, 2, 9, 0, tzinfo=datetime.UTC)
STEP = "/studies/cabin-study/step/"


def guide(study=None, *keys, language="en", **changes):
    study = study or small_study(**changes)
    conditions = [study.condition(key) for key in keys or ("all_open",)]
    return drive_config.guide(
        study, study.task, conditions, cabin(), language=language, step_url=STEP
    )


def participant(step="task", **changes):
    study = small_study(**changes)
    row = StudyRow(
        slug=study.slug,
        version=1,
        title="Cabin",
        definition=msgspec.to_builtins(study),
        sha256=schema.digest(study),
        created_at=NOW,
    )
    return Participant(
        study=row, user=User(username="ana"), slot="s", step=step, created_at=NOW, seen_at=NOW
    )


def test_the_page_is_told_the_course_with_the_docks_own_place_and_where_the_study_goes_on():
    told = guide()
    assert told["kind"] == "task"
    assert [
        (stop["number"], stop["x"], stop["y"], stop["radius"]) for stop in told["checkpoints"]
    ] == [
        (0, 0.5, 2, 0.6),
        (1, 3, 1, 0.6),
        (2, 7, 2, 0.6),
    ]
    assert told["dock"] == {"x": 0.5, "y": 2.0, "theta": pytest.approx(3.14159)}
    assert told["doors"] == ("door",)
    assert told["photo"] == {"checkpoint": 2}
    assert (told["minutes"], told["lastMinutes"]) == (5, 2)
    assert told["urls"] == {"step": STEP}


def test_all_of_it_can_be_written_into_the_page():
    for study in shipped().values():
        for condition in study.conditions:
            told = drive_config.guide(
                study,
                study.task,
                [condition],
                load_plan(condition.site)[0],
                language="es",
                step_url=STEP,
            )
            assert json.loads(json.dumps(told, cls=DjangoJSONEncoder))["controllers"]


def test_texts_are_in_the_participants_language():
    study = shipped()["exploration"]
    told = drive_config.guide(
        study,
        study.task,
        [study.condition("giraff_open")],
        load_plan("office")[0],
        language="es",
        step_url=STEP,
    )
    assert told["title"] == "Exploración"
    assert told["checkpoints"][4]["title"] == "Delante del espejo"
    assert [zone["title"] for zone in told["zones"]] == ["Pasillo", "Laboratorio", "Sala de estar"]


def test_a_condition_says_what_may_be_used_and_stops_and_photos_are_never_kept_from_anybody():
    told = guide()
    assert (told["controllers"], told["ownActions"], told["assist"], told["interface"]) == (
        ["keyboard"],
        [],
        "off",
        "standard",
    )
    assert {"stop", "estop", "photo", "relocalize"} <= set(told["actions"])
    assert not {"goto", "dock", "undock"} & set(told["actions"])


def test_before_the_assignment_the_page_offers_what_any_condition_allows_and_fixes_what_all_share():
    first, second = STUDY["conditions"]
    conditions = [
        {**first, "actions": ["places"]},
        {**second, "controllers": ["stick"], "assist": "slow"},
    ]
    told = guide(None, "all_open", "shut", conditions=conditions)
    assert told["controllers"] == ["keyboard", "stick"]
    assert told["ownActions"] == ["places"]
    assert "goto" in told["actions"]
    assert told["assist"] is None
    assert told["interface"] == "standard"


def test_a_practice_drive_has_no_checkpoints_and_no_photo():
    study = small_study()
    told = drive_config.guide(
        study,
        Practice(key="try", title={"en": "Try it"}),
        [study.conditions[0]],
        cabin(),
        language="en",
        step_url=STEP,
    )
    assert (told["kind"], told["minutes"], told["checkpoints"], told["photo"], told["dock"]) == (
        "practice",
        3.0,
        [],
        None,
        None,
    )


def test_a_drive_gives_its_own_condition():
    drive = Drive(condition="shut")
    told = drive_config.config(participant(), drive, cabin(), step_url=STEP)
    assert told["title"] == "Task"
    assert told == drive_config.config(
        participant(), small_study().condition("shut"), cabin(), step_url=STEP
    )


@pytest.mark.parametrize(
    ("step", "choice", "what"),
    [
        (
            "experience",
            small_study().condition("shut"),
            "step 'experience' of cabin-study has no drive",
        ),
        ("nowhere", small_study().condition("shut"), "step 'nowhere' of cabin-study has no drive"),
        ("task", [], "conditions: none"),
        ("task", Drive(condition="gone"), "conditions: none"),
    ],
)
def test_what_cannot_be_driven_is_refused_with_the_reason(step, choice, what):
    with pytest.raises(CourseError, match=what):
        drive_config.config(participant(step), choice, cabin(), step_url=STEP)


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

    def said(*keys):
        return drive_config.what_follows([steps[key] for key in keys])

    assert said(
        "workload", "experience", "practice", "task", "workload", "experience", "thanks"
    ) == ("Questions are next, then you drive again.")
    assert said("workload", "experience", "thanks") == "The last questions are next."
    assert said("task", "workload", "thanks") == "Another drive is next."
    assert said("instructions", "task") == "The study continues with the next step."
    assert said("thanks") == said() == "That was the last part of the study."
