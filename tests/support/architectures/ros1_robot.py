"""A real ROS master, and the simulated robot as a node of it."""

import contextlib
import functools
import subprocess
from pathlib import Path

from robots.agent.adapters.ros import ros1
from robots.agent.adapters.ros.bus import Subscription
from robots.agent.robot_interface import AdapterError
from tests.support.architectures.frozen import ServerProcess, freeze
from tests.support.architectures.rca_world import RcaRig
from tests.support.architectures.ros_robot import BASE, DOCKING, RosRobot

PYTHON = "/usr/bin/python3"


class RobotBus(ros1.Ros1Bus):
    """A node of the robot, whose name stays the same when it is started again."""

    script = Path(__file__).with_name("ros1_robot_node.py")

    def __init__(self, master, name):
        super().__init__(ros1.Ros1Options(master=master.uri, ip=master.host, watchdog=0.6))
        self.arguments = (f"__name:={name}",)

    def offer(self, service, kind, handler):
        self._handlers[service] = handler
        self._say(op="offer", service=service, kind=kind)


class RosMaster(ServerProcess):
    stderr = subprocess.DEVNULL

    def __init__(self, host="127.0.0.1"):
        super().__init__("rosmaster", host)
        self.environment = {"ROS_IP": host, "ROS_LOG_DIR": "/tmp", "PATH": "/usr/bin:/bin"}

    def command(self):
        return [PYTHON, "/usr/bin/rosmaster", "--core", "-p", str(self.port)]

    @property
    def uri(self):
        return f"http://{self.host}:{self.port}"


class Ros1Rig(RcaRig):
    adapter_name = "ros1"

    def __init__(self, series="rhodon", base=BASE, host="127.0.0.1"):
        super().__init__(series)
        self.master = RosMaster(host)
        self.robot = RosRobot(self.world, 1, base)
        self.lost = []

    def options(self):
        return {"master": self.master.uri, "ip": self.master.host, **self.robot.options}

    async def up(self):
        self.master.start()
        await self.start_robot()

    def freeze(self, *, on):
        """Freeze the base's node: velocities do not pass through the master."""
        freeze(self._bus._child.pid, on=on)

    async def start_robot(self):
        self._bus = RobotBus(self.master, "base_driver")
        await self._bus.open(self.lost.append, None)
        robot = self.robot
        for topic, kind in (robot.TOPICS | robot.MOVE_BASE_SAYS).items():
            self._bus.advertise(topic, kind, latch=topic == "/amcl_pose")
        for topic, kind in (robot.hears | robot.MOVE_BASE_HEARS).items():
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
            for topic, message in self.robot.due(count) + self.robot.move_base_due(count):
                self._bus.publish(topic, message)
