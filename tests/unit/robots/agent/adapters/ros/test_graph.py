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
def test_velocities_are_stamped_as_the_others_have_it(graph, before, now):
    assert chosen_stamped(graph, "/cmd_vel", stamped=before) is now


def test_a_topic_of_another_type_is_named_with_the_option():
    assert (
        no_subscriber(received_as(TWIST_STAMPED), "/cmd_vel", stamped=False)
        == "nobody listens on /cmd_vel for geometry_msgs/Twist: there it is"
        " geometry_msgs/TwistStamped; set stamped=true"
    )
    assert "set cmd_vel to another topic" in no_subscriber(
        received_as("std_msgs/String"), "/cmd_vel", stamped=False
    )


def test_a_topic_where_nobody_is_names_where_somebody_is():
    graph = {
        "/base/cmd_vel": TopicPeers(frozenset({TWIST}), subscribers=1),
        "/log": TopicPeers(frozenset({TWIST}), subscribers=0),
    }
    assert (
        no_subscriber(graph, "/cmd_vel", stamped=False)
        == "nobody listens on /cmd_vel (geometry_msgs/Twist): set cmd_vel to the topic of the"
        " robot's base; here are /base/cmd_vel (geometry_msgs/Twist)"
    )
    assert no_subscriber(None, "/cmd_vel", stamped=False).endswith(
        "set cmd_vel to the topic of the robot's base"
    )


def test_a_topic_that_nobody_publishes_is_named_with_the_option_and_one_that_somebody_does_is_not():
    front = {"/front": TopicPeers(frozenset({SCAN.kind}), publishers=1)}
    assert unpublished(front, [SCAN]) == (
        (
            "nobody publishes /scan (sensor_msgs/LaserScan): set scan to the robot's topic, or to"
            " nothing; here are /front"
        ),
    )
    assert unpublished({"/scan": TopicPeers(frozenset({SCAN.kind}), publishers=1)}, [SCAN]) == ()
    assert unpublished({"/scan": TopicPeers(frozenset({"a/B"}), publishers=1)}, [SCAN]) == (
        "/scan is a/B, not sensor_msgs/LaserScan: set scan to another topic",
    )
    assert unpublished(None, [SCAN]) == ()


def test_nodes_that_a_restarted_master_has_forgotten_are_named_and_many_are_counted():
    assert (
        master_restarted(["/laser", "/base_driver"])
        == "the ROS master was restarted. Nodes that started before it are no longer known to it;"
        " restart them: /base_driver, /laser"
    )
    many = master_restarted([f"/node_{number}" for number in range(9)])
    assert many.endswith("/node_5 and 3 more")
    assert len(many) < 300
