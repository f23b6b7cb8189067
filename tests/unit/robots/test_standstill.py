import pytest

from robots.presence.report import fault_of, is_stopped_there, standstill_of

FAULT = {"inhibited": "fault"}
RUNS_ON = "runs_on: the robot keeps moving although it was told to stop"


@pytest.mark.parametrize(
    ("report", "why"),
    [
        ({"safety": {"estop": True, "inhibited": "estop"}, "errors": ["rival: x"]}, "estop"),
        ({"safety": FAULT, "errors": ["adapter_lost: no answer"]}, "not_connected"),
        ({"safety": FAULT, "errors": ["rival: another agent runs"]}, "fault"),
        ({"safety": {"inhibited": "no_lease"}, "errors": ["lens dirty"]}, ""),
        ({"safety": {"inhibited": "no_lease"}, "errors": ["lens dirty", RUNS_ON]}, "fault"),
        ({"safety": {"estop": True}, "errors": [RUNS_ON]}, "estop"),
        ({"safety": {"inhibited": "collision"}}, ""),
        ({}, ""),
        (None, ""),
        ({"safety": 3, "errors": 7}, ""),
    ],
)
def test_a_robot_stands_still_for_everybody_for_its_stop_or_a_fault(report, why):
    assert standstill_of(report) == why


def test_a_stop_was_pressed_there_at_the_screen_or_the_robots_own_button():
    told = {
        source: is_stopped_there({"safety": {"estopSource": source}})
        for source in ("screen:Giraff", "button", "owner:Ana", "driver", "", None)
    }
    assert [source for source, there in told.items() if there] == ["screen:Giraff", "button"]


def test_a_fault_is_shown_by_its_text():
    assert fault_of({"errors": ["rival: another agent runs"]}).startswith("another agent runs as")
    assert [fault_of(report) for report in ({}, None, {"errors": []}, {"errors": [1]})] == [""] * 4


def test_of_several_faults_the_one_told_is_that_the_robot_does_not_stop():
    report = {"errors": ["lens dirty", RUNS_ON]}
    assert fault_of(report) == "the robot keeps moving although it was told to stop"
