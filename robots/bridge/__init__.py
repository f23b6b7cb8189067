"""What a web process knows of its robots, and how it reaches the broker; robots/mqtt_bridge.py puts it together."""
