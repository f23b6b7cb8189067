"""OpenMORA with the simulated robot behind it, as one client of a MOOSDB: a double, or a real one by its address."""

import asyncio
import contextlib
import math
import time

from robots.agent.adapters.contract import AdapterError
from robots.agent.adapters.moos_client import MoosClient
from tests.support.frozen import ServerProcess
from tests.support.rca_world import RcaRig

HEARD = (
    "MOTION_REQUEST", "NAVIGATE_TARGET", "GO_TO_NODE", "GO_TO_RECHARGE", "PARKING", "CANCEL_NAVIGATION", "NEW_TASK", "TILT_SET_ANGLE_FROM_HOME",
    "RELOCALIZE_IN_AREA",
)  # fmt: skip


class MoosRig(RcaRig):
    """`address` is a real MOOSDB's host:port."""

    adapter_name = "moos"

    def __init__(self, series="giraff", address="", listening="127.0.0.1"):
        super().__init__(series)
        self.db = None if address else ServerProcess("tests.support.moosdb", listening)
        self._address = address
        self._client = None
        self._began = 0.0
        self._told = ""
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

    def freeze(self, *, on):
        self.db.freeze(on=on)

    def _take(self, mail):
        if mail.time < self._began:
            return  # what was said to a robot before this one
        world, value = self.world, mail.value
        match mail.key:
            case "MOTION_REQUEST":
                world.drive(*map(float, value.split()))
            case "NAVIGATE_TARGET":
                world.go_to(*map(float, value.strip("[]").split()))
            case "GO_TO_RECHARGE":
                world.dock()
            case "NEW_TASK":
                assert value == "ROBOT_CONTROLLER 1 UNDOCK"
                world.undock()
            case "CANCEL_NAVIGATION":
                world.cancel()
            case "TILT_SET_ANGLE_FROM_HOME":
                world.tilt(world.sim.model.tilt.home + math.radians(value))

    async def say(self, count):
        with contextlib.suppress(AdapterError):
            self._say(count)

    def _say(self, count):
        sim, notify = self.world.sim, self._client.notify
        if count % 3 == 0:
            suffix = "deg" if count % 2 else ""
            notify("LOCALIZATION", f"[{sim.pose.x:.4f} {sim.pose.y:.4f} {math.degrees(sim.pose.theta):.3f}{suffix}]")
        if count % 10 == 0:
            notify("BATTERY_V_FLOAT", sim.voltage())
            notify("BATTERY_IS_CHARGING", float(sim.docked))
        if count % 5 == 0 and sim.model.tilt:
            notify("TILT_CURRENT_ANGLE_FROM_HOME", math.degrees(sim.tilt - sim.model.tilt.home))
        if count % 5 == 1:
            notify("BUMPERS", self.bumped)
        if self.world.kind == "goto":
            self._tell_of_journey(notify)

    def _tell_of_journey(self, notify):
        journey = self.world.journey
        if journey != self._told:
            self._told = journey
            event = {"running": "NAV_EVENT_START", "done": "NAV_EVENT_END", "failed": "NAV_EVENT_ERROR"}.get(journey)
            if event:
                notify(event, "1")
