"""How old a command and the picture that it answers may be, and how fast a robot still drives by
them. The safety kernel enforces it; a server may predict it.
"""

# s: the hard bounds, which neither a lease nor a robot's own ceiling can pass
COMMAND_AGE_BOUND, FRAME_AGE_BOUND = 1.0, 3.0


def fading(age: float, limit: float) -> float:
    """Return the share of full speed at an age: 1 up to half the limit, then falling linearly to 0
    at the limit.
    """
    return min(1.0, max(0.0, 2.0 * (1.0 - age / limit)))
