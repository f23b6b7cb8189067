"""A head that tilts towards its target at the speed of its motor."""

from robots.api.messages import TiltRange


def step(angle: float, target: float, tilt: TiltRange, dt: float) -> float:
    """Return the angle in radians, positive looks down, after `dt` seconds."""
    wanted = min(max(target, tilt.minimum), tilt.maximum)
    return angle + min(max(wanted - angle, -tilt.speed * dt), tilt.speed * dt)
