"""ROS 2 over real DDS between processes on the loopback interface: the conformance suite, and how
its types look on the wire.
"""

import math
import struct

import pytest

from robots.agent.adapters import registry
from robots.agent.adapters.ros.ros2 import DdsBus
from robots.agent.adapters.ros.ros2_messages import TYPES, filled, plain
from robots.agent.ramp import ZERO
from robots.agent.robot_interface import AdapterError
from robots.api.geometry import Pose2D
from robots.api.messages import Goto, Velocity
from tests.support.architectures.adapter_conformance import drive, some, stands
from tests.support.architectures.rca_conformance import (
    RcaConformance,
    connected,
    ended,
    heard,
    sees_grey,
)
from tests.support.architectures.ros2_robot import LOOPBACK, Ros2Rig
from tests.support.architectures.ros_robot import STAMPED

AHEAD = Velocity(linear=0.25, angular=0.0)


@pytest.fixture(scope="module", autouse=True)
def _loopback():
    with pytest.MonkeyPatch.context() as environment:
        environment.setenv("CYCLONEDDS_URI", LOOPBACK)
        yield


class TestGiraff(RcaConformance):
    def make_rig(self, directory):
        return Ros2Rig("giraff")

    async def test_pictures_of_a_topic_are_its_camera(self):
        await sees_grey(self.rig.adapter(image="/camera/compressed"))


def test_a_velocity_is_laid_out_as_ros_2_does():
    twist = filled(TYPES["geometry_msgs/Twist"], {"linear": {"x": 0.5}, "angular": {"z": -1.0}})
    assert twist.serialize() == b"\x00\x01\x00\x00" + struct.pack(
        "<6d", 0.5, 0.0, 0.0, 0.0, 0.0, -1.0
    )
    assert twist.__idl_typename__ == "geometry_msgs::msg::dds_::Twist_"


@pytest.mark.parametrize("kind", sorted(TYPES))
def test_every_type_goes_over_the_wire_and_into_json(kind):
    message = TYPES[kind]()
    again = TYPES[kind].deserialize(message.serialize())
    assert plain(again) == plain(message)
    assert plain(
        filled(
            TYPES[kind],
            {name: value for name, value in plain(message).items() if value is not None},
        )
    ) == plain(message)


def test_numbers_that_json_lacks_are_none():
    assert plain([1.5, math.nan, math.inf]) == [1.5, None, None]


@pytest.mark.parametrize("options", [{"navigation": "nav2"}, {"dock": "/dock"}, {"domain": "many"}])
def test_what_dds_cannot_carry_is_refused_with_the_way_out(options):
    with pytest.raises(AdapterError, match=r"rosbridge|has a wrong value"):
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
def test_the_domain_is_that_of_the_environment_as_for_ros_2_and_an_option_overrules_it(
    environment, options, domain, monkeypatch
):
    monkeypatch.delenv("ROS_DOMAIN_ID", raising=False)
    if environment is not None:
        monkeypatch.setenv("ROS_DOMAIN_ID", environment)
    assert registry.create("ros2", "giraff", options).place == f"ROS 2 in domain {domain}"


@pytest.mark.parametrize("text", ["seven", "-1", "233", "7.0", "7 8"])
def test_a_malformed_domain_of_the_environment_is_named(text, monkeypatch):
    monkeypatch.setenv("ROS_DOMAIN_ID", text)
    expected = f"^ROS_DOMAIN_ID must be a whole number from 0 to 232, not '{text}'$"
    with pytest.raises(AdapterError, match=expected):
        registry.create("ros2", "giraff")
    assert registry.create("ros2", "giraff", {"domain": "5"}).place == "ROS 2 in domain 5"


@pytest.mark.nightly
async def test_two_robots_in_one_domain_are_told_apart_by_their_namespaces(patient_adapters):
    rigs = {name: Ros2Rig("giraff", words=("reliable", name)) for name in ("/robot1", "/robot2")}
    with rigs["/robot1"], rigs["/robot2"]:
        for name, rig in rigs.items():
            (other,) = (each for each in rigs.values() if each is not rig)
            told = len(other.world.commands)
            async with connected(rig.adapter(namespace=name, tilt="head/command")) as adapter:
                await drive(adapter, AHEAD, lambda s: s.velocity.linear > 0.2)
                await drive(adapter, ZERO, stands)
                goal = rig.world.truth.compose(Pose2D(0.4, 0.0, 0.0))
                await adapter.start(Goto(action_id="g", stamp=0.0, x=goal.x, y=goal.y))
                assert (await heard(adapter, ended("g")))[-1].status == "FINISHED"
                assert (await some(adapter.states(), 1))[0].errors == ()
            assert other.world.commands[told:] == []
            assert other.goals == (name == "/robot2")


@pytest.mark.nightly
async def test_velocities_have_the_type_of_who_listens_whatever_a_planner_publishes_there(
    patient_adapters,
):
    with Ros2Rig("giraff", ("/cmd_vel", STAMPED)) as rig:
        planner = DdsBus(rig.domain)
        await planner.open(rig.errors.append, None)
        planner.advertise("/cmd_vel", "geometry_msgs/Twist")
        try:
            async with connected(rig.adapter()) as adapter:
                await drive(adapter, AHEAD, lambda s: s.velocity.linear > 0.2 and s.errors == ())
        finally:
            await planner.shut()


async def test_a_namespace_without_a_robot_names_the_topic_that_is_missing(monkeypatch):
    monkeypatch.setattr("robots.agent.adapters.common.remote_adapter.FIRST_READING", 0.3)
    options = {"domain": "19", "namespace": "robot1/"}
    with pytest.raises(AdapterError, match="has not sent its odometry on /robot1/odom"):
        await registry.create("ros2", "giraff", options).connect()


async def test_a_domain_without_a_robot_says_what_is_missing(monkeypatch):
    monkeypatch.setattr("robots.agent.adapters.common.remote_adapter.FIRST_READING", 0.3)
    with pytest.raises(
        AdapterError,
        match="ROS 2 in domain 19 is connected, but has not sent its odometry on /odom",
    ):
        await registry.create("ros2", "giraff", {"domain": "19"}).connect()
