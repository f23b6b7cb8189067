"""A simulated robot: physics and rendering (pure), and the process that runs them (server.py)."""
