"""The web process's connection to the broker, and its copy of the robots' last messages."""
