"""OpenMORA's MQTTMosquitto module with the simulated robot behind it: topics, time-outs and quirks.

From MQTTMosquitto/CMQTTMosquitto.cpp: it works only when a message arrives, or after a second
without one (`loop(-1)` in Iterate), and a variable that was never published is 0.00. From
RobotControlManager/CRobotControllerApp.cpp: after a journey to a point the robot stays in
autonomous mode, after one to a node it is in manual mode, and without an acknowledgement of the
client for `max_client_ack_interval` all motion ends. From Executor/TExecutor.cpp: a plan that
starts ignores an earlier cancel.
"""

import asyncio
import contextlib
import math
import time

from aiomqtt import Client, MqttError

from robots.process.cancellation import cancel
from tests.support.architectures import openmora_rules
from tests.support.architectures.rca_world import RcaRig
from tests.support.patience import patient
from tests.support.programs.mosquitto import Mosquitto

MOTION_TIME = 0.5
ACK_TIME = 2.0  # max_client_ack_interval, as shipped
LOOP_TIME = 1.0  # libmosquitto's default, which -1 selects
PLANNING = 0.2  # s from a task to its plan
PERIODS = {"Status": 0.1, "LaserScan": 0.1, "RobotACK": 0.5, "Topology": 1.0}
EPOCH_MS = 11_644_473_600_000
PLACES = {"Charger": (0.5, 6.3), "CorridorMiddle": (5.7, 1.0)}


class OpenMoraRig(RcaRig):
    """A Mosquitto and, as its client, the robot."""

    adapter_name = "openmora_mqtt"

    def __init__(self, directory, series="giraff", name="Giraff", host="127.0.0.1"):
        super().__init__(series)
        self.name = name
        self.broker = Mosquitto(directory, host=host)
        self.received = []  # (topic, text)
        self.ack_interval = patient(ACK_TIME)
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
        for topic in ("NavigationCommand", "SessionCommand", "ClientACK", "Debug"):
            await self._client.subscribe(f"{self.name}/{topic}")
        self._motion_at = self._ack_at = None
        self._client_ack, self._published = "0 0", dict.fromkeys(PERIODS, 0.0)
        self._iterated_at, self._robot_acks = 0.0, 0
        self._destination, self._mode, self._plan = "NULL", "Manual", None
        self._listening = asyncio.ensure_future(self._listen())

    async def down(self):
        with contextlib.suppress(MqttError):
            await cancel(self._listening)  # `publish` loses a cancellation before Python 3.12
        with contextlib.suppress(MqttError):
            await self._client.__aexit__(None, None, None)
        self.world.cancel()

    def freeze(self, *, on):
        self.broker.freeze(on=on)

    def hang(self, *, on):
        """Let all modules of the robot hang behind a broker that runs on, or resume them."""
        self.running, self.world.hung = not on, on
        self.loop.call_soon_threadsafe(self._hang, on)

    def _hang(self, on):
        paho = self._client._client
        socket = paho.socket().fileno()
        if on:
            self.loop.remove_reader(socket)
        else:
            self.loop.add_reader(socket, paho.loop_read)

    def resume(self, goal):
        """Let OpenMORA start a journey."""
        self.loop.call_soon_threadsafe(self._on_gotopoint, goal.x, goal.y)

    async def after_reset(self):
        self._destination, self._mode, self._plan = "NULL", "Manual", None

    async def _listen(self):
        async for delivery in self._client.messages:
            stamp, _, text = delivery.payload.decode().partition("|")
            late = time.time() - (int(stamp) - EPOCH_MS) / 1000
            assert abs(late) < patient(5.0) or text == "StopGiraff"  # a will is stamped long before
            topic = str(delivery.topic).split("/")[1]
            if topic != "ClientACK":
                self.received.append((topic, text))
            self._take(topic, text, time.monotonic() - max(0.0, late))
            await self._iterate()

    def _take(self, topic, text, sent):
        if topic == "ClientACK":
            self._client_ack = text.split("|")[0]
            count, stamp = self._client_ack.split()
            assert int(count) > 0
            assert int(stamp) > EPOCH_MS
            self._ack_at = time.monotonic()
        elif topic == "NavigationCommand":
            word, *rest = text.split()
            getattr(self, f"_on_{word.lower()}")(*rest)
            if word == "Motion":
                self._motion_at = sent
        elif topic == "Debug":
            assert text == "PNAVIGATORREACTIVEPTG_CMD CANCEL"

    def _on_motion(self, linear, angular):
        self._mode = "Autonomous"
        self.world.pause()
        self.world.drive(float(linear), float(angular))

    def _on_stopgiraff(self):
        self._cancel()

    def _on_gotopoint(self, x, y):
        self._mode = "Autonomous"
        self.world.go_to(float(x), float(y))

    def _on_gotonode(self, label):
        self._mode = "Autonomous"
        self._plan = label, time.monotonic() + PLANNING + self.world.accept_after

    def _on_gotorecharge(self):
        self._plan = "Docking", time.monotonic() + PLANNING + self.world.accept_after

    def _start_plan(self):
        label, _ = self._plan
        self._plan, self._mode = None, "Autonomous"
        if label == "Docking":
            self.world.dock()
        else:
            self._destination = label
            self.world.go_to(*PLACES[label])

    def _on_tilt(self, degrees):
        self.world.tilt(self.world.sim.model.tilt.home + math.radians(float(degrees)))

    def _on_relocalize(self, *words):
        openmora_rules.relocalize(self.world, " ".join(words))

    def _cancel(self):
        if self.world.cancel():
            self.world.journey = ""
            self._destination, self._mode = "NULL", "Manual"
            self.world.drive(0.0, 0.0)

    async def say(self, count):
        """Run the other modules, and this one if a second has passed."""
        now = time.monotonic()
        if self._plan is not None and now > self._plan[1]:
            self._start_plan()
        if count % 5 == 0 and self._ack_at is not None and now - self._ack_at > self.ack_interval:
            self._cancel()
        if now - self._iterated_at > LOOP_TIME:
            await self._iterate()

    async def _iterate(self):
        now = self._iterated_at = time.monotonic()
        if self._motion_at is not None and now - self._motion_at > MOTION_TIME:
            self._motion_at = None
            self._cancel()  # as the real one, which also ends a journey that runs by then
        for topic, period in PERIODS.items():
            if now - self._published[topic] > period:
                self._published[topic] = now
                await self._publish(topic, getattr(self, f"_{topic.lower()}")())
        if self.error:
            await self._publish("ErrorMsg", self.error)
            self.error = ""

    async def _publish(self, topic, text):
        with contextlib.suppress(MqttError):
            await self._client.publish(
                f"{self.name}/{topic}", f"{round(time.time() * 1000) + EPOCH_MS}|{text}"
            )

    def _robotack(self):
        self._robot_acks += 1
        return f"{self._client_ack}|{self._robot_acks} {round(time.time() * 1000) + EPOCH_MS}|0 0"

    def _topology(self):
        return "Graph" + "#".join(f"{label} Place {x} {y}" for label, (x, y) in PLACES.items())

    def _status(self):
        sim, world, here = self.world.sim, self.world, self.world.believed
        plan_ended = world.journey != "running" and (
            self._destination != "NULL" or world.kind == "dock"
        )
        if plan_ended and self._motion_at is None and self._plan is None:
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

    def _laserscan(self):
        laser = self.world.sim.model.laser
        values = " ".join(f"{value:.2f}" for value in self.world.ranges())
        return f"Aperture {laser.fov:.2f}#Nsamples {laser.beams}#Values {values}"
