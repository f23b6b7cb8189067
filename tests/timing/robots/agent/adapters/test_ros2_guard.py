"""How soon ROS 2's guard ends a goal whose agent is lost, with real rclpy nodes over Fast DDS.
`pytest -s` prints the figures.
"""

import asyncio
import signal
import time
from pathlib import Path

import pytest

from robots.api.messages import Velocity
from tests.support.agents.agent_process import wait
from tests.support.architectures.adapter_conformance import drive
from tests.support.architectures.goal_client import going
from tests.support.architectures.rca_conformance import connected
from tests.support.architectures.ros2_robot import Ros2Rig

AHEAD = Velocity(linear=0.25, angular=0.0)
ZERO_WITHIN = 0.65  # s: the heartbeat's 0.5 s, and the periods of the guard and of the planner
TICK = 0.02  # s between two turns of the control loop


@pytest.fixture(scope="module")
def rig():
    with Ros2Rig("giraff") as rig:
        yield rig
        assert not rig.errors


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP])
def test_lost_agent_leaves_no_goal_and_a_zero_velocity_within_the_bound(rig, number):
    rig.reset()
    with going(rig) as process:
        seen, began = len(rig.world.commands), time.monotonic()
        process.send_signal(number)
        wait(lambda: len(rig.world.commands) > seen)  # no velocity counts while the planner drives
        after = rig.world.commands[seen][0] - began
        wait(lambda: not rig.world.sim.motion.linear)
        print(
            f"\n{number.name}: planner cancelled and zero after {after:.2f} s,"
            f" standstill after {time.monotonic() - began:.2f} s"
        )
    assert after < ZERO_WITHIN
    assert {each[1:] for each in rig.world.commands[seen:]} == {(0.0, 0.0)}


async def apply_ahead(adapter, until):
    while not until():
        adapter.apply(AHEAD)
        await asyncio.sleep(TICK)


async def test_base_frozen_while_the_node_was_killed_ends_with_a_zero_velocity(rig):
    rig.reset()
    async with connected(rig.adapter()) as adapter:
        node = adapter._bus._child
        maps = Path(f"/proc/{node.pid}/maps").read_text()
        assert "/dev/shm/fastrtps" not in maps, "the node uses shared memory"
        await drive(adapter, AHEAD, lambda s: s.velocity.linear > 0.2)
        seen = len(rig.world.commands)
        await apply_ahead(adapter, lambda: len(rig.world.commands) > seen)
        await asyncio.to_thread(rig.freeze, on=True)
        try:
            until = time.monotonic() + 1.0
            await apply_ahead(adapter, lambda: time.monotonic() > until)
            node.kill()
            await asyncio.to_thread(node.wait)
        finally:
            await asyncio.to_thread(rig.freeze, on=False)
        await asyncio.sleep(1.0)
    assert rig.world.commands[-1][1:] == (0.0, 0.0)
