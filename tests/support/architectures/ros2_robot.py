"""The simulated robot on real DDS, between processes, on the loopback interface only."""

import asyncio
import contextlib
import json
import os
import sys

from tests.support.architectures.frozen import freeze
from tests.support.architectures.rca_world import RcaRig
from tests.support.architectures.ros_robot import BASE, RosRobot
from tests.support.paths import ROOT

LOOPBACK = (
    '<CycloneDDS><Domain><General><Interfaces><NetworkInterface name="lo"'
    ' multicast="false"/></Interfaces></General><Discovery>'
    "<ParticipantIndex>auto</ParticipantIndex><Peers><Peer"
    ' address="127.0.0.1"/></Peers></Discovery></Domain></CycloneDDS>'
)
STATUS = "/navigate_to_pose/_action/status"


class Ros2Rig(RcaRig):
    adapter_name = "ros2"

    def __init__(self, series="giraff", base=BASE, words=()):
        super().__init__(series)
        self.words = (*base, *words)
        worker = int(os.environ.get("PYTEST_XDIST_WORKER", "gw0").removeprefix("gw"))
        # another one than that of any other process of this run
        self.domain = 20 + os.getpid() % 20 * 4 + worker % 4
        self.robot = RosRobot(self.world, 2, base)
        self.goals = 0
        self._node = self._listening = None

    def options(self):
        tilts = (
            {"tilt": "/head/command", "tilt_joint": "head_tilt"}
            if self.world.sim.model.tilt
            else {}
        )
        return {"domain": str(self.domain), **tilts}

    async def up(self):
        command = [
            sys.executable,
            "-m",
            "tests.support.architectures.ros2_robot_node",
            str(self.domain),
            *self.words,
        ]
        pipe = asyncio.subprocess.PIPE
        self._node = await asyncio.create_subprocess_exec(
            *command, cwd=ROOT, stdin=pipe, stdout=pipe, limit=1 << 20
        )
        assert json.loads(await self._node.stdout.readline())[0] == "ready"
        self.robot.restarted()
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

    async def _listen(self):
        while line := await self._node.stdout.readline():
            topic, message = json.loads(line)
            if topic == "/goal_pose":
                self.goals += 1
                self.robot.go(message, str(self.goals))
            else:
                self.robot.hear(topic, message)

    async def say(self, count):
        for topic, message in self.robot.says(count) + self._nav2(count):
            with contextlib.suppress(ConnectionError):
                self._node.stdin.write((json.dumps([topic, message]) + "\n").encode())

    def _nav2(self, count):
        """Nav2 tells of its goals when one of them changes, and keeps the old ones."""
        over = self.robot.over()
        if not self.goals or not (over or count % 10 == 0):
            return []
        status = {"running": 2, "done": 4}.get(self.world.journey, 6)
        entries = [
            {"goal_info": {"goal_id": {"uuid": [number] * 16}}, "status": 4}
            for number in range(1, self.goals)
        ]
        entries.append({"goal_info": {"goal_id": {"uuid": [self.goals] * 16}}, "status": status})
        return [(STATUS, {"status_list": entries[-5:]})]
