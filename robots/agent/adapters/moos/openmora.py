"""The values of OpenMORA, the robot architecture of the paper's Giraff, as strings and back. Pure.

The same values travel as variables of MOOS and, prefixed by a time, as MQTT payloads of OpenMORA's
MQTTMosquitto module. Angles are in degrees there; the head's are counted from its home, which is
the profile's `tilt.home`.
"""

import math
import re
from dataclasses import dataclass

from robots.agent.adapters.common.robot_profile import RobotProfile
from robots.api.geometry import wrap_angle
from robots.api.messages import Pose, Scan, Velocity

EPOCH = 11_644_473_600.0  # seconds from 1601-01-01 to 1970-01-01: MRPT counts from there
MOST_RANGES = 2000
LONGEST_STAMP = 20  # digits
UNKNOWN = "NULL"
MANUAL = 0.0  # of ROBOT_CONTROL_MODE
ACK_PERIOD = 0.1  # seconds
SETTING_OUT = 5.0  # seconds in which a journey begins


class DialectError(ValueError):
    """A malformed value of the robot."""


@dataclass(frozen=True)
class OpenMoraStatus:
    """The variable `Status`, at 10 Hz; None, or an empty name, for unknown."""

    pose: Pose | None
    place: str
    destination: str
    autonomous: bool
    voltage: float | None
    charging: bool | None


def stamped(text: str, unix: float) -> str:
    """Return a payload with its time in front: milliseconds since 1601."""
    return f"{milliseconds(unix)}|{text}"


def milliseconds(unix: float) -> int:
    """Return a time as MRPT's milliseconds."""
    return round((unix + EPOCH) * 1000.0)


def unstamped(payload: bytes) -> tuple[str, float]:
    """Return a payload without its time, and that in Unix seconds; raises DialectError."""
    stamp, bar, text = payload.decode("utf-8", "replace").partition("|")
    if not bar or not stamp.strip().isdecimal() or len(stamp) > LONGEST_STAMP:
        raise DialectError("payload without a timestamp")
    return text, int(stamp) / 1000.0 - EPOCH


def motion(velocity: Velocity) -> str:
    """Return `v w` in m/s and rad/s."""
    return f"{velocity.linear:.3f} {velocity.angular:.3f}"


def point(x: float, y: float) -> str:
    return f"[{x:.3f} {y:.3f}]"


def area(x: float, y: float, half_width: float, particles: int) -> str:
    """Return `[xmin xmax ymin ymax particles]`, metres: RELOCALIZE_IN_AREA of OpenMORA's particle
    filter.

    The filter silently ignores anything but a matrix of at least five columns
    (Localization2D_PF/CPFLocalizationApp.cpp, ProcessParticleFilter). It uses the middle of the
    box, and spreads its particles around it according to its own X_MIN … Y_MAX.
    """
    return (
        f"[{x - half_width:.3f} {x + half_width:.3f} {y - half_width:.3f} {y + half_width:.3f}"
        f" {particles}]"
    )


def pose_of(text: str) -> Pose | None:
    """Read `[x y phi]`, also without brackets or with `deg`; None if unknown, or DialectError."""
    if text.strip() in {"", UNKNOWN}:
        return None
    parts = text.strip().strip("[]").replace("deg", "").split()
    try:
        x, y, degrees = (float(part) for part in parts[:3])
        theta = wrap_angle(math.radians(degrees))
    except ValueError as error:
        raise DialectError(f"invalid pose: {text[:60]!r}") from error
    if not all(map(math.isfinite, (x, y, degrees))):
        raise DialectError(f"invalid pose: {text[:60]!r}")
    return Pose(x=x, y=y, theta=theta)


def status_of(text: str) -> OpenMoraStatus:
    """Read `x y phi|place|destination|mode|volts|charging`, and ignore additions of newer robots;
    raises DialectError.
    """
    fields = text.split("|")
    if len(fields) < 6:
        raise DialectError(f"status with only {len(fields)} fields")
    pose, place, destination, mode, volts, charging = fields[:6]
    try:
        # 0.00 is a variable without a value yet
        voltage = None if volts in {"", UNKNOWN} else float(volts) or None
    except ValueError as error:
        raise DialectError(f"invalid voltage: {volts[:20]!r}") from error
    place, destination = (
        "" if name.strip() == UNKNOWN else name.strip() for name in (place, destination)
    )
    is_charging = {"1": True, "0": False}.get(charging.strip())
    autonomous = mode == "Autonomous"
    return OpenMoraStatus(pose_of(pose), place, destination, autonomous, voltage, is_charging)


def scan_of(text: str, stamp: float, farthest: float) -> Scan:
    """Read `Aperture a#Nsamples n#Values r r r …` (radians, metres, from right to left), where
    `farthest` is no echo; raises DialectError.
    """
    try:
        aperture, _, values = text.split("#", 2)
        angle = float(aperture.removeprefix("Aperture "))
        ranges = [float(value) for value in values.removeprefix("Values").split()[:MOST_RANGES]]
    except ValueError as error:
        raise DialectError(f"invalid laser scan: {text[:40]!r}") from error
    if len(ranges) < 2 or not 0.0 < angle <= math.tau:
        raise DialectError(f"invalid laser scan: {text[:40]!r}")
    return Scan(
        stamp=stamp,
        angle_min=-angle / 2.0,
        angle_increment=angle / (len(ranges) - 1),
        range_max=farthest,
        ranges=tuple(value if 0.0 < value < farthest else None for value in ranges),
    )


def nodes_of(text: str) -> frozenset[str]:
    """Return the labels of a topology: the words in front of a type and two numbers."""
    words = re.sub(r"[#;,\[\]]", " ", text).split()
    return frozenset(
        label
        for label, _, x, y in zip(words, words[1:], words[2:], words[3:], strict=False)
        if _is_number(x) and _is_number(y) and not _is_number(label)
    )


def head_degrees(angle: float, robot: RobotProfile, sign: float) -> float:
    """Return radians as degrees from the head's home; `sign` is -1 where it counts upwards."""
    return sign * math.degrees(angle - (robot.tilt.home if robot.tilt else 0.0))


def tilt_of(degrees: float, robot: RobotProfile, sign: float) -> float:
    """Return degrees from the head's home as our tilt in radians."""
    return (robot.tilt.home if robot.tilt else 0.0) + sign * math.radians(degrees)


def _is_number(word: str) -> bool:
    try:
        return math.isfinite(float(word))
    except ValueError:
        return False
