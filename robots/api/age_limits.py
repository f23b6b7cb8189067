"""The maximum ages of a command and of the picture that the driver saw, and the speed at an age.
The safety kernel enforces them; a server may predict them.
"""

# s: bounds of every lease and robot
COMMAND_AGE_BOUND, FRAME_AGE_BOUND = 1.0, 3.0


def fading(age: float, limit: float) -> float:
    """Return the share of full speed at an age: 1 up to half the limit, then falling linearly to 0
    at the limit.
    """
    return min(1.0, max(0.0, 2.0 * (1.0 - age / limit)))
