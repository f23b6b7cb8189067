"""Topics whose message package is not installed where the node runs, in ROS 1 and 2."""

import sys
from types import SimpleNamespace

import pytest

from robots.agent.adapters import registry
from robots.agent.adapters.ros import ros1_node, ros2_node
from robots.agent.adapters.ros.node_bus import NodeBus

PACKAGE = f"the ROS package absent_msgs is not installed for {sys.executable}"


@pytest.fixture(params=["ROS 1", "ROS 2"])
def node(request):
    """A node without ROS, which lacks all types; `sent` has its messages to the agent."""
    made = object.__new__(ros1_node.Node if request.param == "ROS 1" else ros2_node.Ros2Node)
    made.sent, made.problems, made.subscriptions = [], {}, {}
    made.say = lambda **message: made.sent.append(message)
    made.roslib = SimpleNamespace(message=SimpleNamespace(get_message_class=lambda kind: None))
    return made


def subscribe(node, topic, *, essential):
    node.obey(
        {"op": "subscribe", "topic": topic, "kind": "absent_msgs/Bool", "essential": essential}
        | {"period": 0.0, "latched": False}
    )


def test_topic_that_is_not_essential_is_reported_and_the_connection_stays(node):
    subscribe(node, "/bumper", essential=False)
    (message,) = node.sent
    assert message["op"] == "problems"
    (sentence,) = message["sentences"]
    assert sentence.startswith("/bumper is not received, because absent_msgs/Bool")
    assert PACKAGE in sentence


def test_essential_topic_ends_the_connection_and_names_the_package_to_install(node, monkeypatch):
    monkeypatch.setenv("ROS_DISTRO", "jazzy")
    subscribe(node, "/odom", essential=True)
    (message,) = node.sent
    assert message["op"] == "lost"
    assert message["reason"].startswith("/odom is not received, because absent_msgs/Bool")
    assert PACKAGE in message["reason"]
    assert message["reason"].endswith("; install ros-jazzy-absent-msgs")


def test_driving_needs_what_shows_motion_place_and_emergency_stop():
    optional = {"bumper": "bumper", "image": "image", "tilt_joint": "head"}
    options = optional | {"estop": "button", "navigation_velocity": "planned"}
    adapter = registry.create("ros1", "rhodon", options)
    found = {each.topic: each.essential for each in adapter._subscriptions()}
    assert {topic for topic, essential in found.items() if essential} == {
        *("/odom", "/amcl_pose", "/button", "/planned", "/move_base/status", "/move_base/result")
    }
    assert {topic for topic, essential in found.items() if not essential} == {
        *("/scan", "/battery_state", "/joint_states", "/bumper", "/image")
    }


@pytest.mark.parametrize("version", [1, 2])
def test_bus_has_the_problems_that_its_node_reports(version):
    bus = registry.create(f"ros{version}", "rhodon", {"navigation": "none"})._bus
    assert isinstance(bus, NodeBus)
    bus._take({"op": "problems", "sentences": ["/bumper is not received"]})
    assert bus.problems == ("/bumper is not received",)
