"""What each broker fails of the behaviour tests, measured: the table of
docs/explanation/brokers.md.

Keys are the names of tests in tests/integration/robots/broker/test_behaviour.py. `SOME` are tests
of several inputs of which the broker fails only some.
"""

NATS = {
    "test_a_message_is_delivered_with_the_lesser_quality_of_service": "it has no QoS 2 before 2.10",
    "test_twenty_reconnections_in_a_row_get_in": "it makes a quick second take-over wait a second",
    "test_overlapping_subscriptions_deliver_a_message_once": "it delivers once a subscription",
    "test_a_message_of_one_mebibyte_passes_and_a_larger_one_ends_the_connection": (
        "a message above `max_payload` does not end the connection"
    ),
    "test_a_user_who_breaks_the_protocol_is_hung_up_on_and_the_others_are_not": (
        "it accepts a topic that is not UTF-8, and waits for the rest of a packet that is too large"
    ),
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
SOME = {
    "test_a_message_is_delivered_with_the_lesser_quality_of_service",
    "test_a_user_who_breaks_the_protocol_is_hung_up_on_and_the_others_are_not",
}
