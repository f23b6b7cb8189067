"""Sentences about topics without a subscriber or a publisher."""

import pytest

from robots.agent.adapters.ros.graph import (
    TWIST,
    TWIST_STAMPED,
    TopicNeed,
    TopicPeers,
    chosen_stamped,
    master_restarted,
    no_subscriber,
    unpublished,
)

SCAN = TopicNeed("/scan", "sensor_msgs/LaserScan", "scan")


def received_as(*kinds):
    return {"/cmd_vel": TopicPeers(frozenset(kinds), subscribers=1)}


@pytest.mark.parametrize(
    ("graph", "before", "now"),
    [
        (received_as(TWIST), True, False),
        (received_as(TWIST_STAMPED), False, True),
        (received_as(TWIST, TWIST_STAMPED), True, True),
        (received_as("std_msgs/String"), False, False),
        ({}, True, True),
        (None, False, False),
    ],
)
def test_velocities_have_the_type_of_the_subscribers(graph, before, now):
    assert chosen_stamped(graph, "/cmd_vel", stamped=before) is now


def unsubscribed(graph):
    return no_subscriber(graph, "/cmd_vel", stamped=False)


def test_a_topic_of_another_type_is_named_with_the_option():
    assert unsubscribed(received_as(TWIST_STAMPED)) == (
        "nobody listens on /cmd_vel for geometry_msgs/Twist: there it is"
        " geometry_msgs/TwistStamped; set stamped=true"
    )
    assert "set cmd_vel to another topic" in unsubscribed(received_as("std_msgs/String"))


def test_a_topic_without_a_subscriber_is_named_with_topics_that_have_one():
    graph = {
        "/base/cmd_vel": TopicPeers(frozenset({TWIST}), subscribers=1),
        "/log": TopicPeers(frozenset({TWIST}), subscribers=0),
    }
    assert unsubscribed(graph) == (
        "nobody listens on /cmd_vel (geometry_msgs/Twist): set cmd_vel to the topic of the"
        " robot's base; here are /base/cmd_vel (geometry_msgs/Twist)"
    )
    assert unsubscribed(None).endswith("set cmd_vel to the topic of the robot's base")


def test_an_unpublished_topic_is_named_with_its_option():
    front = {"/front": TopicPeers(frozenset({SCAN.kind}), publishers=1)}
    (sentence,) = unpublished(front, [SCAN])
    assert sentence == (
        "nobody publishes /scan (sensor_msgs/LaserScan): set scan to the robot's topic, or to"
        " nothing; here are /front"
    )
    assert unpublished({"/scan": TopicPeers(frozenset({SCAN.kind}), publishers=1)}, [SCAN]) == ()
    (sentence,) = unpublished({"/scan": TopicPeers(frozenset({"a/B"}), publishers=1)}, [SCAN])
    assert sentence == "/scan is a/B, not sensor_msgs/LaserScan: set scan to another topic"
    assert unpublished(None, [SCAN]) == ()


def test_nodes_that_a_restarted_master_has_forgotten_are_named():
    assert master_restarted(["/laser", "/base_driver"]) == (
        "the ROS master was restarted. Nodes that started before it are no longer known to it;"
        " restart them: /base_driver, /laser"
    )
    many = master_restarted([f"/node_{number}" for number in range(9)])
    assert many.endswith("/node_5 and 3 more")
    assert len(many) < 300
