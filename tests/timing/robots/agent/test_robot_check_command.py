"""`run_robot NAME --check` on the simulated robot, on ROS 1, and interrupted."""

import asyncio
import dataclasses
import signal
import subprocess
import sys
import time

import pytest

from robots.agent.adapters import registry
from robots.agent.config import ConfigError
from robots.agent.control.navigation_check import NavigationCheck
from robots.agent.control.observed_robot import ObservedRobot
from robots.agent.control.robot_check import RobotCheck, check_robot
from robots.api.messages import Pose
from tests.support.architectures.ros1_processes import Ros1Processes
from tests.support.architectures.ros1_robot import Ros1Rig
from tests.support.paths import ROOT
from tests.support.patience import patient
from tests.support.programs.finished import run

SIMULATED = ["giraff", "--check", "--adapter", "simulator"]
AGENT = [sys.executable, "-m", "robots.agent", *SIMULATED]


def test_simulated_robot_passes(tmp_path):
    done = run(sys.executable, "manage.py", "run_robot", *SIMULATED, "--yes", "--var", tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "it keeps the watchdog of 0.3 s" in done.stdout
    assert "Laser: yes." in done.stdout
    assert "Camera: 640 x 480." in done.stdout


def test_robot_does_not_move_without_a_yes(tmp_path):
    done = run(*AGENT, "--var", tmp_path, input="no\n")
    assert done.returncode == 1
    assert "The robot was not moved" in done.stderr
    assert "Driving" not in done.stdout


def test_robot_without_an_adapter_is_not_checked(tmp_path):
    with pytest.raises(ConfigError, match="add --adapter"):
        check_robot({"robot": "giraff", "var": tmp_path}, print)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_signal_ends_a_check_that_was_started_with_signals_ignored(tmp_path, number):
    child = subprocess.Popen(
        [*AGENT, "--yes", "--var", str(tmp_path)],
        cwd=ROOT,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_IGN),
    )
    try:
        assert any("Driving" in line for line in child.stdout)
        child.send_signal(number)
        began = time.monotonic()
        _, errors = child.communicate(timeout=patient(15.0))
        assert child.returncode == 1
        assert "Stopped at your request" in errors
        assert time.monotonic() - began < patient(6.0)
    finally:
        child.kill()
        child.wait()


def test_robot_of_ros_1_is_checked_through_its_adapter():
    with Ros1Rig() as rig:
        lines = []

        async def tried():
            adapter = rig.adapter()
            return await RobotCheck(adapter, lines.append, video=adapter.video()).run()

        assert asyncio.run(tried()), lines
        assert any("it keeps the watchdog of 0.6 s" in line for line in lines)
        assert "Navigation is guarded: " in lines[-1]
        assert rig.world.commands[-1][1] == 0.0


@pytest.mark.parametrize(
    ("options", "topic", "is_well", "words"),
    [
        pytest.param(
            {}, "/cmd_vel", True, "Navigation is guarded: ", marks=pytest.mark.nightly, id="guarded"
        ),
        pytest.param(
            {"navigation_velocity": "/cmd_vel_nav"},
            "/cmd_vel_nav",
            True,
            "Navigation passes through the agent: ",
            id="through the agent",
        ),
        pytest.param(
            {"navigation_velocity": "/cmd_vel_nav"},
            "/cmd_vel",
            False,
            "Navigation does not pass through the agent: ",
            id="past the agent",
        ),
    ],
)
def test_check_reports_what_stops_the_navigation_of_real_nodes(
    tmp_path, options, topic, is_well, words
):
    with Ros1Processes(tmp_path) as nodes, nodes.planner("obeys", topic):
        adapter, lines = registry.create("ros1", "rhodon", nodes.options | options), []
        adapter.states = localized(adapter.states)

        async def tried():
            robot = ObservedRobot(adapter)
            try:
                await robot.connect()
                await robot.first_reading()
                return await NavigationCheck(robot, lines.append).run()
            finally:
                await robot.leave()

        assert asyncio.run(tried()) is is_well, lines
        assert words in lines[-1]
        moving = [
            row for row in nodes.base.events(time.monotonic() - 0.3) if row.get("v", 0) > 0.03
        ]
        assert not moving, "the robot is at rest after the check"


def localized(states):
    """Readings with a position, which the nodes of the test do not publish."""

    async def readings():
        async for state in states():
            place = Pose(x=state.odometry.x, y=state.odometry.y, theta=state.odometry.theta)
            yield dataclasses.replace(state, pose=place)

    return readings
