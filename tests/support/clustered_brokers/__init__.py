"""Other MQTT brokers than ours as real processes, of one node or three, with users of a test."""
