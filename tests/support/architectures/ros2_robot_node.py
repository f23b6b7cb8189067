"""The simulated robot's node of ROS 2 in a process of its own: lines of JSON on standard input are
said on DDS, and the other way round.
"""

import asyncio
import json
import sys
import threading

from cyclonedds.sub import DataReader

from robots.agent.adapters.ros.ros2 import DdsBus, quality
from tests.support.architectures.ros_robot import RosRobot

GOALS = {"/navigate_to_pose/_action/status": "action_msgs/GoalStatusArray"}
LATCHED = {"/amcl_pose", *GOALS}


def say(topic, message):
    sys.stdout.write(json.dumps([topic, message]) + "\n")
    sys.stdout.flush()


def hear(bus, topic, kind, *, best_effort):
    """Subscribe as rclcpp's SystemDefaultsQoS does, with which diff_drive_controller hears cmd_vel:
    reliable; or as a sensor is heard.
    """
    reader = DataReader(bus._participant, bus._topic(topic, kind), qos=quality(sensor=best_effort))
    bus._readers.append((reader, lambda message: say(topic, message)))


class NamespacedBus(DdsBus):
    """The topics of a robot of ROS 2 whose nodes were started in a namespace, such as /robot1."""

    def __init__(self, domain, namespace):
        super().__init__(domain)
        self._namespace = namespace

    def _topic(self, name, kind):
        return super()._topic(self._namespace + name, kind)


async def main(domain, cmd_vel, velocity, best_effort="", namespace=""):
    bus = NamespacedBus(domain, namespace)
    await bus.open(sys.exit, None)
    for topic, kind in (RosRobot.TOPICS | GOALS).items():
        bus.advertise(topic, kind, latched=topic in LATCHED, sensor=topic == "/scan")
    heard = RosRobot.COMMANDS | {"/goal_pose": "geometry_msgs/PoseStamped", cmd_vel: velocity}
    for topic, kind in heard.items():
        hear(bus, topic, kind, best_effort=best_effort == "best-effort")
    loop, ended = asyncio.get_running_loop(), asyncio.Event()

    def read():
        for line in sys.stdin:
            topic, message = json.loads(line)
            loop.call_soon_threadsafe(bus.publish, topic, message)
        loop.call_soon_threadsafe(ended.set)

    threading.Thread(target=read, daemon=True).start()
    say("ready", {})
    await ended.wait()
    await bus.shut()


if __name__ == "__main__":
    asyncio.run(main(int(sys.argv[1]), *sys.argv[2:]))
