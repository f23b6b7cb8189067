"""ROS through rosbridge: the conformance suite for both versions of ROS, against a double or, with
ROSBRIDGE=ws://…, against a real one of the version in ROSBRIDGE_ROS (2 by default).
"""

import asyncio
import contextlib
import json
import os

import pytest
from websockets.asyncio.client import connect

from robots.agent.adapters import registry
from robots.agent.adapters.ros import messages
from robots.agent.adapters.ros.rosbridge import _decoded
from robots.agent.robot_interface import ActionRefusedError, AdapterError
from robots.api.geometry import Pose2D
from robots.api.messages import Dock, Goto, Velocity
from tests.support.architectures.adapter_conformance import some, wait_for
from tests.support.architectures.rca_conformance import RcaConformance, connected, drive, sees_grey
from tests.support.architectures.rosbridge_robot import RosbridgeRig
from tests.support.architectures.rosbridge_server import RosbridgeServer
from tests.support.patience import patient

REAL = os.environ.get("ROSBRIDGE", "")
REAL_ROS = int(os.environ.get("ROSBRIDGE_ROS", "2"))


def twist(linear, angular):
    return {
        "linear": {"x": linear, "y": 0.0, "z": 0.0},
        "angular": {"x": 0.0, "y": 0.0, "z": angular},
    }


@pytest.mark.skipif(bool(REAL) and REAL_ROS != 1, reason="the real rosbridge speaks ROS 2")
class TestRhodonOnRos1(RcaConformance):
    def make_rig(self, directory):
        return RosbridgeRig("rhodon", 1, REAL)

    async def test_robot_without_localization_gets_ours(self):
        adapter = self.rig.adapter(localization="none")
        assert "localization" not in adapter.profile.capabilities
        assert "goto" in registry.autonomous(adapter, "office").profile.capabilities
        async with connected(adapter):
            state = (await some(adapter.states(), 2))[-1]
        assert state.odometry is not None
        assert not state.pose.localized

    async def test_missing_docking_service_is_named(self):
        async with connected(self.rig.adapter(dock="/no_such_service")) as adapter:
            with pytest.raises(AdapterError, match="no_such_service cannot be called"):
                await adapter.start(Dock(action_id="d", stamp=0.0))


@pytest.mark.skipif(bool(REAL) and REAL_ROS != 2, reason="the real rosbridge speaks ROS 1")
class TestGiraffOnRos2(RcaConformance):
    def make_rig(self, directory):
        return RosbridgeRig("giraff", 2, REAL)

    async def test_image_topic_becomes_its_camera(self):
        await sees_grey(self.rig.adapter(image="/camera/compressed"))

    async def test_stamped_velocities_are_published_as_twist_stamped(self, monkeypatch):
        topic, moving = "/cmd_vel_stamped", []

        def take(_, message):
            if message["twist"] != twist(0.0, 0.0):  # zero after connecting
                moving.append(message["twist"])

        async with connected(self.rig.adapter(stamped="yes", cmd_vel=topic)) as adapter:
            monkeypatch.setattr(self.rig.robot, "hear", take)
            kind = "geometry_msgs/msg/TwistStamped"
            self.rig.call(self.rig._send(op="subscribe", topic=topic, type=kind))
            await drive(adapter, Velocity(linear=0.2, angular=0.1), lambda _: moving)
        assert moving[0] == twist(0.2, 0.1)


async def test_address_without_a_server_is_named():
    adapter = registry.create(
        "rosbridge", "rhodon", {"navigation": "none", "url": "ws://127.0.0.1:1"}
    )
    with pytest.raises(AdapterError, match=r"rosbridge at ws://127\.0\.0\.1:1 does not answer"):
        await adapter.connect()


async def test_missing_odometry_is_reported_with_its_topic(monkeypatch):
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


async def test_malformed_messages_are_ignored():
    with RosbridgeRig("rhodon", 1) as rig:
        async with connected(rig.adapter()) as adapter:
            for message in ({}, {"pose": None}, {"header": {}, "ranges": "x"}):
                for topic in ("/odom", "/scan", "/battery_state", "/amcl_pose"):
                    rig.call(rig._send(op="publish", topic=topic, msg=message))
            assert await wait_for(adapter, lambda s: s.pose.localized)


@pytest.mark.parametrize(
    "options", [{"version": "3"}, {"url": "http://x"}, {"speed": "9"}, {"watchdog": "soon"}]
)
def test_invalid_options_are_refused(options):
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


@contextlib.asynccontextmanager
async def robot_behind(server, **options):
    """Yield an adapter, and what its robot of ROS 2 receives, over a server in this process."""
    await server.start()
    received = []
    robot = await connect(server.url, compression=None)

    async def send(**message):
        await robot.send(json.dumps(message))

    async def publish_odometry():
        await send(op="advertise", topic="/odom", type="nav_msgs/msg/Odometry")
        while True:
            await send(op="publish", topic="/odom", msg=ODOMETRY)
            await asyncio.sleep(0.03)

    async def receive():
        async for text in robot:
            message = json.loads(text)
            received.append(message)

    await send(op="subscribe", topic="/cmd_vel", type="geometry_msgs/msg/Twist")
    await send(op="advertise_action", action="/navigate_to_pose", type="NavigateToPose")
    await send(op="advertise_service", service="/dock", type="std_srvs/srv/Trigger")
    tasks = [asyncio.ensure_future(each) for each in (publish_odometry(), receive())]
    named = {"url": server.url, "version": "2", "scan": "", "battery": "", **options}
    try:
        yield registry.create("rosbridge", "rhodon", named), received
    finally:
        for task in tasks:
            task.cancel()
        await server.stop()


ODOMETRY = {
    "pose": {"pose": messages.pose(Pose2D(0.0, 0.0, 0.0)), "covariance": []},
    "twist": {"twist": twist(0.0, 0.0), "covariance": []},
}
THROUGH = {"navigation": "nav2", "navigation_velocity": "/cmd_vel_nav"}
AHEAD = Velocity(linear=0.2, angular=0.0)


def moved(received):
    return [each for each in received if each.get("msg", {}).get("linear", {}).get("x")]


async def test_rosbridge_whose_queue_hangs_gets_no_velocity_although_it_answers_pings():
    server = RosbridgeServer()
    async with robot_behind(server, navigation="none") as (adapter, received), connected(adapter):
        await drive(adapter, AHEAD, lambda _: moved(received))
        server.held.add(server.clients[-1])
        hung = asyncio.get_running_loop().time()
        with pytest.raises(AdapterError, match="no longer answers"):
            await drive(adapter, AHEAD, lambda _: False)
        assert asyncio.get_running_loop().time() - hung < patient(2.0)
        late = len(moved(received))
        server.held.clear()
        await asyncio.sleep(0.5)
        assert len(moved(received)) <= late + 1  # one may have been sent as it hung


async def test_rosbridge_that_a_goal_would_block_is_refused():
    server = RosbridgeServer(blocking_goals=True)
    async with robot_behind(server, **THROUGH) as (adapter, _):
        with pytest.raises(AdapterError, match="set its send_action_goals_in_new_thread to true"):
            await adapter.connect()
        await adapter.close()


async def test_rosbridge_that_a_goal_blocks_is_disconnected_if_its_parameter_is_unknown():
    server = RosbridgeServer(rosapi=False, blocking_goals=True)
    async with robot_behind(server, **THROUGH) as (adapter, _), connected(adapter):
        await adapter.start(Goto(action_id="g", stamp=0.0, x=9.0, y=0.0))
        with pytest.raises(AdapterError, match="is blocked by the goal: set its send_action_goals"):
            await wait_for(adapter, lambda _: False)


async def test_rosbridge_that_a_service_call_blocks_is_disconnected():
    server = RosbridgeServer(blocking_services=True)
    options = {"navigation": "none", "dock": "/dock", "navigation_velocity": "/cmd_vel_nav"}
    async with robot_behind(server, **options) as (adapter, received), connected(adapter):
        docking = asyncio.ensure_future(adapter.start(Dock(action_id="d", stamp=0.0)))
        with pytest.raises(AdapterError, match="is blocked by the service /dock"):
            await wait_for(adapter, lambda _: False)
        docking.cancel()
        assert any(each["op"] == "call_service" for each in received)


async def test_new_goal_is_refused_until_the_cancel_of_the_previous_one_is_confirmed():
    server = RosbridgeServer()
    async with robot_behind(server, **THROUGH) as (adapter, received), connected(adapter):
        await adapter.start(Goto(action_id="g", stamp=0.0, x=9.0, y=0.0))
        operations = lambda: {each["op"] for each in received}
        await wait_for(adapter, lambda _: "send_action_goal" in operations())
        assert not await adapter.cancel("g")
        with pytest.raises(ActionRefusedError, match="navigation_does_not_end"):
            await adapter.start(Goto(action_id="h", stamp=0.0, x=9.0, y=0.0))
        await wait_for(adapter, lambda _: "cancel_action_goal" in operations())
        # no goal has been active for a second, and the action has no cancel service: it never ran
        await asyncio.sleep(patient(1.1))
        assert await adapter.cancel("g")
