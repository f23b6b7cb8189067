"""ROS 1 with a real master and real nodes: the conformance suite, and what a restart of each part
does.
"""

import asyncio
import os
import signal

import pytest

from robots.agent.adapters import registry
from robots.agent.robot_interface import AdapterError
from robots.api.messages import Velocity
from tests.support.adapter_conformance import drive, some, wait_for
from tests.support.rca_conformance import RcaConformance, again, lost, sees_grey, standing
from tests.support.ros1_robot import Ros1Rig

AHEAD = Velocity(linear=0.25, angular=0.0)


class TestRhodon(RcaConformance):
    def make_rig(self, directory):
        return Ros1Rig("rhodon")

    async def test_pictures_of_a_topic_are_its_camera(self):
        await sees_grey(self.rig.adapter(image="/camera/compressed"))

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
        await self.rig._bus.shut()
        await self.rig.start_robot()
        self.rig.running = True

    async def test_a_node_that_is_killed_stops_the_robot_by_its_watchdog_and_is_replaced(
        self, adapter
    ):
        await drive(adapter, AHEAD, lambda s: s.velocity.linear > 0.2)
        os.kill(adapter._bus._child.pid, signal.SIGKILL)
        assert "node" in await lost(adapter, AHEAD)
        await standing(self.rig)
        await again(adapter)
        assert await some(adapter.states(), 2)

    async def test_a_node_whose_agent_is_stuck_says_stand(self, adapter):
        await drive(adapter, AHEAD, lambda s: s.velocity.linear > 0.2)
        self.rig.world.commands.clear()
        adapter.apply(AHEAD)
        await wait_for(
            adapter,
            lambda _: self.rig.world.commands[-1:] and self.rig.world.commands[-1][1] == 0.0,
            3.0,
        )


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


def test_actions_of_ros_2_are_refused():
    with pytest.raises(AdapterError, match="move_base"):
        registry.create("ros1", "rhodon", {"navigation": "nav2"})
