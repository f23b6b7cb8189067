"""The simulated robot as a client of a rosbridge, ours or a real one, with its move_base or Nav2
and its docking.
"""

import asyncio
import contextlib
import json

from websockets.asyncio.client import connect
from websockets.exceptions import ConnectionClosed

from tests.support.architectures.frozen import ServerProcess
from tests.support.architectures.rca_world import RcaRig
from tests.support.architectures.ros_robot import BASE, DOCKING, RosRobot

NAVIGATE = "/navigate_to_pose"
STATUS, CANCEL = f"{NAVIGATE}/_action/status", f"{NAVIGATE}/_action/cancel_goal"
STATUSES = {STATUS: "action_msgs/GoalStatusArray"}
CANCELS = {CANCEL: "action_msgs/srv/CancelGoal"}


class RosbridgeRig(RcaRig):
    """`url` names a real rosbridge; without it, a double."""

    adapter_name = "rosbridge"

    def __init__(self, series, version, url="", *, listening="127.0.0.1", base=BASE, words=()):
        super().__init__(series)
        self.version, self._url = version, url
        self.server = (
            None
            if url
            else ServerProcess("tests.support.architectures.rosbridge_server", listening, words)
        )
        self.robot = RosRobot(self.world, version, base)
        self._socket = self._listening = None
        self._nav_goal = None

    @property
    def url(self):
        return self._url or f"ws://{self.server.host}:{self.server.port}"

    def options(self):
        return {"url": self.url, "version": str(self.version), **self.robot.options}

    async def up(self):
        if self.server:
            await asyncio.to_thread(self.server.start)
        self._socket = await connect(self.url, max_size=None, compression=None)
        robot, one = self.robot, self.version == 1
        for topic, kind in (robot.TOPICS | (robot.MOVE_BASE_SAYS if one else STATUSES)).items():
            latch = topic in {"/amcl_pose", STATUS}
            spelled = self._spelled(kind, "msg")
            await self._send(op="advertise", topic=topic, type=spelled, latch=latch)
        for topic, kind in (robot.hears | (robot.MOVE_BASE_HEARS if one else {})).items():
            await self._send(op="subscribe", topic=topic, type=self._spelled(kind, "msg"))
        trigger = self._spelled("std_srvs/Trigger", "srv")
        services = dict.fromkeys(DOCKING, trigger) | ({} if one else CANCELS)
        for service, kind in services.items():
            await self._send(op="advertise_service", service=service, type=kind)
        if not one:
            kind = "nav2_msgs/action/NavigateToPose"
            await self._send(op="advertise_action", action=NAVIGATE, type=kind)
        robot.restarted()
        self._nav_goal = None
        self._listening = asyncio.ensure_future(self._listen())

    async def down(self):
        self._listening.cancel()
        with contextlib.suppress(asyncio.CancelledError, ConnectionClosed):
            await self._listening
        if self.server:
            self.server.kill()
        self._socket.transport.abort()
        self.world.cancel()

    def freeze(self, *, on):
        self.server.freeze(on=on)

    async def after_reset(self):
        self.robot.restarted()
        self._nav_goal = None

    def _spelled(self, kind, group):
        return kind if self.version == 1 else kind.replace("/", f"/{group}/")

    async def _send(self, **message):
        with contextlib.suppress(ConnectionClosed):
            await self._socket.send(json.dumps(message))

    async def _listen(self):
        async for text in self._socket:
            message = json.loads(text)
            match message["op"]:
                case "publish":
                    self.robot.hear(message["topic"], message["msg"])
                case "call_service":
                    await self._answer(message)
                case "send_action_goal":
                    self._nav_goal = message["id"]
                    self.robot.go(message["args"]["pose"], message["id"])
                case "cancel_action_goal":
                    self.robot.cancel()
                case "status":
                    self.errors.append(message)

    async def _answer(self, call):
        service = call["service"]
        if service == CANCEL:
            if self.robot.goal is not None:
                self.robot.cancel()
            running = self.world.journey == "running" and self.world.kind == "goto"
            values = {"return_code": 0, "goals_canceling": [{}] if running else []}
        else:
            getattr(self.world, DOCKING[service])()
            values = {"success": True, "message": ""}
        await self._send(
            op="service_response", service=service, id=call["id"], values=values, result=True
        )

    async def say(self, count):
        due = self.robot.due(count)
        if self.version == 1:
            due += self.robot.move_base_due(count)
        elif self._nav_goal is not None:
            await self._report_goal(count)
        if self.version == 2 and count % 10 == 0:
            due.append((STATUS, {"status_list": self._nav_statuses()}))
        for topic, message in due:
            await self._send(op="publish", topic=topic, msg=message)

    def _nav_statuses(self):
        """action_msgs/GoalStatus, which Nav2 publishes on each change."""
        if self.robot.goal is None or self.world.journey == "":
            return []
        failed = 5 if self.robot.cancelled == self.robot.goal else 6
        status = {"running": 2, "done": 4, "failed": failed}.get(self.world.journey, 6)
        return [{"goal_info": {"goal_id": {"uuid": self.robot.goal}}, "status": status}]

    async def _report_goal(self, count):
        goal = {"action": NAVIGATE, "id": self._nav_goal}
        if self.robot.over():
            status = self._nav_statuses()[0]["status"]
            await self._send(op="action_result", values={}, status=status, result=True, **goal)
            self._nav_goal = None
        elif count % 10 == 0 and self.world.journey == "running":
            await self._send(op="action_feedback", values={"distance_remaining": 1.0}, **goal)
