"""The hidden operator of a session: script, lease, record."""
