import datetime

import pytest

from robots.admin_pages.owner_status import owner_status
from tests.support.robots import unsaved_robot

NOW = datetime.datetime(2026, 3, 1, 12, 0, tzinfo=datetime.UTC)
AWAY = {"connection": "OFFLINE", "last_seen_at": NOW - datetime.timedelta(hours=3)}
LOST = {"errors": ["adapter_lost: no ROS master at http://robot:11311"]}

STOPPED = {"safety": {"estop": True, "estopSource": "screen:Giraff"}}
FAULT = {"safety": {"inhibited": "fault"}, "errors": ["rival: another agent runs"]}

RUNS_ON = {"safety": {"inhibited": "no_lease"}, "errors": ["runs_on: the robot keeps moving"]}


def shown(*, in_use: bool = False, **changes):
    fields = {
        "name": "giraff",
        "title": "Giraff",
        "connection": "ONLINE",
        "last_seen_at": NOW,
        "credential_hash": "$7$",
        "report": {"battery": {"charge": 0.824}},
    }
    return owner_status(unsaved_robot(**(fields | changes)), in_use=in_use, now=NOW)


@pytest.mark.parametrize(
    ("changes", "tone", "label", "says"),
    [
        ({}, "good", "Free now", "ready for visitors"),
        ({"shown_to_visitors": False}, "attention", "Hidden", "Select “Show to visitors” below"),
        ({"in_use": True}, "busy", "In use", "Somebody is driving"),
        ({"enabled": False}, "off", "Disabled", "Select “Enabled” below"),
        ({"connection": "OFFLINE", "last_seen_at": None}, "off", "New", "Run the command below"),
        (AWAY, "bad", "Offline", "Last seen 3\xa0hours ago. Check that its computer is on"),
        (AWAY | {"credential_hash": ""}, "bad", "Offline", "Create a command below"),
        ({"report": {"safety": {"estop": True}}}, "bad", "Stopped", "Release it at the robot"),
        ({"report": STOPPED}, "bad", "Stopped", "Stopped by someone next to it. Release"),
        (
            {"report": FAULT},
            "bad",
            "Not available",
            "Has a fault: another agent runs as",
        ),
        (
            {"report": {"safety": FAULT["safety"]}},
            "bad",
            "Not available",
            "Has a fault: not specified.",
        ),
        (
            {"report": RUNS_ON},
            "bad",
            "Not available",
            "Has a fault: the robot keeps moving although it was told to stop. Nobody",
        ),
        ({"report": LOST}, "bad", "Not available", "no ROS master at http://robot:11311"),
        ({"held": "lunch"}, "attention", "Not ready", "lunch. Resume them"),
        ({"turnaround": "charging"}, "busy", "Charging", "as soon as it is ready"),
        (
            {"turnaround": "paused", "turnaround_reason": "not_docked"},
            "attention",
            "Not ready",
            "it is not docked. It tries again by itself.",
        ),
    ],
)
def test_an_owner_gets_one_state_and_the_next_step(changes, tone, label, says):
    it = shown(**changes)
    assert (it.tone, it.label) == (tone, label)
    assert says in it.sentence


def test_a_stop_of_a_driven_hidden_robot_is_listed_first():
    report = {"safety": {"estop": True}}
    assert shown(in_use=True, shown_to_visitors=False, report=report).label == "Stopped"


def test_the_battery_of_an_absent_robot_is_unknown():
    assert (shown().battery, shown(**AWAY).battery) == ("82 %", "")


def test_a_robot_that_was_online_is_connected():
    assert shown(**AWAY).connected
    assert not shown(connection="OFFLINE", last_seen_at=None).connected
