"""OpenMORA with the simulated robot behind it, as one client of a MOOSDB: a double, or a real one
by its address.

What it obeys and says is what the modules do: RobotControlManager/CRobotControllerApp.cpp (modes,
cancelling, nodes), MobileRobot_Giraff/CRobotGiraffApp.cpp (velocities in autonomous mode alone, the
head's angle when asked, charging when it changes), NavigatorReactivePTG/CReacNavPTGApp.cpp (goals
and their events), Executor/TExecutor.cpp and Planner/HPWA.cpp (plans), WorldModel/CAHGraphApp.cpp
(the nearest place), and those named in openmora_rules.py.
"""

import asyncio
import contextlib
import math
import time

from robots.agent.adapters.moos.client import MoosClient
from robots.agent.robot_interface import AdapterError
from tests.support.architectures import openmora_rules
from tests.support.architectures.frozen import ServerProcess
from tests.support.architectures.rca_world import RcaRig
from tests.support.patience import patient

HEARD = (
    "MOTION_REQUEST",
    "NAVIGATE_TARGET",
    "GO_TO_NODE",
    "GO_TO_RECHARGE",
    "PARKING",
    "CANCEL_NAVIGATION",
    "NEW_TASK",
    "TILT_SET_ANGLE_FROM_HOME",
    "RELOCALIZE_IN_AREA",
    "TILT_GET_ANGLE_FROM_HOME",
    "CLIENT_MQTT_ACK",
)
MANUAL, AUTONOMOUS = 0, 2
CLIENT_ACK_INTERVAL = 2.0  # max_client_ack_interval, with use_client_alive_ack
NODES = {"Sofa": (6.4, 1.0), "Door": (5.9, 1.0)}
VIA = {"Sofa": "Door"}  # a plan of two journeys


class MoosRig(RcaRig):
    """`address` is a real MOOSDB's host:port."""

    adapter_name = "moos"

    def __init__(self, series="giraff", address="", listening="127.0.0.1"):
        super().__init__(series)
        self.db = (
            None if address else ServerProcess("tests.support.architectures.moosdb", listening)
        )
        self._address = address
        self._client = None
        self._began = 0.0
        self._told = ""
        self._charging = None
        self._acked_at = 0.0
        self._mode = MANUAL
        self._plan = []  # the nodes that are still to be reached
        self.bumped = 0.0

    def where(self):
        host, _, port = (self._address or f"{self.db.host}:{self.db.port}").rpartition(":")
        return host, int(port)

    def options(self):
        host, port = self.where()
        return {"host": host, "port": str(port), "nodes": "Sofa"}

    async def up(self):
        if self.db:
            await asyncio.to_thread(self.db.start)
        host, port = self.where()
        self._client = MoosClient("OpenMORA", host, port, self._take, lambda _: None)
        self._began = time.time()
        await self._client.connect()
        for key in HEARD:
            self._client.register(key)

    async def down(self):
        if self.db:
            self.db.kill()
        await self._client.close()
        self.world.cancel()

    async def after_reset(self):
        self._mode, self._plan, self._told = MANUAL, [], ""

    def freeze(self, *, on):
        self.db.freeze(on=on)

    def _take(self, mail):
        if mail.time < self._began:
            return  # what was said to a robot before this one
        world, value = self.world, mail.value
        match mail.key:
            case "MOTION_REQUEST":
                self._mode, self._plan = AUTONOMOUS, []
                world.drive(*map(float, value.split()))
            case "NAVIGATE_TARGET":
                self._go_to(openmora_rules.target(value))
            case "GO_TO_NODE":
                self._plan = [node for node in (VIA.get(value), value) if node in NODES]
                self._next_node()
            case "GO_TO_RECHARGE":
                self._mode = AUTONOMOUS  # as PARKING does at the end of the plan
                world.dock()
            case "NEW_TASK":
                assert value == "ROBOT_CONTROLLER 1 UNDOCK"
                # it is a MOTION_CMD_V, which the base obeys in no other mode
                if self._mode == AUTONOMOUS:
                    world.undock()
            case "CANCEL_NAVIGATION":
                self._cancel()
            case "CLIENT_MQTT_ACK":
                self._acked_at = time.monotonic()
            case "TILT_SET_ANGLE_FROM_HOME":
                world.tilt(world.sim.model.tilt.home + math.radians(value))
                self._say_angle()
            case "TILT_GET_ANGLE_FROM_HOME":
                self._say_angle()
            case "RELOCALIZE_IN_AREA":
                openmora_rules.relocalize(world, value)

    def _cancel(self):
        self._mode, self._plan = MANUAL, []
        self.world.cancel()
        self.world.drive(0.0, 0.0)

    def _go_to(self, target):
        self._mode = AUTONOMOUS
        if target is not None:
            self.world.go_to(*target)

    def _next_node(self):
        if self._plan:
            self._go_to(NODES[self._plan[0]])
        else:  # nothing to do, or no way to it: both end the plan
            self._mode = MANUAL
            self._client.notify("PLAN_FINISHED", "7 0 ROBOT_CONTROLLER")

    def _say_angle(self):
        sim = self.world.sim
        if sim.model.tilt:
            self._client.notify(
                "TILT_CURRENT_ANGLE_FROM_HOME", math.degrees(sim.tilt - sim.model.tilt.home)
            )

    async def say(self, count):
        with contextlib.suppress(AdapterError):
            self._say(count)

    def _say(self, count):
        sim, notify = self.world.sim, self._client.notify
        if time.monotonic() - self._acked_at > patient(CLIENT_ACK_INTERVAL) and not sim.docked:
            self._cancel()
        if count % 3 == 0:
            suffix, pose = "deg" if count % 2 else "", self.world.believed
            notify(
                "LOCALIZATION",
                f"[{pose.x:.4f} {pose.y:.4f} {math.degrees(pose.theta):.3f}{suffix}]",
            )
        if count % 10 == 0:
            notify("BATTERY_V_FLOAT", sim.voltage())
            notify(
                "ROBOT_TOPOLOGICAL_PLACE",
                min(NODES, key=lambda node: math.dist(NODES[node], sim.pose[:2])),
            )
        if sim.docked != self._charging:
            self._charging = sim.docked
            notify("BATTERY_IS_CHARGING", float(sim.docked))
        if count % 5 == 1:
            notify("BUMPERS", self.bumped)
        self._tell_of_journey(notify)

    def _tell_of_journey(self, notify):
        journey, kind = self.world.journey, self.world.kind
        if journey == self._told:
            return
        self._told = journey
        if kind == "goto":
            event = {
                "running": "NAV_EVENT_START",
                "done": "NAV_EVENT_END",
                "failed": "NAV_EVENT_ERROR",
            }.get(journey)
            if event:
                notify(event, "")
            if journey == "done" and self._plan:
                self._plan.pop(0)
                self._next_node()
        elif kind == "dock" and journey == "done":
            self._mode = MANUAL  # AutoDocking sets PARKING to 0
