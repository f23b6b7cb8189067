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
def test_a_stop_or_a_fault_prevents_every_drive(report, why):
    assert standstill_of(report) == why


def test_a_stop_at_the_robot_is_from_its_screen_or_its_button():
    pressed = {
        source: is_stopped_there({"safety": {"estopSource": source}})
        for source in ("screen:Giraff", "button", "owner:Ana", "driver", "", None)
    }
    assert [source for source, there in pressed.items() if there] == ["screen:Giraff", "button"]


def test_a_fault_is_shown_by_its_text():
    assert fault_of({"errors": ["rival: another agent runs"]}).startswith("another agent runs as")
    assert [fault_of(report) for report in ({}, None, {"errors": []}, {"errors": [1]})] == [""] * 4


def test_a_robot_that_does_not_stop_is_the_first_of_several_faults():
    report = {"errors": ["lens dirty", RUNS_ON]}
    assert fault_of(report) == "the robot keeps moving although it was told to stop"
