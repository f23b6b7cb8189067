"""What a session manager subscribes to."""

from robots.api import topics
from sessions.manager.broker_connection import MAX_FILTERS, packets_of
from sessions.manager.ingest import filters


def test_a_share_receives_frequent_messages_of_its_robots_and_rare_ones_of_all():
    subscribed = {topic for topic, _ in filters(["giraff"])}
    assert topics.of("giraff", "state") in subscribed
    assert topics.of("+", "state") not in subscribed
    assert topics.of("+", "event") in subscribed
    assert topics.of("giraff", "pose") not in subscribed


def test_one_session_manager_needs_as_many_filters_as_one_robot():
    assert len(filters()) == len(filters(["giraff"])) == 9


def test_in_a_cluster_only_rare_messages_need_a_queue_and_as_many_as_for_one_robot():
    robots = [f"robot-{number}" for number in range(100)]
    with_queue = {topic for topic, qos in filters(robots, frequent_qos=0) if qos}
    assert with_queue == {topic for topic, qos in filters(["giraff"], frequent_qos=0) if qos}
    assert topics.of("+", "event") in with_queue
    assert topics.of("+", "state") not in with_queue
    assert (topics.of("robot-1", "state"), 0) in filters(robots, frequent_qos=0)


def test_states_have_flow_control_on_a_broker_of_one_node():
    assert (topics.of("+", "state"), 1) in filters()


def test_no_packet_has_more_filters_than_its_limit():
    wanted = filters(f"robot-{number}" for number in range(100))
    packets = list(packets_of(wanted))
    assert max(map(len, packets)) <= MAX_FILTERS
    assert sorted(pair for packet in packets for pair in packet) == sorted(wanted)
    assert list(packets_of(set())) == []
