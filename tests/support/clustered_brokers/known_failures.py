"""The behaviour tests that each broker fails; the table of docs/explanation/brokers.md says why.

Keys are the names of tests in tests/integration/robots/broker/test_behaviour.py.
"""

ELSEWHERE = "a session is known to its own node alone"
BRIDGES = {
    "test_a_reconnecting_robot_replaces_its_old_connection_at_once": ELSEWHERE,
    "test_a_persistent_session_gets_missed_messages_in_order_and_not_as_retained": ELSEWHERE,
    "test_a_persistent_session_gets_an_unacknowledged_message_again": ELSEWHERE,
}
KNOWN_FAILURES: dict[str, dict[str, str]] = {"mosquitto-bridges": BRIDGES}
