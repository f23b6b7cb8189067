"""ROS 1 with a real master and real nodes: the conformance suite, and what a restart of each part
does.
"""

import asyncio
import contextlib
import os
import signal
import socket
from xmlrpc.client import ServerProxy

import pytest

from robots.agent.adapters import registry
from robots.agent.adapters.common import remote_adapter
from robots.agent.adapters.ros.bus import Subscription
from robots.agent.adapters.ros.graph import master_restarted
from robots.agent.adapters.ros.guarded_node import HEARING
from robots.agent.adapters.ros.ros1 import Ros1Bus, Ros1Options
from robots.agent.robot_interface import AdapterError
from robots.api.messages import Velocity
from tests.support.architectures.adapter_conformance import drive, some, wait_for
from tests.support.architectures.rca_conformance import (
    RcaConformance,
    again,
    connected,
    lost,
    sees_grey,
    standing,
)
from tests.support.architectures.ros1_robot import RobotBus, Ros1Rig
from tests.support.architectures.ros_robot import STAMPED
from tests.support.patience import patient

AHEAD = Velocity(linear=0.25, angular=0.0)
REFUSED = 1.0  # s after which rospy asks a publisher that has refused it again
WAITS = 0.7  # s, less than the second after which the node takes its master to be gone


class TestRhodon(RcaConformance):
    def make_rig(self, directory):
        return Ros1Rig("rhodon")

    async def test_pictures_of_a_topic_are_its_camera(self):
        await sees_grey(self.rig.adapter(image="/camera/compressed"))

    async def test_a_base_that_the_news_of_its_driver_did_not_reach_is_told_again(self, adapter):
        await wait_for(adapter, lambda _: adapter._bus.listeners("/cmd_vel") == 1)
        await asyncio.to_thread(self.rig.call, self.rig.loses_its_driver())
        await wait_for(adapter, lambda _: adapter._bus.listeners("/cmd_vel") == 0)
        await drive(adapter, AHEAD, lambda s: s.velocity.linear > 0.2)

    @pytest.mark.nightly
    async def test_a_master_that_is_started_anew_is_noticed_and_joined(self, adapter):
        await drive(adapter, AHEAD, lambda s: s.velocity.linear > 0.2)
        restarting = asyncio.get_running_loop().run_in_executor(
            None, lambda: self.rig.call(self.restart())
        )
        assert "the ROS master at" in await lost(adapter, AHEAD)
        await restarting
        await standing(self.rig)
        await again(adapter)
        await drive(adapter, AHEAD, lambda s: s.velocity.linear > 0.2)

    async def restart(self):
        self.rig.running = False
        self.rig.master.kill()
        self.rig.master.start()
        await self.rig.restart_robot()

    @pytest.mark.nightly
    async def test_nodes_that_a_restarted_master_has_forgotten_are_named_until_they_are_restarted(
        self, adapter, monkeypatch
    ):
        await drive(adapter, AHEAD, lambda s: s.velocity.linear > 0.2)
        restarting = asyncio.get_running_loop().run_in_executor(None, self.restart_master)
        assert "the ROS master at" in await lost(adapter, AHEAD)
        await restarting
        await standing(self.rig)
        told = len(self.rig.world.commands)
        with monkeypatch.context() as shortly:
            shortly.setattr(remote_adapter, "FIRST_READING", 1.5)
            for _ in range(2):
                with pytest.raises(AdapterError) as found:
                    await adapter.connect()
                assert str(found.value).endswith(
                    "has not sent its odometry on /odom: the ROS master was restarted. Nodes that"
                    " started before it are no longer known to it; restart them: /base_driver"
                )
                with pytest.raises(AdapterError):
                    adapter.apply(AHEAD)
        assert self.rig.world.sim.motion.linear == 0.0
        assert not any(linear or angular for _, linear, angular in self.rig.world.commands[told:])
        await asyncio.to_thread(self.rig.call, self.rig.restart_robot())
        await again(adapter)
        await drive(adapter, AHEAD, lambda s: s.velocity.linear > 0.2 and s.errors == ())

    @pytest.mark.nightly
    async def test_a_forgotten_node_beside_a_base_that_is_known_again_is_the_first_error(
        self, adapter
    ):
        laser = RobotBus(self.rig.master, "laser_driver")
        await asyncio.to_thread(self.rig.call, laser.open(self.rig.lost.append, None))
        try:
            await wait_for(adapter, lambda _: "/laser_driver" in adapter._bus.known, 20.0)
            restarting = asyncio.get_running_loop().run_in_executor(
                None, lambda: self.rig.call(self.restart())
            )
            await lost(adapter, AHEAD)
            await restarting
            await again(adapter)
            state = await wait_for(adapter, lambda s: s.errors, 10.0)
            assert state.errors[0] == master_restarted(["/laser_driver"])
        finally:
            await asyncio.to_thread(self.rig.call, laser.shut())
        await wait_for(adapter, lambda s: s.errors == (), 20.0)

    def restart_master(self):
        self.rig.master.kill()
        self.rig.master.start()

    @pytest.mark.nightly
    async def test_a_node_that_is_killed_stops_the_robot_by_its_watchdog_and_is_replaced(
        self, adapter
    ):
        await drive(adapter, AHEAD, lambda s: s.velocity.linear > 0.2)
        os.kill(adapter._bus._child.pid, signal.SIGKILL)
        assert "node" in await lost(adapter, AHEAD)
        await standing(self.rig)
        await again(adapter)
        assert await some(adapter.states(), 2)

    @pytest.mark.nightly
    async def test_a_node_whose_agent_is_stuck_says_stand(self, adapter):
        await drive(adapter, AHEAD, lambda s: s.velocity.linear > 0.2)
        self.rig.world.commands.clear()
        adapter.apply(AHEAD)
        await wait_for(
            adapter,
            lambda _: self.rig.world.commands[-1:] and self.rig.world.commands[-1][1] == 0.0,
            3.0,
        )


@contextlib.asynccontextmanager
async def opened(rig):
    bus = Ros1Bus(Ros1Options(master=rig.master.uri, ip=rig.master.host, watchdog=0.6))
    await bus.open(rig.lost.append, None)
    try:
        yield bus
    finally:
        await bus.shut()


async def publisher_of(rig, topic):
    """Wait for a publisher of a topic and return its slave API."""
    master = ServerProxy(rig.master.uri)
    async with asyncio.timeout(patient(5.0)):
        while True:
            publishers = dict(master.getSystemState("/test")[2][0])
            if topic in publishers:
                return ServerProxy(master.lookupNode("/test", publishers[topic][0])[2])
            await asyncio.sleep(0.05)


async def test_a_stranger_that_sends_no_header_keeps_no_subscriber_waiting():
    """As the caller of a node that has ended, whose port this node has now."""
    with Ros1Rig("rhodon") as rig:
        async with opened(rig) as bus:
            bus.advertise("/probe", "std_msgs/Bool")
            node = await publisher_of(rig, "/probe")
            _, _, (_, host, port) = node.requestTopic("/test", "/probe", [["TCPROS"]])
            with socket.create_connection((host, port)) as stranger:
                stranger.sendall(b"POST /RPC2 HTTP/1.1\r\n")
                bus.advertise("/cmd_vel", "geometry_msgs/Twist", drives=True)
                async with asyncio.timeout(patient(2.0)):
                    while not bus.listeners("/cmd_vel"):
                        await asyncio.sleep(0.02)


@pytest.mark.nightly
async def test_a_latched_message_reaches_a_subscriber_that_comes_later():
    with Ros1Rig("rhodon") as rig:
        async with opened(rig) as bus:
            bus.advertise("/lock", "std_msgs/Bool", latch=True)
            bus.publish("/lock", {"data": True})
            await asyncio.sleep(HEARING + 0.5)
            received = []
            lock = Subscription("/lock", "std_msgs/Bool", received.append)
            rig.loop.call_soon_threadsafe(rig._bus.subscribe, lock)
            async with asyncio.timeout(patient(3.0)):
                while received != [{"data": True}]:
                    await asyncio.sleep(0.02)


async def test_a_node_that_ends_leaves_nothing_at_the_master():
    with Ros1Rig("rhodon") as rig:
        async with connected(rig.adapter()) as adapter:
            await some(adapter.states(), 2)
        publishers, subscribers, services = ServerProxy(rig.master.uri).getSystemState("/test")[2]
        names = {
            name for each in (publishers, subscribers, services) for _, at in each for name in at
        }
        assert names == {"/base_driver"}


async def test_a_base_that_was_refused_connects_after_the_type_of_velocities_is_replaced():
    """Although the master keeps the node waiting while the base asks for its publications again."""
    with Ros1Rig("rhodon", ("/cmd_vel", STAMPED)) as rig:
        async with opened(rig) as bus:
            bus.advertise("/cmd_vel", "geometry_msgs/Twist", drives=True)
            while not (await bus.graph("/cmd_vel", ()))["/cmd_vel"].kinds:
                await asyncio.sleep(0.01)
            await asyncio.sleep(REFUSED - WAITS / 2)
            rig.master.freeze(on=True)
            bus.advertise("/cmd_vel", STAMPED, drives=True)
            await asyncio.sleep(WAITS)
            rig.master.freeze(on=False)
            async with asyncio.timeout(patient(2.0)):
                while not bus.listeners("/cmd_vel"):
                    await bus.graph("/cmd_vel", ())
                    await asyncio.sleep(0.1)


@pytest.mark.parametrize("address", ["robot:11311", "http://", "http://robot:many"])
def test_a_malformed_address_of_the_master_is_named_with_where_it_was_given(address, monkeypatch):
    expected = r"must be the address of the ROS master, such as http://192\.168\.1\.30:11311, not "
    with pytest.raises(AdapterError, match=f"^master {expected}'{address}'"):
        registry.create("ros1", "rhodon", {"master": address})
    monkeypatch.setenv("ROS_MASTER_URI", address)
    with pytest.raises(AdapterError, match=f"^ROS_MASTER_URI {expected}'{address}'"):
        registry.create("ros1", "rhodon")


async def test_without_a_master_the_address_is_named():
    adapter = registry.create("ros1", "rhodon", {"master": "http://127.0.0.1:1"})
    with pytest.raises(AdapterError, match=r"no ROS master at http://127\.0\.0\.1:1"):
        await adapter.connect()


@pytest.mark.parametrize("python", ["/no/such/python", ""])
async def test_a_python_that_cannot_be_run_is_named(python):
    adapter = registry.create("ros1", "rhodon", {"python": python})
    with pytest.raises(AdapterError, match="cannot be run"):
        await adapter.connect()


async def test_a_python_without_rospy_is_told_what_to_install(tmp_path):
    wrapper = tmp_path / "python"
    wrapper.write_text('#!/bin/sh\nexec /usr/bin/python3 -S -E "$@"\n')
    wrapper.chmod(0o755)
    adapter = registry.create("ros1", "rhodon", {"python": str(wrapper)})
    with pytest.raises(AdapterError, match="rospy is not installed"):
        await adapter.connect()


async def test_what_the_node_prints_does_not_mix_with_the_output_of_the_command(tmp_path, capfd):
    wrapper = tmp_path / "python"
    wrapper.write_text('#!/bin/sh\necho logged\nexec /usr/bin/python3 -S -E "$@"\n')
    wrapper.chmod(0o755)
    adapter = registry.create("ros1", "rhodon", {"python": str(wrapper)})
    with pytest.raises(AdapterError):
        await adapter.connect()
    out, err = capfd.readouterr()
    assert not out
    assert "logged" in err


def test_actions_of_ros_2_are_refused():
    with pytest.raises(AdapterError, match="move_base"):
        registry.create("ros1", "rhodon", {"navigation": "nav2"})


@pytest.mark.nightly
async def test_a_rospy_that_needs_6_s_to_start_is_waited_for(tmp_path):
    wrapper = tmp_path / "python"
    wrapper.write_text('#!/bin/sh\nsleep 6\nexec /usr/bin/python3 "$@"\n')
    wrapper.chmod(0o755)
    with Ros1Rig("rhodon") as rig:
        async with connected(rig.adapter(python=str(wrapper))) as adapter:
            assert await some(adapter.states(), 2)
