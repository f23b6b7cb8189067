"""The web process's connection to the broker, and what it knows of robots; bridge.py joins them."""
