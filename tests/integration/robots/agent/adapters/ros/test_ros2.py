"""ROS 2 with real rclpy nodes over Fast DDS, each in a process of its own: the conformance suite,
qualities of service, and goals of Nav2's type.
"""

import asyncio
import contextlib
import json
import math
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from robots.agent.adapters import registry
from robots.agent.adapters.ros import base, ros2
from robots.agent.ramp import ZERO
from robots.agent.robot_interface import AdapterError
from robots.api.geometry import Pose2D
from robots.api.messages import Dock, Goto, Velocity
from tests.support.agents.agent_process import wait
from tests.support.architectures.adapter_conformance import drive, some, stands, wait_for
from tests.support.architectures.goal_client import going
from tests.support.architectures.rca_conformance import (
    RcaConformance,
    connected,
    ended,
    heard,
    sees_grey,
)
from tests.support.architectures.rca_world import BEFORE_DOCK
from tests.support.architectures.ros2_robot import PYTHON, Ros2Rig
from tests.support.architectures.ros_robot import STAMPED, RosRobot
from tests.support.paths import ROOT
from tests.support.patience import patient

AHEAD = Velocity(linear=0.25, angular=0.0)
BOOL = "std_msgs/Bool"


class TestGiraff(RcaConformance):
    def make_rig(self, directory):
        return Ros2Rig("giraff")

    async def test_goal_that_is_never_accepted_fails_and_is_cancelled(self, adapter):
        """Without the count of cancels: rcl_action itself answers a cancel of an unknown goal
        (action_server.cpp, execute_cancel_request_received).
        """
        self.rig.world.accept_after = math.inf
        await self.start_goto(adapter)
        last = (await heard(adapter, ended("g"), 20.0))[-1]
        assert (last.status, last.reason) == ("FAILED", "navigation_lost: silent")

    async def test_image_topic_becomes_its_camera(self):
        await sees_grey(self.rig.adapter(image="/camera/compressed"))


class TestGoals:
    """Goals at a planner whose behaviour each test sets."""

    @pytest.fixture(scope="class")
    def shared(self):
        with Ros2Rig("giraff") as rig:
            yield rig

    @pytest.fixture
    def rig(self, shared):
        shared.reset()
        shared.planner(accept=True)
        yield shared
        shared.revive()
        assert not shared.errors

    def goal(self, rig, ahead=3.0):
        place = rig.world.truth.compose(Pose2D(ahead, 0.0, 0.0))
        return {"x": place.x, "y": place.y}

    def goto(self, rig):
        return Goto(action_id="g", stamp=0.0, **self.goal(rig))

    async def moving(self, rig, adapter):
        """Start a goal and wait until the robot moves."""
        await adapter.start(self.goto(rig))
        await wait_for(adapter, lambda _: rig.world.sim.motion.linear > 0.2)

    async def test_rejected_goal_fails_with_the_reason(self, rig):
        rig.planner(accept=False)
        async with connected(rig.adapter()) as adapter:
            await adapter.start(self.goto(rig))
            last = (await heard(adapter, ended("g")))[-1]
        assert (last.status, last.reason) == ("FAILED", "rca: /navigate_to_pose rejected the goal")
        assert rig.world.journey == ""

    async def test_aborted_goal_fails_with_the_planners_reason(self, rig):
        async with connected(rig.adapter()) as adapter:
            await self.moving(rig, adapter)
            rig.loop.call_soon_threadsafe(rig.world.cancel)
            last = (await heard(adapter, ended("g")))[-1]
        assert (last.status, last.reason) == ("FAILED", "rca: no path was found")

    async def test_cancel_is_confirmed_only_when_the_planner_has_ended_the_goal(self, rig):
        async with connected(rig.adapter()) as adapter:
            await self.moving(rig, adapter)
            rig.world.ignored_cancels = math.inf
            assert await adapter.cancel("g") is False
            assert rig.world.journey == "running"
            rig.world.ignored_cancels = 0
            async with asyncio.timeout(patient(3.0)):
                while not await adapter.cancel("g"):
                    assert rig.world.journey == "running"
            assert rig.world.journey == "failed"
            assert (await heard(adapter, ended("g")))[-1].status == "CANCELLED"

    async def test_goal_that_is_accepted_late_is_cancelled_at_once(self, rig, monkeypatch):
        monkeypatch.setattr(base, "ACCEPTANCE", 1.0)
        rig.world.accept_after = 2.5
        async with connected(rig.adapter()) as adapter:
            began = time.monotonic()
            await adapter.start(self.goto(rig))
            last = (await heard(adapter, ended("g")))[-1]
            assert (last.status, last.reason) == ("FAILED", "navigation_lost: silent")
            assert time.monotonic() - began > 2.5
            assert rig.world.journey != "running"
            assert rig.world.sim.distance < 0.3

    async def test_new_goal_is_refused_until_the_planner_has_ended_the_previous_one(self, rig):
        async with connected(rig.adapter()) as adapter:
            await self.moving(rig, adapter)
            rig.world.ignored_cancels = math.inf
            before = rig.goals
            await adapter.cancel("g")
            with pytest.raises(AdapterError):
                await adapter.start(Goto(action_id="h", stamp=0.0, **self.goal(rig)))
            assert rig.goals == before
            rig.world.ignored_cancels = 0

    async def test_goal_without_an_action_server_fails_and_names_the_server(self, rig):
        async with connected(rig.adapter(navigate="/elsewhere")) as adapter:
            await adapter.start(self.goto(rig))
            last = (await heard(adapter, ended("g")))[-1]
        assert last.reason == "rca: there is no action server on /elsewhere"

    def test_guard_repeats_its_cancel_until_the_planner_obeys(self, rig):
        with going(rig) as process:
            rig.world.ignored_cancels = math.inf
            process.send_signal(signal.SIGKILL)
            before = rig.world.cancels
            wait(lambda: rig.world.cancels > before + 2, 4.0)
            assert rig.world.journey == "running"
            rig.world.ignored_cancels = 0
            wait(lambda: rig.world.journey == "failed", 2.0)

    async def test_goal_of_an_earlier_run_is_cancelled_before_connecting(self, rig):
        with going(rig) as process:
            process.send_signal(signal.SIGSTOP)  # so that it does not end what its node holds
            for child in children(process.pid):
                os.kill(child, signal.SIGKILL)  # the guard, too
            process.kill()
            assert rig.world.journey == "running"
            async with connected(rig.adapter()):
                assert rig.world.journey == "failed"
                assert rig.world.sim.motion.linear < 0.05

    async def test_goals_of_other_clients_are_not_cancelled(self, rig):
        send = subprocess.Popen(
            [PYTHON, "-c", OTHER_CLIENT, json.dumps(self.goal(rig))],
            env=os.environ | {"ROS_DOMAIN_ID": str(rig.domain)},
        )
        try:
            wait(lambda: rig.world.sim.motion.linear > 0.2)
            async with connected(rig.adapter()) as adapter:
                await some(adapter.states(), 20)
                assert rig.world.journey == "running"
        finally:
            send.kill()
            send.wait()


OTHER_CLIENT = """
import json, sys, rclpy, time
from nav2_msgs.action import NavigateToPose
from rclpy.action import ActionClient
rclpy.init()
node = rclpy.create_node("rviz")
client = ActionClient(node, NavigateToPose, "/navigate_to_pose")
client.wait_for_server()
goal = NavigateToPose.Goal()
place = json.loads(sys.argv[1])
goal.pose.header.frame_id = "map"
goal.pose.pose.position.x, goal.pose.pose.position.y = place["x"], place["y"]
client.send_goal_async(goal)
rclpy.spin(node)
"""


def children(pid):
    found = Path(f"/proc/{pid}/task/{pid}/children").read_text()
    return [int(each) for each in found.split()]


async def test_docking_right_after_connecting_is_not_ended_by_the_cancel_of_an_earlier_one():
    with Ros2Rig("giraff", late={"/cancel_dock": 1.0}) as rig:
        rig.reset(BEFORE_DOCK["giraff"])
        async with connected(rig.adapter()) as adapter:
            await adapter.start(Dock(action_id="d", stamp=0.0))
            assert rig.world.cancels > 0
            before = rig.world.cancels
            assert (await heard(adapter, ended("d"), 15.0))[-1].status == "FINISHED"
            assert rig.world.cancels == before


# --- qualities of service -------------------------------------------------------------------------

ESTOPS = {"/estop": BOOL, "/estop_latched": BOOL}


@pytest.mark.parametrize("best_effort", [[], ["/odom", "/scan", "/battery_state"]])
async def test_readings_arrive_from_publishers_of_either_reliability(best_effort):
    with Ros2Rig("giraff", best_effort=best_effort) as rig:
        async with connected(rig.adapter()) as adapter:
            await wait_for(adapter, lambda s: s.scan is not None)
            await wait_for(adapter, lambda s: s.battery.voltage is not None)
            await drive(adapter, AHEAD, lambda s: s.velocity.linear > 0.2 and s.errors == ())


async def test_emergency_stop_arrives_from_publishers_of_either_durability():
    with Ros2Rig("giraff", publishes=RosRobot.TOPICS | ESTOPS) as rig:

        async def press(topic, *, pressed):
            rig.tell(topic, {"data": pressed})

        rig.call(press("/estop_latched", pressed=True))  # before a node subscribes
        async with connected(rig.adapter(estop="/estop_latched")) as adapter:
            await wait_for(adapter, lambda s: s.estop is True)
            for pressed in (False, True, False):
                rig.call(press("/estop_latched", pressed=pressed))
                await wait_for(adapter, lambda s, pressed=pressed: s.estop is pressed)
        async with connected(rig.adapter(estop="/estop")) as adapter:
            for pressed in (True, False):
                # repeated: a publisher keeps nothing for a subscription that it has not found yet
                await wait_for(
                    adapter,
                    lambda s, pressed=pressed: s.estop is pressed,
                    act=lambda pressed=pressed: rig.call(press("/estop", pressed=pressed)),
                )


async def test_base_with_incompatible_quality_of_service_is_reported_with_the_policy():
    with Ros2Rig("giraff", listens={"latched": True}) as rig:
        async with connected(rig.adapter()) as adapter:
            state = await wait_for(adapter, lambda s: "incompatible" in "".join(s.errors))
            error = next(each for each in state.errors if "/cmd_vel does not reach" in each)
            assert "Volatile publisher and transient local subscription" in error
            assert "base_driver" in error


async def test_missing_message_package_is_named():
    with pytest.raises(AdapterError, match=r"ROS package tf2_msgs is not installed for .*python"):
        await registry.create(
            "ros2", "giraff", {"python": str(PYTHON), "localization": "tf", "domain": "19"}
        ).connect()


async def test_missing_package_of_the_bumper_is_named_and_driving_still_works(monkeypatch):
    monkeypatch.setattr(base, "BOOL", "std9_msgs/Bool")
    with Ros2Rig("giraff") as rig:
        async with connected(rig.adapter(bumper="/bumper")) as adapter:
            state = await drive(adapter, AHEAD, lambda s: s.velocity.linear > 0.2 and s.errors)
            named = "/bumper is not received, because std9_msgs/Bool is not available"
            assert any(error.startswith(named) for error in state.errors)


async def test_bumper_counts_its_contacts():
    with Ros2Rig("giraff", publishes=RosRobot.TOPICS | {"/bumper": BOOL}) as rig:

        async def touch(*, touching):
            rig.tell("/bumper", {"data": touching})

        async with connected(rig.adapter(bumper="/bumper")) as adapter:
            await wait_for(adapter, lambda s: s.errors == ())
            for touching, counted in ((True, 1), (False, 1), (True, 2)):
                rig.call(touch(touching=touching))
                await wait_for(adapter, lambda s, counted=counted: s.contacts == counted)


async def test_missing_package_of_an_action_is_named_and_driving_still_works(monkeypatch):
    monkeypatch.setattr(ros2, "NAVIGATE_TO_POSE", "nav9_msgs/NavigateToPose")
    with Ros2Rig("giraff") as rig:
        async with connected(rig.adapter()) as adapter:
            await adapter.start(Goto(action_id="g", stamp=0.0, x=1.0, y=1.0))
            last = (await heard(adapter, ended("g")))[-1]
            assert "the ROS package nav9_msgs is not installed for" in last.reason
            state = await drive(adapter, AHEAD, lambda s: s.velocity.linear > 0.2)
            assert any("nav9_msgs" in error for error in state.errors)


async def test_python_without_rclpy_is_named(tmp_path):
    options = {"python": sys.executable, "domain": "19"}
    with pytest.raises(AdapterError, match=f"rclpy is not installed for {sys.executable}"):
        await registry.create("ros2", "giraff", options).connect()
    missing = tmp_path / "python"
    with pytest.raises(AdapterError, match=f"{missing} cannot be run"):
        await registry.create("ros2", "giraff", {"python": str(missing)}).connect()


def test_sourced_installation_is_used_with_the_systems_python(monkeypatch):
    options = ros2.Ros2Options(watchdog=0.5)
    monkeypatch.delenv("AMENT_PREFIX_PATH", raising=False)
    assert ros2.python_of(options) == sys.executable
    monkeypatch.setenv("AMENT_PREFIX_PATH", "/opt/ros/jazzy")
    assert ros2.python_of(options) == "/usr/bin/python3"
    assert ros2.python_of(ros2.Ros2Options(watchdog=0.5, python="/opt/python")) == "/opt/python"


@pytest.mark.parametrize("options", [{"navigation": "move_base"}, {"domain": "many"}])
def test_invalid_options_of_ros_2_are_refused(options):
    with pytest.raises(AdapterError, match=r"navigation must be|has a wrong value|domain must"):
        registry.create("ros2", "giraff", options)


@pytest.mark.parametrize(
    ("environment", "options", "domain"),
    [
        (None, {}, 0),
        ("", {}, 0),
        ("7", {}, 7),
        ("0x10", {}, 16),
        ("7", {"domain": "3"}, 3),
        ("7", {"domain": "0"}, 0),
    ],
)
def test_domain_is_read_from_the_option_or_the_environment(
    environment, options, domain, monkeypatch
):
    monkeypatch.delenv("ROS_DOMAIN_ID", raising=False)
    if environment is not None:
        monkeypatch.setenv("ROS_DOMAIN_ID", environment)
    assert registry.create("ros2", "giraff", options).place == f"ROS 2 in domain {domain}"


@pytest.mark.parametrize("text", ["seven", "-1", "233", "7.0", "7 8"])
def test_malformed_domain_of_the_environment_is_named(text, monkeypatch):
    monkeypatch.setenv("ROS_DOMAIN_ID", text)
    expected = f"^ROS_DOMAIN_ID must be a whole number from 0 to 232, not '{text}'$"
    with pytest.raises(AdapterError, match=expected):
        registry.create("ros2", "giraff")
    assert registry.create("ros2", "giraff", {"domain": "5"}).place == "ROS 2 in domain 5"


@pytest.mark.nightly
async def test_namespaces_separate_two_robots_in_one_domain(patient_adapters):
    rigs = {name: Ros2Rig("giraff", namespace=name) for name in ("/robot1", "/robot2")}
    with rigs["/robot1"], rigs["/robot2"]:
        for name, rig in rigs.items():
            (other,) = (each for each in rigs.values() if each is not rig)
            before = len(other.world.commands)
            async with connected(rig.adapter(namespace=name, tilt="head/command")) as adapter:
                await drive(adapter, AHEAD, lambda s: s.velocity.linear > 0.2)
                await drive(adapter, ZERO, stands)
                goal = rig.world.truth.compose(Pose2D(0.4, 0.0, 0.0))
                await adapter.start(Goto(action_id="g", stamp=0.0, x=goal.x, y=goal.y))
                assert (await heard(adapter, ended("g")))[-1].status == "FINISHED"
                assert (await some(adapter.states(), 1))[0].errors == ()
            for guard in adapter._bus._guards_left:  # it still brakes its own robot
                await asyncio.to_thread(guard.wait, patient(10.0))
            assert other.world.commands[before:] == []
            assert other.goals == (name == "/robot2")


@pytest.mark.nightly
async def test_velocities_have_the_subscribers_type_although_a_planner_publishes_another(
    patient_adapters,
):
    planned = RosRobot.TOPICS | {"/cmd_vel": "geometry_msgs/Twist"}
    with Ros2Rig("giraff", ("/cmd_vel", STAMPED)) as rig, Ros2Rig("giraff", publishes=planned) as _:
        async with connected(rig.adapter()) as adapter:
            await drive(adapter, AHEAD, lambda s: s.velocity.linear > 0.2 and s.errors == ())


async def test_missing_odometry_is_reported_with_domain_and_topic(monkeypatch):
    monkeypatch.setattr("robots.agent.adapters.common.remote_adapter.FIRST_READING", 0.3)
    for namespace, topic in (("", "/odom"), ("robot1/", "/robot1/odom")):
        options = {"domain": "19", "namespace": namespace, "python": str(PYTHON)}
        with pytest.raises(
            AdapterError,
            match=f"ROS 2 in domain 19 is connected, but has not sent its odometry on {topic}",
        ):
            await registry.create("ros2", "giraff", options).connect()


def test_numbers_that_json_lacks_are_none():
    program = (
        "import array, json, guarded_node;"
        "print(json.dumps(guarded_node.plain(array.array('f', [1.5, float('nan'), float('inf')]))))"
    )
    folder = ROOT / "robots" / "agent" / "adapters" / "ros"
    done = subprocess.run([PYTHON, "-c", program], cwd=folder, capture_output=True, check=True)
    assert json.loads(done.stdout) == [1.5, None, None]
