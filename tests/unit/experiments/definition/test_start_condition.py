"""Whether a robot is as a study wants it before a participant gets it: decided on what it last
said.
"""

from dataclasses import replace

import pytest

from experiments.definition.schema import Start
from experiments.definition.start_condition import RobotSnapshot, snapshot, unmet
from robots.api.geometry import Pose2D

DOCK = Pose2D(0.5, 6.3, 3.14159)
HOME = RobotSnapshot(docked=True, pose=DOCK, charge=0.9)


@pytest.mark.parametrize(
    ("robot", "why"),
    [
        (HOME, ""),
        (None, "silent"),
        (replace(HOME, docked=False), "not_docked"),
        (replace(HOME, pose=None), "lost"),
        (replace(HOME, pose=Pose2D(0.85, 6.3, 3.14159)), "elsewhere"),
        (replace(HOME, pose=Pose2D(0.5, 6.3, -2.7)), "elsewhere"),
        (replace(HOME, pose=Pose2D(0.55, 6.25, -3.1)), ""),
        (replace(HOME, charge=0.49), "charge"),
        (replace(HOME, charge=None), ""),
    ],
)
def test_a_drive_begins_only_as_the_study_wants_it(robot, why):
    assert unmet(Start(charge=0.5), robot, DOCK) == why


def test_a_study_may_begin_anywhere():
    assert unmet(Start(docked=False), RobotSnapshot(), DOCK) == ""


def test_snapshot_is_read_from_stored_state():
    state = {"docked": True, "pose": {"x": 1.0, "y": 2.0, "theta": 0.1}, "battery": {"charge": 0.4}}
    found = snapshot(state)
    assert found == RobotSnapshot(docked=True, pose=Pose2D(1.0, 2.0, 0.1), charge=0.4)
    assert found.as_stored() == {"docked": True, "x": 1.0, "y": 2.0, "theta": 0.1, "charge": 0.4}
    lost = snapshot(
        {
            "pose": {"x": 1.0, "y": 2.0, "theta": 0.1, "localized": False},
            "battery": {"charge": None},
        }
    )
    assert lost == RobotSnapshot()
    assert snapshot({}).as_stored() == {
        "docked": False,
        "x": None,
        "y": None,
        "theta": None,
        "charge": None,
    }
