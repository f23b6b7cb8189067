"""How the robot gets somewhere. Pure; no clock and no thread of its own."""
