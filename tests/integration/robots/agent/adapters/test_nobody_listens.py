"""Velocities without a subscriber: another topic, another type, no base yet. Real rospy and rclpy;
a double of rosbridge that refuses the same.
"""

import asyncio
import time

import pytest

from robots.agent.adapters.ros.bus import Subscription
from robots.agent.ramp import ZERO
from robots.api.messages import Velocity
from tests.integration.robots.agent.adapters.test_whole_agent import agent
from tests.support.architectures.adapter_conformance import drive, wait_for
from tests.support.architectures.rca_conformance import connected
from tests.support.architectures.ros1_robot import Ros1Rig
from tests.support.architectures.ros2_robot import Ros2Rig
from tests.support.architectures.ros_robot import STAMPED
from tests.support.architectures.rosbridge_robot import RosbridgeRig

AHEAD = Velocity(linear=0.2, angular=0.1)
TWIST = "geometry_msgs/Twist"
RIGS = {
    "ros1": lambda base: Ros1Rig("rhodon", base),
    "ros2": lambda base: Ros2Rig("giraff", base),
    "rosbridge to ROS 1": lambda base: RosbridgeRig("rhodon", 1, base=base),
    "rosbridge to ROS 2": lambda base: RosbridgeRig("giraff", 2, base=base),
}
NAMES = ["ros1", *(pytest.param(name, marks=pytest.mark.nightly) for name in list(RIGS)[1:])]


pytestmark = pytest.mark.usefixtures("patient_adapters")


def motions(rig):
    return [each for each in rig.world.commands if each[1] or each[2]]


async def complaint(adapter, *words):
    """Drive until the first error contains all of the words; no velocity counts as applied."""
    async with asyncio.timeout(20.0):
        async for state in adapter.states():
            assert adapter.apply(AHEAD) == ZERO
            if state.errors and all(word in state.errors[0] for word in words):
                return


@pytest.mark.parametrize("name", NAMES)
async def test_base_on_another_topic_is_reported_with_the_option_to_set(name):
    with RIGS[name](("/base/cmd_vel", TWIST)) as rig:
        async with connected(rig.adapter()) as adapter:
            await complaint(
                adapter,
                "nobody listens on /cmd_vel",
                "set cmd_vel",
                "/base/cmd_vel (geometry_msgs/Twist)",
            )
        async with connected(rig.adapter(cmd_vel="/base/cmd_vel")) as adapter:
            await drive(adapter, AHEAD, lambda s: s.velocity.linear > 0.1 and s.errors == ())


@pytest.mark.parametrize("name", NAMES)
async def test_base_that_subscribes_to_stamped_velocities_gets_them(name):
    with RIGS[name](("/cmd_vel", STAMPED)) as rig:
        for _ in range(2):
            rig.robot.stamps.clear()
            async with connected(rig.adapter()) as adapter:
                await drive(adapter, AHEAD, lambda s: s.velocity.linear > 0.1 and s.errors == ())
            assert abs(rig.robot.stamps[-1] - time.time()) < 5.0


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize(
    ("kind", "stamped", "correct"), [(STAMPED, "false", "true"), (TWIST, "true", "false")]
)
async def test_base_of_another_type_is_reported_with_the_option_to_set(
    name, kind, stamped, correct, monkeypatch
):
    monkeypatch.setattr("robots.agent.adapters.ros.base.SUBSCRIBED_WITHIN", 0.3)
    with RIGS[name](("/cmd_vel", kind)) as rig:
        async with connected(rig.adapter(stamped=stamped)) as adapter:
            await complaint(
                adapter,
                "nobody listens on /cmd_vel",
                f"there it is {kind}",
                f"set stamped={correct}",
            )
        assert motions(rig) == []


async def test_without_rosapi_the_type_is_taken_from_the_refusal_of_rosbridge():
    rig = RosbridgeRig("giraff", 2, base=("/cmd_vel", STAMPED), words=["no-rosapi"])
    with rig:
        async with connected(rig.adapter()) as adapter:
            await drive(adapter, AHEAD, lambda s: s.velocity.linear > 0.1)
            await drive(adapter, ZERO, lambda s: s.velocity.linear == 0.0)
        async with connected(rig.adapter(stamped="false")) as adapter:
            await complaint(adapter, f"there it is {STAMPED}", "set stamped=true")


async def test_base_that_subscribes_later_receives_a_zero_velocity_first():
    with Ros1Rig("rhodon", ("/not_yet", STAMPED)) as rig:
        async with connected(rig.adapter()) as adapter:
            await complaint(adapter, "nobody listens on /cmd_vel", "/not_yet")
            rig.robot.base = ("/cmd_vel", STAMPED)
            rig.loop.call_soon_threadsafe(
                rig._bus.subscribe,
                Subscription("/cmd_vel", STAMPED, lambda sent: rig.robot.hear("/cmd_vel", sent)),
            )
            await wait_for(adapter, lambda s: s.errors == () and rig.world.commands, 20.0)
            assert motions(rig) == []
            assert rig.world.commands[0][1:] == (0.0, 0.0)
            await drive(adapter, AHEAD, lambda s: s.velocity.linear > 0.1)


@pytest.mark.nightly
async def test_base_restarted_with_another_type_is_driven_over_the_same_connection():
    with Ros1Rig("rhodon", ("/cmd_vel", TWIST)) as rig:
        async with connected(rig.adapter()) as adapter:
            await drive(adapter, AHEAD, lambda s: s.velocity.linear > 0.1)
            await drive(adapter, ZERO, lambda s: s.velocity.linear == 0.0)
            rig.robot.base = ("/cmd_vel", STAMPED)
            rig.robot.hears = dict([rig.robot.base]) | rig.robot.COMMANDS
            rig.call(rig.restart_robot())  # while the agent waits, nothing counts as silent
            await drive(adapter, AHEAD, lambda s: s.velocity.linear > 0.1 and s.errors == (), 20.0)


async def test_topics_without_publisher_are_reported_with_their_options():
    with Ros1Rig("rhodon") as rig:
        async with connected(
            rig.adapter(scan="/front/scan", battery="/camera/compressed")
        ) as adapter:
            state = await wait_for(adapter, lambda s: len(s.errors) > 1, 20.0)
    scan, battery = sorted(state.errors, key=lambda text: "battery" in text)
    assert (
        scan
        == "nobody publishes /front/scan (sensor_msgs/LaserScan): set scan to the robot's topic, or"
        " to nothing; here are /scan"
    )
    assert battery.startswith(
        "/camera/compressed is sensor_msgs/CompressedImage, not sensor_msgs/BatteryState: set"
        " battery"
    )


def test_unreceived_velocity_is_not_recorded_and_the_reason_is_reported(tmp_path):
    """The page shows the first error to a driver whose robot does not move
    (static/js/view/hud/stuck.js).
    """
    with Ros2Rig("giraff", ("/base/cmd_vel", TWIST)) as rca, agent(rca, tmp_path) as rig:
        rig.grant(ttl=60.0)
        rig.drive(
            0.25,
            until=lambda: any(
                s.applied and "nobody listens on /cmd_vel" in "".join(s.errors[:1])
                for s in rig.link.all("state")
            ),
            within=20.0,
        )
        commands = [command for state in rig.link.all("state") for command in state.applied]
        assert commands
        assert {(command.linear, command.angular) for command in commands} == {(0.0, 0.0)}
