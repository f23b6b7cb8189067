"""The simulated robot's node of ROS 2, real rclpy in a process of its own.

Lines of JSON on standard input are published; what it receives is written to standard output.

Its NavigateToPose server drives the simulated robot; the line "planner" sets attributes of it:
with `accept` false it rejects goals. It asks the rig how long to wait before it accepts a goal, and
whether to obey a cancel.
"""

import json
import os
import pathlib
import queue
import sys
import threading
import time

import rclpy
from nav2_msgs.action import NavigateToPose
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.executors import MultiThreadedExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from std_srvs.srv import Trigger

ROOT = pathlib.Path(__file__).resolve().parents[3]
sys.path.insert(0, str(ROOT / "robots" / "agent" / "adapters" / "ros"))

import guarded_node
import ros2_node

LATCHED = ("/amcl_pose", "/estop_latched")
# Fast DDS logs to standard output, which becomes standard error, so that its lines are not ours.
OUTPUT = os.fdopen(os.dup(sys.stdout.fileno()), "w")
os.dup2(sys.stderr.fileno(), sys.stdout.fileno())


def say(topic, message):
    OUTPUT.write(json.dumps([topic, message]) + "\n")
    OUTPUT.flush()


def quality(*, latched=False, best_effort=False):
    return QoSProfile(
        depth=1 if latched else 10,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
        reliability=ReliabilityPolicy.BEST_EFFORT if best_effort else ReliabilityPolicy.RELIABLE,
    )


class Planner:
    """A NavigateToPose server whose journeys the rig carries out."""

    def __init__(self, node, name):
        self.accept = True
        self.answers = queue.Queue()  # of the rig
        self.lock = threading.RLock()
        self.journey, self.is_cancelled, self.has_ended = "", False, False
        self.server = ActionServer(
            node,
            NavigateToPose,
            name,
            self.execute,
            goal_callback=self.asked,
            cancel_callback=self.asked_to_cancel,
            callback_group=ReentrantCallbackGroup(),
        )

    def ask(self, question):
        with self.lock:
            say(question, {})
            return self.answers.get(timeout=5.0)

    def asked(self, _goal):
        self.has_ended = self.is_cancelled = False
        until = time.monotonic() + self.ask("asked")
        while time.monotonic() < until:
            time.sleep(0.01)
            if self.has_ended:  # the next test has begun
                return GoalResponse.REJECT
        return GoalResponse.ACCEPT if self.accept else GoalResponse.REJECT

    def asked_to_cancel(self, _goal):
        with self.lock:
            self.is_cancelled = self.ask("cancel")
        return CancelResponse.ACCEPT if self.is_cancelled else CancelResponse.REJECT

    def execute(self, goal):
        self.journey = "running"
        with self.lock:
            if not self.is_cancelled:  # it has been accepted late, and cancelled at once
                say("goal", guarded_node.plain(goal.request.pose))
        while self.journey == "running":
            if goal.is_cancel_requested:
                goal.canceled()
                return NavigateToPose.Result()
            time.sleep(0.01)
        if self.journey == "done":
            goal.succeed()
            return NavigateToPose.Result()
        goal.abort()
        return NavigateToPose.Result(error_code=104, error_msg="no path was found")


class Robot:
    def __init__(self, wish):
        self.node = Node("base_driver")
        self.namespace = wish.get("namespace", "")
        self.publishers = {}
        for topic, kind in wish["publishes"].items():
            best_effort = topic in wish.get("best_effort", ["/scan"])
            form = quality(latched=topic in LATCHED, best_effort=best_effort)
            made = ros2_node.type_of(kind, "msg")
            name = self.namespace + topic
            self.publishers[topic] = (self.node.create_publisher(made, name, form), made)
        for topic, kind in wish["hears"].items():
            self.hear(topic, kind, **wish.get("listens", {}))
        for service in wish.get("services", ()):
            answer = self.serve(service, wish.get("late", {}).get(service, 0.0))
            name, group = self.namespace + service, ReentrantCallbackGroup()
            self.node.create_service(Trigger, name, answer, callback_group=group)
        self.planner = Planner(self.node, self.namespace + "/navigate_to_pose")

    def hear(self, topic, kind, *, latched=False, best_effort=False):
        self.node.create_subscription(
            ros2_node.type_of(kind, "msg"),
            self.namespace + topic,
            lambda message: say(topic, guarded_node.plain(message)),
            quality(latched=latched, best_effort=best_effort),
        )

    def serve(self, service, late):
        def answer(_request, response):
            time.sleep(late)
            say(service, {})
            response.success = True
            return response

        return answer

    def obey(self, topic, message):
        if topic == "journey":
            self.planner.journey = message
        elif topic == "planner":
            vars(self.planner).update(message)
        elif topic == "answer":
            self.planner.answers.put(message)
        else:
            publisher, made = self.publishers[topic]
            publisher.publish(ros2_node.filled(made(), message))


def main():
    rclpy.init(args=["--ros-args", "--disable-external-lib-logs"])
    robot = Robot(json.loads(sys.argv[1]))
    executor = MultiThreadedExecutor(4)
    executor.add_node(robot.node)
    say("ready", {})  # before anything that it hears
    threading.Thread(target=executor.spin, daemon=True).start()
    for line in sys.stdin:
        robot.obey(*json.loads(line))
    os._exit(0)


if __name__ == "__main__":
    main()
