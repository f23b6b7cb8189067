"""What a web process knows of its robots, and how it reaches the broker; robots/bridge/bridge.py
puts it together.
"""
