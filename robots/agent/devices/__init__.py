"""Cameras, microphones and loudspeakers of the robot's own computer, whatever its control
architecture is.
"""
