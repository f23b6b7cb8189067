"""A real ROS master, and the simulated robot as a node of it."""

import contextlib
import functools
import signal
import socket
import subprocess
import time
from pathlib import Path

from robots.agent.adapters.ros import ros1
from robots.agent.adapters.ros.bus import Subscription
from robots.agent.robot_interface import AdapterError
from tests.support.architectures.frozen import freeze
from tests.support.architectures.rca_world import RcaRig
from tests.support.architectures.ros_robot import BASE, RosRobot
from tests.support.patience import patient
from tests.support.sessions.site import free_port

PYTHON = "/usr/bin/python3"
DOCKING = {"/dock": "dock", "/undock": "undock", "/cancel_dock": "cancel"}


class RobotBus(ros1.Ros1Bus):
    """A node of the robot's own, under a name that stays the same when it is started again."""

    script = Path(__file__).with_name("ros1_robot_node.py")

    def __init__(self, master, name):
        super().__init__(ros1.Ros1Options(master=master.uri, ip=master.host, watchdog=0.6))
        self.arguments = (f"__name:={name}",)

    def offer(self, service, kind, handler):
        self._handlers[service] = handler
        self._say(op="offer", service=service, kind=kind)


class RosMaster:
    def __init__(self, host="127.0.0.1"):
        self.host, self.port = host, free_port()
        self._process = None

    @property
    def uri(self):
        return f"http://{self.host}:{self.port}"

    def start(self):
        environment = {"ROS_IP": self.host, "ROS_LOG_DIR": "/tmp", "PATH": "/usr/bin:/bin"}
        command = [PYTHON, "/usr/bin/rosmaster", "--core", "-p", str(self.port)]
        self._process = subprocess.Popen(
            command, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )
        deadline = time.monotonic() + patient(15.0)
        while not self._answers():
            assert self._process.poll() is None, "rosmaster ended"
            assert time.monotonic() < deadline, "rosmaster does not listen"
            time.sleep(0.05)

    def _answers(self):
        with (
            contextlib.suppress(OSError),
            socket.create_connection((self.host, self.port), timeout=1.0),
        ):
            return True
        return False

    def freeze(self, *, on):
        freeze(self._process.pid, on=on)

    def kill(self):
        if self._process is not None:
            self._process.send_signal(signal.SIGKILL)
            self._process.wait()
            self._process = None


class Ros1Rig(RcaRig):
    adapter_name = "ros1"

    def __init__(self, series="rhodon", base=BASE, host="127.0.0.1"):
        super().__init__(series)
        self.master = RosMaster(host)
        self.robot = RosRobot(self.world, 1, base)
        self.lost = []

    def options(self):
        named = {"dock": "/dock", "undock": "/undock", "cancel_dock": "/cancel_dock"}
        return {"master": self.master.uri, "ip": self.master.host, **named}

    async def up(self):
        self.master.start()
        await self.start_robot()

    def freeze(self, *, on):
        """Freeze the base's node: the master is not on the way of an order."""
        freeze(self._bus._child.pid, on=on)

    async def start_robot(self):
        self._bus = RobotBus(self.master, "base_driver")
        await self._bus.open(self.lost.append, None)
        robot = self.robot
        for topic, kind in robot.TOPICS.items():
            self._bus.advertise(topic, kind, latch=topic == "/amcl_pose")
        for topic in ("/move_base/status", "/move_base/result"):
            self._bus.advertise(topic, robot.MOVE_BASE[topic])
        for topic, kind in (
            robot.hears
            | {name: robot.MOVE_BASE[name] for name in ("/move_base/goal", "/move_base/cancel")}
        ).items():
            hear = functools.partial(robot.hear, topic)
            self._bus.subscribe(Subscription(topic, kind, hear))
        for service, verb in DOCKING.items():
            self._bus.offer(
                service, "std_srvs/Trigger", lambda _, verb=verb: getattr(self.world, verb)()
            )
        robot.restarted()

    async def loses_its_driver(self):
        self._bus._say(op="lose_publishers", topic="/cmd_vel")

    async def restart_robot(self):
        self.running = False
        await self._bus.shut()
        await self.start_robot()
        self.running = True

    async def down(self):
        self.master.kill()
        await self._bus.shut()
        self.world.cancel()

    async def after_reset(self):
        self.robot.restarted()

    async def say(self, count):
        with contextlib.suppress(AdapterError):
            for topic, message in self.robot.says(count) + self.robot.move_base_says(count):
                self._bus.publish(topic, message)
