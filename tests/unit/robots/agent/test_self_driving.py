"""A robot whose navigation runs in the agent, or whose RCA assists."""

from dataclasses import replace

import pytest

from docs.robot_api import examples
from robots.agent.ramp import ZERO
from robots.agent.robot_interface import Navigating
from robots.api import messages as m
from robots.api.geometry import Pose2D
from tests.support.agents.control_rig import ControlRig
from tests.support.agents.scripted_robot import PROFILE, ScriptedRobot, SelfDrivingRobot

ABLE = replace(PROFILE, capabilities=(*PROFILE.capabilities, "assist"))


@pytest.fixture
def rig(tmp_path):
    robot = SelfDrivingRobot(profile=ABLE)
    robot.finishes = False
    with ControlRig(tmp_path, robot=robot) as rig:
        yield rig


def goto(action_id="g1"):
    return m.Goto(action_id=action_id, stamp=0.0, session="s1", epoch=1, x=1.0, y=1.0)


def test_only_an_adapter_that_offers_all_of_it_drives_by_itself():
    assert isinstance(SelfDrivingRobot(), Navigating)
    assert not isinstance(ScriptedRobot(), Navigating)


def test_navigation_drives_within_the_lease_and_a_visitor_takes_over(
    rig,
):
    rig.grant(limits=m.LeaseLimits(linear=0.25))
    rig.robot.wish = m.Velocity(linear=0.6, angular=0.0)
    rig.act(goto())
    rig.wait(lambda: rig.robot.told == m.Velocity(linear=0.25, angular=0.0))
    rig.drive(
        0.1, until=lambda: any(status.status == "CANCELLED" for status in rig.link.all("action"))
    )
    assert rig.status("g1", "CANCELLED").reason == "manual"
    assert rig.robot.told.linear > 0.0, "it did not have to stand for that"
    rig.drive(0.2)
    assert rig.kernel.navigation is None


def test_a_stop_brakes_what_navigation_began(rig):
    rig.grant()
    rig.robot.wish = m.Velocity(linear=0.5, angular=0.0)
    rig.act(goto())
    rig.wait(lambda: rig.robot.told.linear == 0.5)
    rig.act(m.Stop(action_id="stop-1", stamp=0.0), way="datachannel", peer="p2")
    rig.wait(lambda: rig.robot.told == ZERO)
    assert rig.status("g1", "CANCELLED").reason == "stopped"


def test_how_much_is_assisted_is_said_by_config_and_by_the_lease_that_overrules_it(rig):
    rig.link.say("config", m.Config(stamp=1.0, assist="slow"), retained=True)
    rig.wait(lambda: rig.kernel.assist.level == "slow")
    rig.grant(assist="steer")
    rig.wait(lambda: rig.kernel.assist.level == "steer")
    assert rig.link.wait("state", lambda s: s.assist == "steer").mode == "assisted"


def test_the_servers_map_is_handed_to_the_adapter(rig):
    update = examples()["floorplan"]["full"]
    rig.link.say("floorplan", update, retained=True)
    rig.wait(lambda: rig.robot.floorplans == [update])


def test_pages_hear_what_the_assistance_minds_and_which_way_the_robot_goes(rig):
    rig.robot.reading = replace(
        rig.robot.reading,
        assist_why="obstacle",
        assist_point=(0.5, 0.1),
        path=((0.0, 0.0), (1.0, 1.0)),
    )
    assert rig.link.wait("state", lambda s: s.assist_why == "obstacle").assist_point == (0.5, 0.1)
    assert rig.link.wait("path").points == ((0.0, 0.0), (1.0, 1.0))
    again = rig.link.count
    rig.link.wait("path", since=again)
    rig.robot.reading = replace(rig.robot.reading, path=())
    rig.link.wait("path", lambda p: p.points == ())


@pytest.mark.parametrize(
    "nonsense",
    [
        {"odometry": Pose2D(float("nan"), 0.0, 0.0)},
        {"path": ((float("inf"), 0.0),)},
        {"assist_point": (1e9, 0.0)},
    ],
)
def test_odometry_paths_and_points_that_cannot_be_are_nonsense(rig, nonsense):
    rig.robot.reading = replace(rig.robot.reading, **nonsense)
    assert "nonsense" in rig.link.wait("event", lambda e: e.type == "adapter_lost").detail
