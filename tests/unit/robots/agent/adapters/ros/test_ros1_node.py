"""The node of ROS 1 in the system's Python: what it says to the agent, and in which order."""

import threading
from types import SimpleNamespace

from robots.agent.adapters.ros.ros1_node import Node

SOON = 0.2  # s in which a thread that was started says something


def test_the_first_word_is_ready_however_long_that_takes():
    said, spoke = [], threading.Event()
    node = object.__new__(Node)

    def say(**message):
        said.append(message["op"])

    def watch():
        say(op="listeners")
        spoke.set()

    def slow_name():
        spoke.wait(SOON)  # a busy computer, on which threads that run already are heard first
        return "/telepresence"

    node.say, node.driven = say, None
    node.rospy = SimpleNamespace(get_name=slow_name)
    node.connection = SimpleNamespace(makefile=lambda *_, **__: [])
    node.watch_wheels, node.watch_master, node.answer_questions = watch, lambda: None, lambda: None
    node.run()
    assert spoke.wait(SOON * 10)
    assert said == ["ready", "listeners"]
