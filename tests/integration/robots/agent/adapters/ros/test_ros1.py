"""ROS 1 with a real master and real nodes: the conformance suite, and the restart of each part."""

import asyncio
import contextlib
import os
import signal
import socket
import time
from xmlrpc.client import ServerProxy

import pytest

from robots.agent.adapters import registry
from robots.agent.adapters.common import remote_adapter
from robots.agent.adapters.ros.bus import Subscription
from robots.agent.adapters.ros.graph import master_restarted
from robots.agent.adapters.ros.guarded_node import HEARING, HEARTBEAT
from robots.agent.adapters.ros.ros1 import Ros1Bus, Ros1Options
from robots.agent.robot_interface import AdapterError
from robots.api.messages import Dock, Velocity
from robots.api.reasons import ReasonCode
from tests.support.architectures.adapter_conformance import drive, some, wait_for
from tests.support.architectures.rca_conformance import (
    RcaConformance,
    again,
    connected,
    ended,
    heard,
    lost,
    sees_grey,
    standing,
)
from tests.support.architectures.ros1_robot import RobotBus, Ros1Rig
from tests.support.architectures.ros_robot import STAMPED
from tests.support.patience import patient

AHEAD = Velocity(linear=0.25, angular=0.0)
REFUSED = 1.0  # s after which rospy retries a publisher that refused it
WAITS = 0.7  # s, less than the second after which the node considers its master lost


class TestRhodon(RcaConformance):
    def make_rig(self, directory):
        return Ros1Rig("rhodon")

    async def test_image_topic_becomes_its_camera(self):
        await sees_grey(self.rig.adapter(image="/camera/compressed"))

    async def test_publisher_is_announced_again_to_a_base_that_missed_it(self, adapter):
        await wait_for(adapter, lambda _: adapter._bus.listeners("/cmd_vel") == 1)
        await asyncio.to_thread(self.rig.call, self.rig.loses_its_driver())
        await wait_for(adapter, lambda _: adapter._bus.listeners("/cmd_vel") == 0)
        await drive(adapter, AHEAD, lambda s: s.velocity.linear > 0.2)

    async def test_docking_that_its_guard_cancels_fails(self, near_dock):
        """The connection stays, while the agent does not respond."""
        world = self.rig.world
        world.hung = True  # so that it does not dock before
        await near_dock.start(Dock(action_id="d", stamp=0.0))
        before, until = world.cancels, time.monotonic() + patient(HEARTBEAT + 1.0)
        while world.cancels == before and time.monotonic() < until:
            time.sleep(0.02)
        last = (await heard(near_dock, ended("d")))[-1]
        assert (last.status, last.reason) == ("FAILED", ReasonCode.HEARTBEAT_LOST)

    def restart_master(self):
        self.rig.master.kill()
        self.rig.master.start()

    def restart_all(self):
        self.rig.running = False
        self.restart_master()
        self.rig.call(self.rig.restart_robot())

    async def loses_its_master(self, adapter, restart):
        restarting = asyncio.create_task(asyncio.to_thread(restart))
        assert "the ROS master at" in await lost(adapter, AHEAD)
        await restarting

    @pytest.mark.nightly
    async def test_restarted_master_is_joined(self, adapter):
        await drive(adapter, AHEAD, lambda s: s.velocity.linear > 0.2)
        await self.loses_its_master(adapter, self.restart_all)
        await standing(self.rig)
        await again(adapter)
        await drive(adapter, AHEAD, lambda s: s.velocity.linear > 0.2)

    @pytest.mark.nightly
    async def test_nodes_unknown_to_a_restarted_master_are_named_until_they_restart(
        self, adapter, monkeypatch
    ):
        await drive(adapter, AHEAD, lambda s: s.velocity.linear > 0.2)
        await self.loses_its_master(adapter, self.restart_master)
        await standing(self.rig)
        before = len(self.rig.world.commands)
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
        assert not any(linear or angular for _, linear, angular in self.rig.world.commands[before:])
        await asyncio.to_thread(self.rig.call, self.rig.restart_robot())
        await again(adapter)
        await drive(adapter, AHEAD, lambda s: s.velocity.linear > 0.2 and s.errors == ())

    @pytest.mark.nightly
    async def test_node_unknown_to_a_restarted_master_is_the_first_error(self, adapter):
        laser = RobotBus(self.rig.master, "laser_driver")
        await asyncio.to_thread(self.rig.call, laser.open(self.rig.lost.append, None))
        try:
            await wait_for(adapter, lambda _: "/laser_driver" in adapter._bus.known, 20.0)
            await self.loses_its_master(adapter, self.restart_all)
            await again(adapter)
            state = await wait_for(adapter, lambda s: s.errors, 10.0)
            assert state.errors[0] == master_restarted(["/laser_driver"])
        finally:
            await asyncio.to_thread(self.rig.call, laser.shut())
        await wait_for(adapter, lambda s: s.errors == (), 20.0)

    @pytest.mark.nightly
    async def test_robot_stops_when_the_agents_node_is_killed_and_the_node_is_replaced(
        self, adapter
    ):
        await drive(adapter, AHEAD, lambda s: s.velocity.linear > 0.2)
        os.kill(adapter._bus._child.pid, signal.SIGKILL)
        assert "node" in await lost(adapter, AHEAD)
        await standing(self.rig)
        await again(adapter)
        assert await some(adapter.states(), 2)

    @pytest.mark.nightly
    async def test_node_of_a_stuck_agent_publishes_zero_velocities(self, adapter):
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


async def test_connection_without_a_header_does_not_delay_subscribers():
    """Such a connection is meant for an earlier node, whose port this node has now."""
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
async def test_latched_message_reaches_a_later_subscriber():
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


async def test_node_unregisters_from_the_master_when_it_ends():
    with Ros1Rig("rhodon") as rig:
        async with connected(rig.adapter()) as adapter:
            await some(adapter.states(), 2)
        publishers, subscribers, services = ServerProxy(rig.master.uri).getSystemState("/test")[2]
        names = {
            name for each in (publishers, subscribers, services) for _, at in each for name in at
        }
        assert names == {"/base_driver"}


async def test_refused_base_connects_after_the_velocity_type_is_replaced():
    """The base asks for the publications again while the master keeps the node waiting."""
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
def test_malformed_master_address_is_named_with_its_option_or_variable(address, monkeypatch):
    expected = r"must be the address of the ROS master, such as http://192\.168\.1\.30:11311, not "
    with pytest.raises(AdapterError, match=f"^master {expected}'{address}'"):
        registry.create("ros1", "rhodon", {"master": address})
    monkeypatch.setenv("ROS_MASTER_URI", address)
    with pytest.raises(AdapterError, match=f"^ROS_MASTER_URI {expected}'{address}'"):
        registry.create("ros1", "rhodon")


@pytest.mark.parametrize(
    ("option", "value", "words"),
    [
        ("master", "http://127.0.0.1:1", r"no ROS master at http://127\.0\.0\.1:1"),
        ("python", "/no/such/python", "cannot be run"),
        ("python", "", "cannot be run"),
    ],
)
async def test_missing_master_or_python_is_named(option, value, words):
    with pytest.raises(AdapterError, match=words):
        await registry.create("ros1", "rhodon", {option: value}).connect()


def wrapper(folder, script):
    """Return a program that runs a line of shell and becomes Python."""
    program = folder / "python"
    program.write_text(f'#!/bin/sh\n{script} "$@"\n')
    program.chmod(0o755)
    return str(program)


async def test_python_without_rospy_is_reported_and_its_output_goes_to_stderr(tmp_path, capfd):
    python = wrapper(tmp_path, "echo logged\nexec /usr/bin/python3 -S -E")
    with pytest.raises(AdapterError, match="rospy is not installed"):
        await registry.create("ros1", "rhodon", {"python": python}).connect()
    out, err = capfd.readouterr()
    assert not out
    assert "logged" in err


def test_actions_of_ros_2_are_refused():
    with pytest.raises(AdapterError, match="move_base"):
        registry.create("ros1", "rhodon", {"navigation": "nav2"})


@pytest.mark.nightly
async def test_adapter_waits_for_a_rospy_that_needs_6_s_to_start(tmp_path):
    python = wrapper(tmp_path, "sleep 6\nexec /usr/bin/python3")
    with Ros1Rig("rhodon") as rig:
        async with connected(rig.adapter(python=python)) as adapter:
            assert await some(adapter.states(), 2)
