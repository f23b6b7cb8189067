"""What each broker fails of the behaviour tests, measured: the table of
docs/explanation/brokers.md.

Keys are the names of tests in tests/integration/robots/broker/test_behaviour.py.
"""

NATS = {
    "test_twenty_reconnections_in_a_row_get_in": "it makes a quick second take-over wait a second",
    "test_overlapping_subscriptions_deliver_a_message_once": "it delivers once a subscription",
}
ELSEWHERE = "a session is known to its own node alone"
BRIDGES = {
    "test_a_reconnecting_robot_gets_in_at_once_while_its_old_connection_lingers": ELSEWHERE,
    "test_twenty_reconnections_in_a_row_get_in": ELSEWHERE,
    "test_a_persistent_session_gets_what_it_missed_in_order_and_not_as_retained": ELSEWHERE,
    "test_what_a_persistent_session_did_not_acknowledge_is_sent_again": ELSEWHERE,
}
KNOWN_FAILURES: dict[str, dict[str, str]] = {
    "nats": NATS,
    "nats-cluster": NATS,
    "mosquitto-bridges": BRIDGES,
}
