"""When a robot can have a safety test: only free, at rest, and away from its station."""

import pytest

from sessions.leases.policy import ActiveSession, Hold, Scene
from sessions.safety_test.rules import TestConditions as Conditions, why_not

NOW = 1000.0
IDLE = {"mode": "manual", "safety": {}, "docked": False}


def reason(scene=None, *, report=None, **robot):
    fields = {"capabilities": ("safety_test",), "is_returning": False, "was_stopped": False}
    conditions = Conditions(**fields | robot | {"report": IDLE | (report or {})})
    return why_not(scene or Scene(Hold(1)), conditions, NOW)


def session(state, **fields):
    return ActiveSession("s1", "ada", state, 900.0, **fields)


def test_an_idle_free_robot_can_be_tested():
    assert reason() == ""


def test_a_robot_whose_queue_is_paused_can_be_tested():
    assert reason(Scene(Hold(1), pause="held: cleaning")) == ""


@pytest.mark.parametrize(
    ("scene", "expected"),
    [
        (Scene(Hold(1), online=False), "offline"),
        (Scene(Hold(1), enabled=False), "offline"),
        (Scene(Hold(1, "s1"), (session("driving"),)), "driven"),
        (Scene(Hold(1, "s1"), (session("reconnecting"),)), "driven"),
        (Scene(Hold(1), (session("waiting", seen_at=NOW),)), "queue"),
        (Scene(Hold(1), (session("waiting", seen_at=NOW - 600),)), ""),
    ],
    ids=["offline", "disabled", "driven", "reconnecting", "queue", "a page that is gone"],
)
def test_it_waits_for_visitors_and_for_the_robot(scene, expected):
    assert reason(scene) == expected


@pytest.mark.parametrize(
    ("report", "expected"),
    [
        ({"safety": {"estop": True}}, "estop"),
        ({"safety": {"inhibited": "fault"}}, "fault"),
        ({"errors": ["runs_on: it moves"]}, "fault"),
        ({"errors": ["adapter_lost: no answer"]}, "not_connected"),
        ({"safety": {"inhibited": "stopped"}}, "stopped"),
        ({"docked": True}, "docked"),
        ({"battery": {"charge": 0.5, "charging": True}}, "docked"),
        ({"mode": "goto"}, "navigating"),
        ({"mode": "docking"}, "navigating"),
    ],
)
def test_a_robot_in_another_state_is_refused_with_the_reason(report, expected):
    assert reason(report=report) == expected


def test_a_robot_that_leaves_its_station_by_itself_can_be_tested_there():
    able = ("safety_test", "undock")
    assert reason(report={"docked": True}, capabilities=able) == ""


def test_a_robot_on_the_way_to_its_dock_one_that_was_stopped_and_an_old_agent_are_refused():
    assert reason(is_returning=True) == "navigating"
    assert reason(was_stopped=True) == "stopped"
    assert reason(capabilities=("velocity",)) == "unsupported"
