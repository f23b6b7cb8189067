"""The simulated robot's node of ROS 2 in a process of its own: lines of JSON on standard input are said on DDS, and the other way round."""

import asyncio
import json
import sys
import threading

from robots.agent.adapters.ros2 import DdsBus
from tests.support.ros_robot import RosRobot

GOALS = {"/navigate_to_pose/_action/status": "action_msgs/GoalStatusArray"}
LATCHED = {"/amcl_pose", *GOALS}


def say(topic, message):
    sys.stdout.write(json.dumps([topic, message]) + "\n")
    sys.stdout.flush()


async def main(domain):
    bus = DdsBus(domain)
    await bus.open(sys.exit, None)
    for topic, kind in (RosRobot.TOPICS | GOALS).items():
        bus.advertise(topic, kind, latched=topic in LATCHED, sensor=topic == "/scan")
    for topic, kind in (RosRobot.HEARS | {"/goal_pose": "geometry_msgs/PoseStamped"}).items():
        bus.subscribe(topic, kind, lambda message, topic=topic: say(topic, message))
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
    asyncio.run(main(int(sys.argv[1])))
