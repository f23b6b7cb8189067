"""How soon ROS 2's guard ends a goal whose agent is lost, and how often velocities reach the base.

Real rclpy nodes over Fast DDS. `pytest -s` prints the figures.
"""

import asyncio
import contextlib
import signal
import sys
import time
from pathlib import Path

import pytest

from robots.api.messages import Velocity
from tests.support.architectures.adapter_conformance import drive
from tests.support.architectures.goal_client import going
from tests.support.architectures.rca_conformance import connected
from tests.support.architectures.ros2_robot import Ros2Rig

AHEAD = Velocity(linear=0.25, angular=0.0)
ZERO_WITHIN = 0.65  # s: the heartbeat's 0.5 s, and rounds of the guard and of the planner
TICK = 0.02  # s between two turns of the control loop
MEASURED = 4.0  # s


@pytest.fixture(scope="module")
def rig():
    with Ros2Rig("giraff") as rig:
        yield rig
        assert not rig.errors


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP])
def test_a_lost_agent_leaves_no_goal_and_a_zero_velocity_within_the_bound(rig, number):
    rig.reset()
    with going(rig) as process:
        seen, began = len(rig.world.commands), time.monotonic()
        process.send_signal(number)
        while len(rig.world.commands) == seen:  # no velocity counts while the planner drives
            assert time.monotonic() - began < 10.0
            time.sleep(0.002)
        after = rig.world.commands[seen][0] - began
        while rig.world.sim.motion.linear:
            assert time.monotonic() - began < 10.0
            time.sleep(0.002)
        sys.stdout.write(
            f"\n{number.name}: planner cancelled and zero after {after:.2f} s,"
            f" standstill after {time.monotonic() - began:.2f} s\n"
        )
    assert after < ZERO_WITHIN
    assert {each[1:] for each in rig.world.commands[seen:]} == {(0.0, 0.0)}


async def test_a_base_that_was_frozen_when_the_node_was_killed_ends_with_a_zero_velocity(rig):
    rig.reset()
    async with connected(rig.adapter()) as adapter:
        node = adapter._bus._child
        maps = Path(f"/proc/{node.pid}/maps").read_text()
        assert "/dev/shm/fastrtps" not in maps, "the node uses shared memory"
        await drive(adapter, AHEAD, lambda s: s.velocity.linear > 0.2)
        seen = len(rig.world.commands)
        while len(rig.world.commands) == seen:
            adapter.apply(AHEAD)
            await asyncio.sleep(TICK)
        await asyncio.to_thread(rig.freeze, on=True)
        try:
            until = time.monotonic() + 1.0
            while time.monotonic() < until:
                adapter.apply(AHEAD)
                await asyncio.sleep(TICK)
            node.kill()
            await asyncio.to_thread(node.wait)
        finally:
            await asyncio.to_thread(rig.freeze, on=False)
        await asyncio.sleep(1.0)
    sys.stdout.write(f"\n{rig.world.commands[seen:]}\n")
    assert rig.world.commands[-1][1:] == (0.0, 0.0)


async def test_the_base_receives_a_velocity_for_each_odometry(rig):
    rig.reset()
    async with connected(rig.adapter()) as adapter:
        await drive(adapter, AHEAD, lambda s: s.velocity.linear > 0.2)
        odometry, stop = set(), asyncio.Event()

        async def listen():
            async for state in adapter.states():
                odometry.add(state.stamp)

        async def press():
            while not stop.is_set():
                adapter.apply(AHEAD)
                await asyncio.sleep(TICK)

        listening, pressing = asyncio.ensure_future(listen()), asyncio.ensure_future(press())
        await asyncio.sleep(0.2)
        before, began = len(rig.world.commands), time.monotonic()
        readings = len(odometry)
        await asyncio.sleep(MEASURED)
        took = time.monotonic() - began
        rate, measured = (
            (len(rig.world.commands) - before) / took,
            (len(odometry) - readings) / took,
        )
        stop.set()
        listening.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await asyncio.gather(listening, pressing)
    sys.stdout.write(f"\nvelocities {rate:.1f}/s, states {measured:.1f}/s\n")
    assert rate > 15.0
