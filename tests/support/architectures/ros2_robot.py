"""The simulated robot on real ROS 2 (rclpy and Fast DDS), between processes of this computer."""

import asyncio
import contextlib
import json
import os
from pathlib import Path

from tests.support.architectures.frozen import freeze
from tests.support.architectures.rca_world import RcaRig
from tests.support.architectures.ros_robot import BASE, DOCKING, RosRobot
from tests.support.paths import ROOT

# `make setup-ros2` installs rclpy there, and messages that we define.
PYTHON = ROOT / "var" / "ros2" / "bin" / "python"
DISCOVERY = ("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
NODE = Path(__file__).with_name("ros2_robot_node.py")


class Ros2Rig(RcaRig):
    adapter_name = "ros2"

    def __init__(self, series="giraff", base=BASE, **wish):
        super().__init__(series)
        worker = int(os.environ.get("PYTEST_XDIST_WORKER", "gw0").removeprefix("gw"))
        # unlike that of every other process of this run
        self.domain = 20 + os.getpid() % 20 * 4 + worker % 4
        self.robot = RosRobot(self.world, 2, base)
        self.wish = {
            "publishes": RosRobot.TOPICS,
            "hears": RosRobot.COMMANDS | dict([base]),
            "services": list(DOCKING),
            **wish,
        }
        self.goals = 0
        self._journey = ""
        self._node = self._listening = None

    def __enter__(self):
        os.environ.setdefault(*DISCOVERY)
        return super().__enter__()

    def options(self):
        return {"python": str(PYTHON), "domain": str(self.domain), **self.robot.options}

    async def up(self):
        pipe = asyncio.subprocess.PIPE
        self._node = await asyncio.create_subprocess_exec(
            PYTHON,
            NODE,
            json.dumps(self.wish),
            cwd=ROOT,
            env=os.environ | {"ROS_DOMAIN_ID": str(self.domain)},
            stdin=pipe,
            stdout=pipe,
            limit=1 << 20,
        )
        assert json.loads(await self._node.stdout.readline())[0] == "ready"
        self.robot.restarted()
        self._journey = ""
        self._listening = asyncio.ensure_future(self._listen())

    async def down(self):
        self._node.kill()
        await self._node.wait()
        self._listening.cancel()
        await asyncio.gather(self._listening, return_exceptions=True)
        self.world.cancel()

    def freeze(self, *, on):
        freeze(self._node.pid, on=on)

    async def after_reset(self):
        self.robot.restarted()
        self.tell("planner", {"has_ended": True})

    def planner(self, **behaviour):
        """Set attributes of the `Planner` of ros2_robot_node.py."""

        async def tell():
            self.tell("planner", behaviour)

        self.call(tell())

    async def _listen(self):
        while line := await self._node.stdout.readline():
            topic, message = json.loads(line)
            if topic == "goal":
                self.goals += 1
                delay, self.world.accept_after = self.world.accept_after, 0.0  # the node waited
                self.robot.go(message, str(self.goals))
                self.world.accept_after, self._journey = delay, "running"
            elif topic == "cancel":
                obeyed = self.world.cancel()
                self._journey = "" if obeyed else self._journey  # the planner ends it itself
                self.tell("answer", obeyed)
            elif topic == "asked":
                self.tell("answer", self.world.accept_after)
            elif topic == "/cancel_dock" and self._journey == "running":
                pass  # that is not a docking
            elif topic in DOCKING:
                getattr(self.world, DOCKING[topic])()
            else:
                self.robot.hear(topic, message)

    def tell(self, topic, message):
        with contextlib.suppress(ConnectionError):
            self._node.stdin.write((json.dumps([topic, message]) + "\n").encode())

    async def say(self, count):
        for topic, message in self.robot.due(count):
            self.tell(topic, message)
        if self._journey == "running" and self.world.journey != "running":
            self._journey = self.world.journey
            self.tell("journey", self._journey)
