"""ROS through rosbridge: the conformance suite for both generations, against a double or, with
ROSBRIDGE=ws://…, against a real one.

A real one is of the generation that ROSBRIDGE_ROS names, 2 unless told otherwise.
"""

import asyncio
import os

import pytest

from robots.agent.adapters import registry
from robots.agent.adapters.ros.rosbridge import _decoded
from robots.agent.robot_interface import AdapterError
from robots.api.messages import Dock, Velocity
from tests.support.architectures.adapter_conformance import some, wait_for
from tests.support.architectures.rca_conformance import RcaConformance, connected, drive, sees_grey
from tests.support.architectures.rosbridge_robot import RosbridgeRig
from tests.support.architectures.rosbridge_server import RosbridgeServer
from tests.support.patience import patient

REAL = os.environ.get("ROSBRIDGE", "")
REAL_ROS = int(os.environ.get("ROSBRIDGE_ROS", "2"))
STANDING = {"linear": {"x": 0.0, "y": 0.0, "z": 0.0}, "angular": {"x": 0.0, "y": 0.0, "z": 0.0}}


def twists(heard):
    """What a robot was told, of stamped velocities."""
    return [message["twist"] for _, message in heard]


@pytest.mark.skipif(bool(REAL) and REAL_ROS != 1, reason="the real rosbridge speaks ROS 2")
class TestRhodonOnRos1(RcaConformance):
    def make_rig(self, directory):
        return RosbridgeRig("rhodon", 1, REAL)

    async def test_a_robot_that_does_not_know_where_it_is_gets_our_localization(self):
        adapter = self.rig.adapter(localization="none")
        assert "localization" not in adapter.profile.capabilities
        assert "goto" in registry.autonomous(adapter, "office").profile.capabilities
        async with connected(adapter):
            state = (await some(adapter.states(), 2))[-1]
        assert state.odometry is not None
        assert not state.pose.localized

    async def test_a_service_that_nobody_offers_is_said_so(self):
        async with connected(self.rig.adapter(dock="/no_such_service")) as adapter:
            with pytest.raises(AdapterError, match="no_such_service cannot be called"):
                await adapter.start(Dock(action_id="d", stamp=0.0))


@pytest.mark.skipif(bool(REAL) and REAL_ROS != 2, reason="the real rosbridge speaks ROS 1")
class TestGiraffOnRos2(RcaConformance):
    def make_rig(self, directory):
        return RosbridgeRig("giraff", 2, REAL)

    async def test_pictures_of_a_topic_are_its_camera(self):
        await sees_grey(self.rig.adapter(image="/camera/compressed"))

    async def test_stamped_velocities_are_said_as_such(self):
        async with connected(
            self.rig.adapter(stamped="yes", cmd_vel="/cmd_vel_stamped")
        ) as adapter:
            heard = []
            self.rig.robot.hear = lambda topic, message: heard.append((topic, message))
            try:
                subscribe = {
                    "op": "subscribe",
                    "topic": "/cmd_vel_stamped",
                    "type": "geometry_msgs/msg/TwistStamped",
                }
                self.rig.call(self.rig._send(subscribe))
                await drive(
                    adapter,
                    Velocity(linear=0.2, angular=0.1),
                    lambda _: any(told != STANDING for told in twists(heard)),
                )
            finally:
                del self.rig.robot.hear
        # the first word after connecting is to stand
        moving = next(told for told in twists(heard) if told != STANDING)
        assert moving == {
            "linear": {"x": 0.2, "y": 0.0, "z": 0.0},
            "angular": {"x": 0.0, "y": 0.0, "z": 0.1},
        }


async def test_nobody_at_the_address_gives_a_sentence():
    adapter = registry.create(
        "rosbridge", "rhodon", {"navigation": "none", "url": "ws://127.0.0.1:1"}
    )
    with pytest.raises(AdapterError, match=r"rosbridge at ws://127\.0\.0\.1:1 does not answer"):
        await adapter.connect()


async def test_a_rosbridge_without_a_robot_says_what_is_missing(monkeypatch):
    monkeypatch.setattr("robots.agent.adapters.common.remote_adapter.FIRST_READING", 0.3)
    server = RosbridgeServer()
    await server.start()
    adapter = registry.create(
        "rosbridge", "rhodon", {"navigation": "none", "url": server.url, "odom": "/wheels"}
    )
    try:
        async with asyncio.timeout(patient(5.0)):
            with pytest.raises(AdapterError, match="has not sent its odometry on /wheels"):
                await adapter.connect()
    finally:
        await server.stop()


async def test_nonsense_on_a_topic_is_as_if_it_had_not_come():
    with RosbridgeRig("rhodon", 1) as rig:
        async with connected(rig.adapter()) as adapter:
            for message in ({}, {"pose": None}, {"header": {}, "ranges": "x"}):
                for topic in ("/odom", "/scan", "/battery_state", "/amcl_pose"):
                    rig.call(rig._send({"op": "publish", "topic": topic, "msg": message}))
            assert await wait_for(adapter, lambda s: s.pose.localized)


@pytest.mark.parametrize(
    "options", [{"version": "3"}, {"url": "http://x"}, {"speed": "9"}, {"watchdog": "soon"}]
)
def test_options_that_cannot_be_are_refused(options):
    with pytest.raises(AdapterError, match=r"rosbridge"):
        registry.create("rosbridge", "rhodon", options)


def test_numbers_that_json_lacks_become_null():
    assert _decoded('{"a": [NaN, -Infinity, 1.5], "b": "NaN"}') == {
        "a": [None, None, 1.5],
        "b": "NaN",
    }


def test_base64_with_nan_in_it_is_parsed_once(monkeypatch):
    monkeypatch.delattr("robots.agent.adapters.ros.rosbridge.json")
    assert _decoded('{"data": "iVBNaNInfinity"}') == {"data": "iVBNaNInfinity"}
