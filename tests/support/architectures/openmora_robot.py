"""OpenMORA's MQTTMosquitto module with the simulated robot behind it: its topics, its time-outs,
its habits.

From MQTTMosquitto/CMQTTMosquitto.cpp and RobotControlManager/CRobotControllerApp.cpp: a journey to
a point leaves the robot in autonomous mode when it is over, one to a node ends in manual mode; a
variable that nobody has said yet is 0.00.
"""

import asyncio
import contextlib
import math
import time

from aiomqtt import Client, MqttError

from tests.support.architectures import openmora_rules
from tests.support.architectures.rca_world import RcaRig
from tests.support.patience import patient
from tests.support.programs.mosquitto import Mosquitto

MOTION_TIME = 0.5
ACK_TIME = 2.0
EPOCH_MS = 11_644_473_600_000
PLACES = {"Charger": (0.5, 6.3), "CorridorMiddle": (5.7, 1.0)}


class OpenMoraRig(RcaRig):
    """A Mosquitto and, as its client, the robot."""

    adapter_name = "openmora_mqtt"

    def __init__(self, directory, series="giraff", name="Giraff", host="127.0.0.1"):
        super().__init__(series)
        self.name = name
        self.broker = Mosquitto(directory, host=host)
        self.said = []  # (topic, text) that reached the robot
        self.error = ""
        self._client = None
        self._listening = None

    def options(self):
        return {"broker": self.broker.url, "robot": self.name}

    def __enter__(self):
        self.broker.start()
        return super().__enter__()

    def __exit__(self, *arguments):
        super().__exit__(*arguments)
        self.broker.kill()

    async def up(self):
        self._client = Client(self.broker.host, self.broker.port, keepalive=5)
        await self._client.__aenter__()
        for topic in ("NavigationCommand", "SessionCommand", "ClientACK"):
            await self._client.subscribe(f"{self.name}/{topic}")
        self._motion_at = self._ack_at = None
        self._destination, self._mode = "NULL", "Manual"
        self._listening = asyncio.ensure_future(self._listen())

    async def down(self):
        self._listening.cancel()
        with contextlib.suppress(MqttError, asyncio.CancelledError):
            await self._listening
        with contextlib.suppress(MqttError):
            await self._client.__aexit__(None, None, None)
        self.world.cancel()

    def freeze(self, *, on):
        self.broker.freeze(on=on)

    async def _listen(self):
        async for delivery in self._client.messages:
            stamp, _, text = delivery.payload.decode().partition("|")
            late = time.time() - (int(stamp) - EPOCH_MS) / 1000
            assert abs(late) < patient(5.0)
            topic = str(delivery.topic).split("/")[1]
            if topic != "ClientACK":
                self.said.append((topic, text))
            self._take(topic, text, time.monotonic() - max(0.0, late))

    def _take(self, topic, text, sent):
        self._mind_the_time(sent)
        if topic == "ClientACK":
            count, stamp = text.split("|")[0].split()
            assert int(count) > 0
            assert int(stamp) > EPOCH_MS
            self._ack_at = time.monotonic()
        elif topic == "NavigationCommand":
            word, *rest = text.split()
            getattr(self, f"_on_{word.lower()}")(*rest)
            if word == "Motion":
                self._motion_at = sent

    def _on_motion(self, linear, angular):
        self._mode = "Autonomous"
        self.world.drive(float(linear), float(angular))

    def _on_stopgiraff(self):
        self._cancel()

    def _on_gotopoint(self, x, y):
        self._mode = "Autonomous"
        self.world.go_to(float(x), float(y))

    def _on_gotonode(self, label):
        self._destination, self._mode = label, "Autonomous"
        self.world.go_to(*PLACES[label])

    def _on_gotorecharge(self):
        self._mode = "Autonomous"
        self.world.dock()

    def _on_tilt(self, degrees):
        self.world.tilt(self.world.sim.model.tilt.home + math.radians(float(degrees)))

    def _on_relocalize(self, *words):
        openmora_rules.relocalize(self.world, " ".join(words))

    def _cancel(self):
        self._destination, self._mode = "NULL", "Manual"
        self.world.cancel()
        self.world.drive(0.0, 0.0)

    def _mind_the_time(self, now):
        if self._motion_at is not None and now - self._motion_at > MOTION_TIME:
            self._motion_at = None
            self._cancel()  # as the real one: whatever runs by then
        if self._ack_at is not None and now - self._ack_at > ACK_TIME:
            self._ack_at = None
            self._cancel()

    async def say(self, count):
        self._mind_the_time(time.monotonic())
        if count % 5 == 0:
            await self._publish("Status", self._status())
        if count % 5 == 2:
            await self._publish("LaserScan", self._scan())
        if count % 25 == 0:
            await self._publish("RobotACK", f"1 0|{count} {EPOCH_MS}|0 0")
        if count % 50 == 0:
            await self._publish(
                "Topology",
                "Graph" + "#".join(f"{label} Place {x} {y}" for label, (x, y) in PLACES.items()),
            )
        if self.error:
            await self._publish("ErrorMsg", self.error)
            self.error = ""

    async def _publish(self, topic, text):
        with contextlib.suppress(MqttError):
            await self._client.publish(
                f"{self.name}/{topic}", f"{round(time.time() * 1000) + EPOCH_MS}|{text}"
            )

    def _status(self):
        sim, world, here = self.world.sim, self.world, self.world.believed
        plan_ended = world.journey != "running" and (
            self._destination != "NULL" or world.kind == "dock"
        )
        if plan_ended and self._motion_at is None:
            self._destination, self._mode = "NULL", "Manual"
        place = next(
            (
                label
                for label, (x, y) in PLACES.items()
                if math.hypot(x - sim.pose.x, y - sim.pose.y) < 0.5
            ),
            "NULL",
        )
        pose = f"[{here.x:.4f} {here.y:.4f} {math.degrees(here.theta):.3f}]"
        going = f"{self._destination}|{self._mode}"
        return f"{pose}|{place}|{going}|{sim.voltage():.2f}|{int(sim.docked)}|0|0|0"

    def _scan(self):
        laser = self.world.sim.model.laser
        values = " ".join(f"{value:.2f}" for value in self.world.ranges())
        return f"Aperture {laser.fov:.2f}#Nsamples {laser.beams}#Values {values}"
