"""The behaviour tests that each broker fails; the table of docs/explanation/brokers.md says why.

Keys are the names of tests in tests/integration/robots/broker/test_behaviour.py.
"""

NATS = {
    "test_of_twenty_reconnections_in_a_row_the_last_one_stays": "the second one waits a second",
    "test_overlapping_subscriptions_deliver_a_message_once": "it delivers once per subscription",
}
ELSEWHERE = "a session is known to its own node alone"
BRIDGES = {
    "test_a_reconnecting_robot_replaces_its_old_connection_at_once": ELSEWHERE,
    "test_of_twenty_reconnections_in_a_row_the_last_one_stays": ELSEWHERE,
    "test_a_persistent_session_gets_missed_messages_in_order_and_not_as_retained": ELSEWHERE,
    "test_a_persistent_session_gets_an_unacknowledged_message_again": ELSEWHERE,
}
KNOWN_FAILURES: dict[str, dict[str, str]] = {
    "nats": NATS,
    "nats-cluster": NATS,
    "mosquitto-bridges": BRIDGES,
}
