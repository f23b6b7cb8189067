"""The hidden operator's part of a study."""

import pytest

from experiments.definition import conditions
from experiments.definition.feasibility import Known, RobotFacts, obstacles
from experiments.definition.problems import parse, problems
from experiments.definition.schema import digest, to_json
from experiments.wizard.script import script_of
from sessions.wizard.script import TimedDrive
from surveys.document_forms.problem_text import sentences
from tests.support.studies.studies import STUDY, cabin, small_study
from tests.support.studies.wizard_study import OPERATOR_TEXT, WIZARD, wizard_study

ALL = frozenset({"velocity", "goto", "follow", "dock", "undock", "tilt", "assist", "say"})


def wizard_problems(**wizard):
    return sentences(problems(wizard_study(**wizard)))


def with_steps(*steps):
    return {"stages": [{"key": "s", "title": {"en": "S"}, "steps": list(steps)}]}


def step(key="a", **fields):
    return {"key": key, "title": {"en": key}, "line": {"en": "Hello"}, **fields}


def test_a_study_with_a_hidden_operator_is_right_and_survives_export_and_import():
    study = wizard_study()
    assert wizard_problems() == []
    assert parse(to_json(study)) == study


def test_operators_part_is_part_of_what_is_frozen():
    assert digest(wizard_study()) != digest(small_study())


def test_it_cannot_be_published_before_the_debriefing_tells_of_the_operator():
    for operator in ({}, {"en": "  "}):
        found = sentences(problems(wizard_study(operator=operator)))
        assert any("must tell participants that an operator drove" in one for one in found)
    (found,) = sentences(problems(small_study(wizard=WIZARD)))  # without any debriefing
    assert found.startswith("The debriefing must tell")
    assert wizard_study().operator_text["en"] == OPERATOR_TEXT


@pytest.mark.parametrize(
    ("wizard", "problem"),
    [
        ({"conditions": ["nowhere"]}, "Hidden operator: there is no condition nowhere."),
        ({"stages": [], "by_hand": False}, "no step and driving by hand is off"),
        (
            with_steps(step("a", line={})),
            "Script step a: it needs either a line or a move.",
        ),
        (with_steps(step("a", move={"kind": "dock"})), "either a line or a move"),
        (with_steps(step("a", shortcut="w")), "the key w drives the robot"),
        (with_steps(step("a", shortcut="1"), step("b", shortcut="1")), "1"),
        (with_steps(step("a"), step("a")), "a"),
        (with_steps(step("a", line={"en": "x" * 501})), "longer than 500 characters"),
        (with_steps(step("a", line={}, move={"kind": "drive", "seconds": 2})), "at no speed"),
    ],
)
def test_invalid_script_has_problems(wizard, problem):
    found = wizard_problems(**wizard)
    assert len(found) == 1
    assert problem in found[0]


def test_condition_driven_by_the_operator_alone_needs_no_controller():
    alone = [{**STUDY["conditions"][0], "controllers": [], "actions": []}]
    assert any(
        "nobody could drive" in one for one in sentences(problems(small_study(conditions=alone)))
    )
    assert not sentences(problems(wizard_study(study={"conditions": alone})))


def test_script_steps_beyond_robot_and_site_are_obstacles():
    study = wizard_study(**with_steps(step("a", line={}, move={"kind": "place", "name": "moon"})))
    known = Known(
        {"cabin": cabin()},
        {"giraff": RobotFacts(ALL - {"say", "goto"}, 0.7)},
        frozenset({("experience", 1)}),
    )
    found = sentences(obstacles(study, known))
    assert any("goes to moon, which is not a place there" in one for one in found)
    assert any("step a (goto)" in one for one in found)


def test_the_operators_input_is_no_mismatch_and_the_rest_is():
    study = wizard_study()
    condition = study.conditions[0]
    applied = conditions.Applied(robot=condition.robot, site=condition.site)
    applied.methods, applied.actions, applied.assist = {"script"}, {"dock"}, {"steer"}
    found = conditions.mismatches(condition, applied)
    assert {"controllers", "assist"} <= set(found)
    assert "assist" in conditions.mismatches(condition, applied, by_wizard=True)
    assert "controllers" not in conditions.mismatches(condition, applied, by_wizard=True)


def test_participants_of_a_wizard_condition_have_photos_and_speech_but_no_controller():
    part = conditions.without_driving(wizard_study().conditions[0])
    assert part.controllers == ()
    allowed = conditions.allowed_actions(part)
    assert {"photo", "say", "stop"} <= allowed
    assert not {"goto", "dock", "follow", "tilt"} & allowed


def test_titles_are_in_the_operators_language_and_lines_in_the_participants():
    wizard = wizard_study(
        **with_steps(
            step("a", title={"en": "Greet", "es": "Saludar"}, line={"en": "Hello", "es": "Hola"}),
            step("b", line={}, move={"kind": "turn"}),
            step("c", line={}, move={"kind": "drive", "linear": 0.2, "seconds": 3}),
        )
    ).wizard
    script = script_of(wizard, shown_in="en", spoken_in="es")
    greet, turn, drive = script.steps
    assert (greet.title, greet.text, script.language) == ("Greet", "Hola", "es")
    assert turn.turn == pytest.approx(3.14)
    assert drive.drive == TimedDrive(linear=0.2, seconds=3)
