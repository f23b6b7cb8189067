import json
import re

import msgspec
import pytest

from experiments.definition.feasibility import Known, RobotFacts, obstacles
from experiments.definition.problems import MAX_BYTES, parse, problems
from experiments.definition.schema import StudyDefinition, digest, from_stored, to_json
from experiments.definition.shipped import shipped
from robots.api.floorplan import FloorPlan
from robots.world.robot_models import MODELS
from robots.world.sites import load_plan
from surveys.document_forms.problem_text import sentences
from surveys.documents import BadDefinitionError
from surveys.questionnaires import shipped as shipped_questionnaires
from tests.support.studies.studies import PLAN, STUDY, cabin, small_study

ALL = frozenset({"velocity", "goto", "follow", "dock", "undock", "tilt", "assist"})
GIRAFF = RobotFacts(ALL, 0.7)


def known(plan: FloorPlan | None = None, robot: RobotFacts = GIRAFF) -> Known:
    return Known({"cabin": plan or cabin()}, {"giraff": robot}, frozenset({("experience", 1)}))


def here(study: StudyDefinition, **of_known) -> list[str]:
    return sentences(obstacles(study, known(**of_known)))


def changed(part: str, index: int, **fields) -> dict:
    items = json.loads(json.dumps(STUDY[part]))
    items[index].update(fields)
    return {part: items}


def written(**changes) -> bytes:
    """The file of the small study, with some of it replaced."""
    return json.dumps({**STUDY, **changes}).encode()


def test_a_study_is_the_same_after_export_and_import():
    study = small_study()
    assert parse(to_json(study)) == study
    assert from_stored(json.loads(to_json(study))) == study
    assert not here(study)


def test_the_digest_changes_with_any_field_and_with_no_other_spelling():
    study = small_study()
    assert digest(study) == digest(parse(to_json(study).replace(b"\n", b"\n\n")))
    written_out = {"speed": {}, "assist": "off", "network": {"control": None}, "doors_closed": []}
    spelt = changed("conditions", 0, **written_out)
    same = small_study(**spelt, allocation={"design": "between"}, intro={})
    assert digest(study) == digest(same)
    others = [
        small_study(**changed("conditions", 0, assist="slow")),
        small_study(version=2),
        small_study(quality={"longest_gap": 3.0}),
    ]
    assert len({digest(study), *map(digest, others)}) == 4


def test_the_shipped_studies_can_be_run_in_the_office():
    asked = [one for one in shipped_questionnaires().values() if not one.template]
    questionnaires = frozenset((one.slug, one.version) for one in asked)
    robots = {name: RobotFacts(ALL, model.limits.linear) for name, model in MODELS.items()}
    sites = {"office": load_plan("office")[0]}
    assert set(shipped()) == {"exploration", "assistance"}
    for study in shipped().values():
        assert sentences(obstacles(study, Known(sites, robots, questionnaires))) == []


def test_the_shipped_courses_are_the_sites_own_routes():
    plan = load_plan("office")[0]
    for study in shipped().values():
        for course in study.courses:
            route = plan.route_of(course.robot)
            assert [(c.number, c.x, c.y, c.radius, c.title["en"]) for c in course.checkpoints] == [
                (c.number, c.x, c.y, c.radius, c.title) for c in route.checkpoints
            ]
            assert course.path == route.path


def test_papers_study_has_no_assistance_and_asks_only_giraffs_drivers_for_a_photo():
    study = shipped()["exploration"]
    assert {condition.assist for condition in study.conditions} == {"off"}
    assert {action for condition in study.conditions for action in condition.actions} == {"tilt"}
    rhodons = [condition for condition in study.conditions if condition.robot == "rhodon"]
    assert {condition.access for condition in rhodons} == {"invitation"}
    photos = {course.robot: course.photo is not None for course in study.courses}
    assert photos == {"giraff": True, "rhodon": False}
    assert study.task.minutes == 15.0
    assert study.analysis.interval == "normal"


def test_participants_of_the_second_study_drive_with_and_without_assistance():
    study = shipped()["assistance"]
    assert study.allocation.design == "within"
    found = {condition.key: condition.assist for condition in study.conditions}
    assert found == {"alone": "off", "assisted": "steer"}


TASK, ASKED = STUDY["steps"]
STOPS = STUDY["courses"][0]["checkpoints"]


def step(kind: str, **fields) -> dict:
    return {"kind": kind, "key": "own", "title": {"en": "Own"}, **fields}


def network(**ways) -> dict:
    return changed("conditions", 0, network=ways)


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        (changed("courses", 0, checkpoints=[]), "there is no checkpoint; add"),
        (
            changed("courses", 0, checkpoints=STOPS[:1]),
            "no checkpoint besides the charging station",
        ),
        ({"courses": []}, "there is no course for giraff at cabin"),
        ({"courses": STUDY["courses"] * 2}, "Course “giraff, cabin” appears 2 times"),
        (changed("courses", 0, checkpoints=STOPS[::-1]), "numbered [2, 1, 0]"),
        (
            changed("courses", 0, photo={"checkpoint": 7, "mirror": "mirror"}),
            "checkpoint 7, which does not exist",
        ),
        (changed("courses", 0, site="elsewhere"), "no condition uses it"),
        (changed("conditions", 1, key="all_open"), "Condition “all_open” appears 2 times"),
        (changed("conditions", 0, controllers=[]), "nobody could drive"),
        (
            changed("conditions", 0, speed={"linear": 0.01}),
            "takes longer than the task's 5 minutes",
        ),
        (
            network(control={"delay": 0.1, "jitter": 0.2}),
            "towards the robot: the jitter varies the delay both ways, so it cannot be greater",
        ),
        (
            network(video={"loss": 0.6}),
            "back from the camera: more than 50% of the packets would be lost",
        ),
        (
            network(control={"bitrate": 9000}),
            "towards the robot: the bit rate is below 50 kbit/s",
        ),
        (
            network(video={"bitrate": 100_000}),
            "back from the camera: the bit rate is below 150 kbit/s",
        ),
        ({"conditions": []}, "There is no condition"),
        ({"steps": [ASKED]}, "There are 0 task steps"),
        ({"steps": [TASK, TASK, ASKED]}, "There are 2 task steps"),
        (
            {"steps": [TASK]},
            "“Questionnaire in the tables” is experience, which this study does not ask",
        ),
        (
            {"steps": [TASK, ASKED, step("consent", text={"en": "yes?"})]},
            "must be the first step",
        ),
        ({"steps": [step("debrief", text={"en": "bye"}), TASK, ASKED]}, "must be the last step"),
        ({"steps": [TASK, ASKED, step("instructions", leaves=[])]}, "there is no page to read"),
        ({"allocation": {"design": "within"}}, "the task must be repeated"),
        (
            {"screening": [{"questionnaire": "experience", "item": "q1", "at_least": 0}]},
            "asks the questionnaire experience only after the task",
        ),
        ({"refill": {"outcomes": ["robot_fault"]}}, "needs both outcomes and a number"),
        (
            {"refill": {"outcomes": ["completed"], "most": 1}},
            "The participant replacement (refill) cannot include outcomes of the task itself",
        ),
        (changed("steps", 0, last_minutes=9), "longer than the task"),
        ({"languages": ["en", "es"]}, "study.title has no text in es"),
        ({"title": {"en": "  "}}, "study.title has no text in en"),
        ({"title": {"en": "a\x00b"}}, "null character"),
        ({"slug": "link"}, "reserved for other addresses of the site"),
    ],
)
def test_contradictions_in_a_study_are_named_with_their_place(changes, sentence):
    found = sentences(problems(small_study(**changes)))
    assert any(sentence in problem for problem in found), found


@pytest.mark.parametrize(("order", "most"), [("all", 4), ("balanced", 9), ("fixed", 9)])
def test_one_condition_more_than_can_be_ordered_is_too_many_for_one_participant(order, most):
    conditions = [{**STUDY["conditions"][0], "key": f"c{n}"} for n in range(most + 1)]
    steps = [{**STUDY["steps"][0], "repeat": True}, STUDY["steps"][1]]
    allocation = {"design": "within", "order": order}
    study = small_study(conditions=conditions, steps=steps, allocation=allocation)
    found = sentences(problems(study))
    assert found == [f"{most + 1} conditions for each participant; at most {most} can be ordered."]


@pytest.mark.parametrize(
    ("document", "message"),
    [
        (b"", "This is not valid JSON"),
        (b"\xff\xfe", "This is not valid JSON"),
        (b"[" * 100_000, "Expected `object`"),
        (b"{}", "missing required field"),
        (written(stepz=[]), "unknown field `stepz`"),
        (written(format=2), "$.format"),
        (written(**changed("conditions", 0, assist="much")), "$.conditions[0].assist"),
        (written(**network(control={"dealy": 1})), "unknown field `dealy`"),
        (written(**network(control={"loss": 2})), "network.control.loss"),
        (written(**changed("steps", 0, minutes=-1)), "$.steps[0].minutes"),
        (b" " * (MAX_BYTES + 1), "larger than 1024 kB"),
    ],
)
def test_a_broken_file_is_refused_with_the_place_in_it(document, message):
    with pytest.raises(BadDefinitionError, match=re.escape(message)):
        parse(document)


def plan_with(**changes) -> FloorPlan:
    return msgspec.convert({**PLAN, **changes}, FloorPlan)


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        (changed("courses", 0, dock="nowhere"), "no charging station nowhere"),
        (changed("courses", 0, doors=["gate"]), "there is no door gate"),
        (
            changed("courses", 0, photo={"checkpoint": 2, "mirror": "pond"}),
            "there is no mirror pond",
        ),
        (changed("conditions", 1, doors_closed=["gate"]), "there is no door gate to close"),
        (changed("conditions", 1, interface="fancy"), "no interface profile fancy"),
        (changed("steps", 1, questionnaire="sus"), "no usable questionnaire sus, version 1"),
    ],
)
def test_study_with_things_that_its_site_lacks_is_impossible(changes, sentence):
    assert any(sentence in problem for problem in here(small_study(**changes)))


DOCK = PLAN["docks"][0]


@pytest.mark.parametrize(
    ("docks", "sentence"),
    [
        ([DOCK, {**DOCK, "name": "second", "y": 3.2}], "there are 2 charging stations for giraff"),
        ([{**DOCK, "type": "rhodon"}], "no charging station of the course fits giraff"),
        ([{**DOCK, "y": 3.2}], "checkpoint 0 is not at the charging station home"),
    ],
)
def test_charging_station_of_a_course_must_be_unique_fit_and_be_its_start(docks, sentence):
    plan = plan_with(docks=docks)
    assert any(sentence in problem for problem in here(small_study(), plan=plan))


def test_course_can_name_its_charging_station():
    plan = plan_with(docks=[DOCK, {**DOCK, "name": "second", "y": 3.2}])
    assert not here(small_study(**changed("courses", 0, dock="home")), plan=plan)


def test_a_checkpoint_behind_the_only_door_cannot_be_reached_when_that_is_closed():
    archway = {"start": [4.1, 2.6], "end": [4.1, 3.6], "thickness": 0.2}
    plan = plan_with(walls=[*PLAN["walls"], archway], passages=[])
    assert here(small_study(), plan=plan) == [
        "Condition shut: checkpoint 2 cannot be reached from the charging station with door closed."
    ]


def test_a_checkpoint_outside_of_the_rooms_is_a_problem():
    points = [*STOPS[:2], {"number": 2, "x": 20, "y": 20}]
    found = here(small_study(**changed("courses", 0, checkpoints=points)))
    assert any("checkpoint 2 is not in a room" in problem for problem in found)


def test_missing_capabilities_of_a_robot_are_listed():
    study = small_study(**changed("conditions", 0, actions=["map", "dock"], assist="slow"))
    found = here(study, robot=RobotFacts(frozenset({"velocity"}), 0.7))
    assert found == [
        "Condition all_open: giraff cannot do the action map.",
        "Condition all_open: giraff cannot do the action dock.",
        "Condition all_open: giraff cannot do assistance slow.",
    ]


def test_a_robot_too_slow_for_the_time_limit_is_a_problem():
    found = here(small_study(), robot=RobotFacts(ALL, 0.02))
    assert any("the top speed of giraff, the course takes longer" in problem for problem in found)


def test_missing_site_and_robots_are_listed_together():
    found = sentences(obstacles(small_study(), Known({}, {}, frozenset())))
    assert "Course of giraff at cabin: there is no site cabin." in found
    assert "Condition all_open: there is no robot of the series giraff." in found
