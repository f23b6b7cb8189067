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
from tests.support.architectures.ros_robot import BASE, RosRobot

DOCKING = ("/dock", "/undock", "/cancel_dock")
NAVIGATE = "/navigate_to_pose"
STATUS, CANCEL = f"{NAVIGATE}/_action/status", f"{NAVIGATE}/_action/cancel_goal"


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
        named = {"dock": "/dock", "undock": "/undock", "cancel_dock": "/cancel_dock"}
        if self.series_tilts():
            named |= {"tilt": "/head/command", "tilt_joint": "head_tilt"}
        return {"url": self.url, "version": str(self.version), **named}

    def series_tilts(self):
        return self.world.sim.model.tilt is not None

    async def up(self):
        if self.server:
            await asyncio.to_thread(self.server.start)
        self._socket = await connect(self.url, max_size=None, compression=None)
        topics = self.robot.TOPICS | (
            {"/move_base/status": "", "/move_base/result": ""}
            if self.version == 1
            else {STATUS: ""}
        )
        for topic in topics:
            await self._send(
                {
                    "op": "advertise",
                    "topic": topic,
                    "type": self._type(topic),
                    "latch": topic in {"/amcl_pose", STATUS},
                }
            )
        for topic in self.robot.hears | (
            {"/move_base/goal": "", "/move_base/cancel": ""} if self.version == 1 else {}
        ):
            await self.listen(topic)
        for service in DOCKING:
            await self._send(
                {
                    "op": "advertise_service",
                    "service": service,
                    "type": self._spelled("std_srvs/Trigger", "srv"),
                }
            )
        if self.version == 2:
            await self._send(
                {
                    "op": "advertise_service",
                    "service": CANCEL,
                    "type": "action_msgs/srv/CancelGoal",
                }
            )
            await self._send(
                {
                    "op": "advertise_action",
                    "action": NAVIGATE,
                    "type": "nav2_msgs/action/NavigateToPose",
                }
            )
        self.robot.restarted()
        self._nav_goal = None
        self._listening = asyncio.ensure_future(self._listen())

    async def listen(self, topic):
        await self._send({"op": "subscribe", "topic": topic, "type": self._type(topic)})

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

    def _type(self, topic):
        robot = self.robot
        own = {STATUS: "action_msgs/GoalStatusArray"}
        return self._spelled((robot.TOPICS | robot.hears | robot.MOVE_BASE | own)[topic], "msg")

    def _spelled(self, kind, group):
        return kind if self.version == 1 else kind.replace("/", f"/{group}/")

    async def _send(self, message):
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
        if call["service"] == CANCEL:
            if self.robot.goal is not None:
                self.robot.cancel()
            running = self.world.journey == "running" and self.world.kind == "goto"
            values = {"return_code": 0, "goals_canceling": [{}] if running else []}
            answer = {"op": "service_response", "service": CANCEL, "id": call["id"]}
            await self._send(answer | {"values": values, "result": True})
            return
        {"/dock": self.world.dock, "/undock": self.world.undock, "/cancel_dock": self.world.cancel}[
            call["service"]
        ]()
        answer = {
            "op": "service_response",
            "service": call["service"],
            "id": call["id"],
            "values": {"success": True, "message": ""},
        }
        await self._send(answer | {"result": True})

    async def say(self, count):
        said = self.robot.says(count)
        if self.version == 1:
            said += self.robot.move_base_says(count)
        elif self._nav_goal is not None:
            await self._tell_of_goal(count)
        if self.version == 2 and count % 10 == 0:
            said.append((STATUS, {"status_list": self._nav_statuses()}))
        for topic, message in said:
            await self._send({"op": "publish", "topic": topic, "msg": message})

    def _nav_statuses(self):
        """Nav2 publishes it on each change; action_msgs/GoalStatus."""
        if self.robot.goal is None or self.world.journey == "":
            return []
        failed = 5 if self.robot.cancelled == self.robot.goal else 6
        status = {"running": 2, "done": 4, "failed": failed}.get(self.world.journey, 6)
        return [{"goal_info": {"goal_id": {"uuid": self.robot.goal}}, "status": status}]

    async def _tell_of_goal(self, count):
        about = {"action": NAVIGATE, "id": self._nav_goal}
        if self.robot.over():
            await self._send(
                {
                    "op": "action_result",
                    "values": {},
                    "status": self._nav_statuses()[0]["status"],
                    "result": True,
                    **about,
                }
            )
            self._nav_goal = None
        elif count % 10 == 0 and self.world.journey == "running":
            await self._send(
                {"op": "action_feedback", "values": {"distance_remaining": 1.0}, **about}
            )
