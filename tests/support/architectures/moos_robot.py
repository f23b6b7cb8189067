"""OpenMORA with the simulated robot behind it, as clients of a MOOSDB: a double, or a real one by
its address.

It behaves as the modules: RobotControlManager/CRobotControllerApp.cpp (modes, cancelling, nodes,
the guard), MobileRobot_Giraff/CRobotGiraffApp.cpp (velocities only in autonomous mode, the head's
angle on request, charging when it changes), NavigatorReactivePTG3D/CReacNavPTGApp3D.cpp (goals,
velocities, NAV_EVENT_END and no START), Executor/TExecutor.cpp and Planner/HPWA.cpp (plans: each
ends with PLAN_FINISHED, and one that starts ignores an earlier cancel), WorldModel/CAHGraphApp.cpp
(the nearest place), and those named in openmora_rules.py.
"""

import asyncio
import contextlib
import math
import os
import time

from robots.agent.adapters.moos.client import MoosClient
from robots.agent.robot_interface import AdapterError
from tests.support.architectures import openmora_rules
from tests.support.architectures.frozen import ServerProcess
from tests.support.architectures.rca_world import RcaRig
from tests.support.patience import patient

REGISTERED = (
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
MANUAL, AUTONOMOUS = 0.0, 2.0
CLIENT_ACK_INTERVAL = 2.0  # max_client_ack_interval, with use_client_alive_ack
PLANNING = 0.2  # s from a task to its plan: the planner polls its answers every 0.1 s
NODES = {"Sofa": (6.4, 1.0), "Door": (5.9, 1.0)}
VIA = {"Sofa": "Door"}  # a plan of two journeys


class HangingClient(MoosClient):
    """A client that can hang: messages to it then stay in its socket."""

    def hang(self, on):
        transport = self._writer.transport
        (transport.pause_reading if on else transport.resume_reading)()


class RealMoosDb(ServerProcess):
    """The program MOOSDB of core-moos, which listens on all addresses of this machine."""

    def command(self):
        return [self.module, f"--moos_port={self.port}", "--moos_community=test"]


class MoosRig(RcaRig):
    """`address` is a real MOOSDB's host:port. With MOOSDB_PROGRAM=/path/to/MOOSDB, the rig starts
    a real one instead of the double.
    """

    adapter_name = "moos"

    def __init__(self, series="giraff", address="", listening="127.0.0.1"):
        super().__init__(series)
        program = os.environ.get("MOOSDB_PROGRAM")
        double = "tests.support.architectures.moosdb"
        made = RealMoosDb(program, listening) if program else ServerProcess(double, listening)
        self.db = None if address else made
        self._address = address
        self._client = self._controller = self._navigator = None
        self.ack_interval = patient(CLIENT_ACK_INTERVAL)
        self._began = 0.0
        self._reported = ""
        self._charging = None
        self._acked_at = 0.0
        self._mode = MANUAL
        # the nodes not reached yet, the time at which the plan starts, and its number
        self._plan, self._plan_at, self._number = [], math.inf, ""
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
        self._began = time.time()
        self._client = await self._connected("MobileRobot_Giraff", self._take)
        self._controller = await self._connected("RobotControlManager")
        self._navigator = await self._connected("NavigatorReactivePTG3D")
        for key in REGISTERED:
            self._client.register(key)

    async def _connected(self, name, take=lambda _: None):
        client = HangingClient(name, *self.where(), take, lambda _: None)
        await client.connect()
        return client

    async def down(self):
        if self.db:
            self.db.kill()
        for client in (self._client, self._controller, self._navigator):
            await client.close()
        self.world.cancel()

    async def after_reset(self):
        self._mode, self._reported = MANUAL, ""
        self._plan, self._plan_at = [], math.inf

    def freeze(self, *, on):
        self.world.hung = on  # the navigator's velocities reach the base through the database
        self.db.freeze(on=on)

    def hang(self, *, on):
        """Let all modules of the robot hang behind a database that runs on, or resume them."""
        self.running, self.world.hung = not on, on
        self.loop.call_soon_threadsafe(self._client.hang, on)

    def give_up(self):
        """End what OpenMORA does without an event, as a CANCEL_NAVIGATION of another client."""
        self.loop.call_soon_threadsafe(self._cancel)

    def resume(self, goal):
        """Let OpenMORA start a journey."""
        self.loop.call_soon_threadsafe(self._go_to, (goal.x, goal.y))

    def _take(self, mail):
        if mail.time < self._began:
            return  # for an earlier robot
        world, value = self.world, mail.value
        match mail.key:
            case "MOTION_REQUEST":
                self._move(*map(float, value.split()))
            case "NAVIGATE_TARGET":
                self._go_to(openmora_rules.target(value))
            case "GO_TO_NODE":
                self._set_mode(AUTONOMOUS)
                self._start_plan("0", [node for node in (VIA.get(value), value) if node in NODES])
            case "GO_TO_RECHARGE":
                world.cancel()  # all earlier tasks
                self._start_plan("505", ["dock"])
            case "NEW_TASK":
                assert value == "ROBOT_CONTROLLER 1 UNDOCK"
                self._start_plan("1", ["undock"])
            case "CANCEL_NAVIGATION":
                self._cancel()
            case "PARKING":
                assert value == 0.0
            case "CLIENT_MQTT_ACK":
                self._acked_at = time.monotonic()
            case "TILT_SET_ANGLE_FROM_HOME":
                world.tilt(world.sim.model.tilt.home + math.radians(value))
                self._say_angle()
            case "TILT_GET_ANGLE_FROM_HOME":
                self._say_angle()
            case "RELOCALIZE_IN_AREA":
                openmora_rules.relocalize(world, value)

    def _set_mode(self, mode):
        if MANUAL in (mode, self._mode):
            self._controller.notify("ROBOT_CONTROL_MODE", mode)
        self._mode = mode

    def _move(self, linear, angular):
        self.world.pause()  # PNAVIGATORREACTIVEPTG3D_CMD PAUSE
        if self._plan_at == math.inf:
            self._plan = []
        self._set_mode(AUTONOMOUS)
        self._controller.notify("MOTION_CMD_V", linear)
        self._controller.notify("MOTION_CMD_W", angular)
        self.world.drive(linear, angular)

    def _cancel(self):
        if self.world.cancel():
            self.world.journey = ""  # without an event
            self._set_mode(MANUAL)
            self.world.drive(0.0, 0.0)
            if self._plan_at == math.inf and self._plan:
                self._end_plan()

    def _go_to(self, target):
        self._set_mode(AUTONOMOUS)
        if target is not None:
            self.world.go_to(*target)

    def _start_plan(self, number, steps):
        self._number, self._plan = number, steps
        self._plan_at = time.monotonic() + PLANNING + self.world.accept_after

    def _next_step(self):
        self._plan_at = math.inf
        match self._plan:
            case []:  # done, or without a route: both end the plan
                self._end_plan()
            case ["undock"]:
                # a MOTION_CMD_V, which the base obeys only in this mode
                if self._mode == AUTONOMOUS:
                    self.world.undock()
            case ["dock"]:
                self._set_mode(AUTONOMOUS)  # as PARKING does at the end of the plan
                self._end_plan()
                self.world.dock()
            case [node, *_]:
                self._go_to(NODES[node])

    def _end_plan(self):
        self._plan = []
        if self._number == "0":
            self._set_mode(MANUAL)
        self._client.notify("PLAN_FINISHED", f"7 {self._number} ROBOT_CONTROLLER")

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
        is_silent = time.monotonic() - self._acked_at > self.ack_interval
        if count % 5 == 0 and is_silent and not sim.docked:
            self._cancel()
        if time.monotonic() > self._plan_at:
            self._next_step()
        if count % 5 == 2 and self.world.journey == "running":
            self._navigator.notify("MOTION_CMD_V", sim.motion.linear)
            self._navigator.notify("MOTION_CMD_W", sim.motion.angular)
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
        self._report_journey(notify)

    def _report_journey(self, notify):
        journey, kind = self.world.journey, self.world.kind
        if journey == self._reported:
            return
        self._reported = journey
        if kind == "goto":
            event = {"done": "NAV_EVENT_END", "failed": "NAV_EVENT_ERROR"}.get(journey)
            if event:
                notify(event, "")
            if journey == "done" and self._plan:
                self._plan.pop(0)
                self._next_step()
        elif journey == "done" and kind == "dock":
            self._set_mode(MANUAL)  # AutoDocking sends CANCEL_NAVIGATION
        elif journey == "done" and kind == "undock":
            self._end_plan()
