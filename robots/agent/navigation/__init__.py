"""How the robot gets somewhere, and how it helps whoever drives. Pure; no clock and no thread of
its own.
"""
