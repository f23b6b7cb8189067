"""A robot whose navigation runs in the agent, or whose RCA assists."""

from dataclasses import replace

import pytest

from docs.robot_api import examples
from robots.agent.robot_interface import Navigating
from robots.api import messages as m
from tests.support.agents.control_rig import ControlRig, own
from tests.support.agents.scripted_robot import PROFILE, ScriptedRobot, SelfDrivingRobot

ABLE = replace(PROFILE, capabilities=(*PROFILE.capabilities, "assist"))


@pytest.fixture
def rig(tmp_path):
    robot = SelfDrivingRobot(profile=ABLE)
    robot.finishes = False
    with ControlRig(tmp_path, robot=robot) as rig:
        yield rig


def test_only_an_adapter_that_offers_all_of_it_drives_by_itself():
    assert isinstance(SelfDrivingRobot(), Navigating)
    assert not isinstance(ScriptedRobot(), Navigating)


def test_navigation_drives_within_the_lease_and_a_visitor_takes_over_in_motion(rig):
    rig.grant(limits=m.LeaseLimits(linear=0.25))
    rig.robot.wish = m.Velocity(linear=0.6, angular=0.0)
    rig.act(own(m.Goto, x=1.0, y=1.0))
    rig.wait(lambda: rig.robot.told == m.Velocity(linear=0.25, angular=0.0))
    rig.drive(0.1, until=lambda: rig.link.all("action")[-1].status == "CANCELLED")
    assert rig.status("a1", "CANCELLED").reason == "manual"
    assert rig.robot.told.linear > 0.0
    rig.drive(0.2)
    assert rig.kernel.navigation is None


def test_the_assistance_of_the_lease_overrides_that_of_the_config(rig):
    rig.link.say("config", m.Config(stamp=1.0, assist="slow"), retained=True)
    rig.wait(lambda: rig.kernel.assist.level == "slow")
    rig.grant(assist="steer")
    rig.wait(lambda: rig.kernel.assist.level == "steer")
    assert rig.link.wait("state", lambda s: s.assist == "steer").mode == "assisted"


def test_the_adapter_receives_the_servers_map(rig):
    update = examples()["floorplan"]["full"]
    rig.link.say("floorplan", update, retained=True)
    rig.wait(lambda: rig.robot.floorplans == [update])


def test_pages_receive_the_reason_of_the_assistance_and_the_path(rig):
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
