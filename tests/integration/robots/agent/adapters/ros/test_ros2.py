"""ROS 2 over real DDS between processes on the loopback interface: the conformance suite, and how
its types look on the wire.
"""

import math
import struct

import pytest

from robots.agent.adapters import registry
from robots.agent.adapters.ros.ros2_messages import TYPES, filled, plain
from robots.agent.robot_interface import AdapterError
from tests.support.rca_conformance import RcaConformance, sees_grey
from tests.support.ros2_robot import LOOPBACK, Ros2Rig


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
    with pytest.raises(AdapterError, match=r"rosbridge|not what it should be"):
        registry.create("ros2", "giraff", options)


async def test_a_domain_without_a_robot_says_what_is_missing(monkeypatch):
    monkeypatch.setattr("robots.agent.adapters.common.remote_adapter.FIRST_READING", 0.3)
    with pytest.raises(
        AdapterError, match="ROS 2 in domain 19 is there, and says nothing of its odometry on /odom"
    ):
        await registry.create("ros2", "giraff", {"domain": "19"}).connect()
