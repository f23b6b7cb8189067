"""Checks what an adapter returns: Python's own finite numbers within the ranges of the Robot API,
with angles wrapped and texts cut to size.
"""

import math
from collections.abc import Iterable
from dataclasses import replace
from typing import TypeVar

import msgspec
import numpy as np

from robots.agent.robot_interface import ActionProgress, AdapterError, ObstaclePoints, RcaState
from robots.api.geometry import wrap_angle
from robots.api.messages import ActionStatus, Battery, Message, PoseUpdate, Scan, Velocity

Checked = TypeVar("Checked", bound=Message)
NUMBERS: frozenset[type] = frozenset({float, int, type(None)})
ERRORS = 12
ERROR_LENGTH = 300
FARTHEST = 1e5  # metres, as in robots.api.messages
PLANE = 2  # coordinates


class UnsoundReadingError(ValueError):
    """A reading that no robot can have; one sentence for its owner."""


def sound_velocity(sent: object) -> Velocity:
    """Return a velocity of an adapter, or raise AdapterError when it is none."""
    try:
        if isinstance(sent, Velocity):
            return _in_range(sent)
    except (TypeError, msgspec.ValidationError) as error:
        raise AdapterError(f"the adapter returns {sent!r} as a velocity: {error}") from error
    raise AdapterError(f"the adapter returns {sent!r}, which is not a velocity")


def sound_progress(progress: ActionProgress) -> ActionProgress:
    """Return the progress with its reason cut to size, or raise AdapterError when it cannot be
    published.
    """
    try:
        cut = replace(progress, reason=progress.reason[:ERROR_LENGTH])
        _in_range(ActionStatus(**vars(cut), stamp=0.0))
    except (TypeError, ValueError, AttributeError) as error:
        raise AdapterError(f"it reports the progress of an action wrongly: {error}") from error
    if not all(math.isfinite(each) for each in cut.result.values() if isinstance(each, float)):
        raise AdapterError("it reports an action with a result that is NaN or infinite")
    return cut


def _in_range(message: Checked) -> Checked:
    """Return the message when each value has the type and range of the Robot API. Raises TypeError
    for a number of NumPy's, msgspec.ValidationError for anything else.
    """
    return msgspec.convert(msgspec.to_builtins(message), type(message))


def sound(reading: RcaState) -> RcaState:
    """Return the reading with angles wrapped and texts cut to size. Raises UnsoundReadingError."""
    try:
        return _sound(reading)
    except (TypeError, ValueError, AttributeError, OverflowError) as error:
        if isinstance(error, TypeError) and "numpy" in str(error):
            raise UnsoundReadingError(
                f"{error}: give it Python's own numbers, by float() or tolist()"
            ) from error
        if isinstance(error, UnsoundReadingError):
            raise
        raise UnsoundReadingError(f"{type(error).__name__}: {error}") from error


def _sound(reading: RcaState) -> RcaState:
    if not math.isfinite(reading.pose.theta):
        raise UnsoundReadingError("the heading is not a number")
    pose = msgspec.structs.replace(reading.pose, theta=wrap_angle(reading.pose.theta))
    update = PoseUpdate(
        stamp=reading.stamp,
        pose=pose,
        velocity=reading.velocity,
        tilt=reading.tilt,
        assist_why=reading.assist_why,
        assist_point=reading.assist_point,
    )
    try:
        _in_range(update)
        battery = _battery(reading.battery)
    except msgspec.ValidationError as error:
        raise UnsoundReadingError(str(error)) from error
    _check_encodable(reading)
    if problem := _problem_of(reading):
        raise UnsoundReadingError(problem)
    sonar = tuple(
        echo for echo in reading.sonar if echo.distance is None or 0.0 <= echo.distance < math.inf
    )
    return replace(
        reading,
        pose=pose,
        battery=battery,
        errors=tuple(text[:ERROR_LENGTH] for text in reading.errors[:ERRORS]),
        scan=_scan(reading.scan),
        sonar=sonar,
        points=_points(reading.points),
    )


def _problem_of(reading: RcaState) -> str:
    """Return why a reading's values are impossible; empty for a possible one."""
    lengths = (reading.distance, reading.clearance or 0.0)
    if not all(math.isfinite(value) and value >= 0.0 for value in lengths) or reading.contacts < 0:
        return "a distance or the number of contacts is negative or not a number"
    if not _is_plausible(reading.odometry or ()):
        return "the odometry is not a number, or is implausibly large"
    if not all(map(_is_plausible, reading.path or ())):
        return "a point of the path is not a number, or is implausibly far away"
    if not all(map(math.isfinite, reading.bumper or ())):
        return "the direction of a contact is not a number"
    if reading.scan is not None and not abs(reading.scan.angle_increment) > 0.0:
        return "all beams of the scan have the same direction"
    stamped = (*reading.sonar, reading.points)
    if not all(math.isfinite(each.stamp) for each in stamped if each is not None):
        return "the time of an echo or of obstacle points is not a number"
    return ""


def _is_plausible(metres: Iterable[float]) -> bool:
    return all(math.isfinite(value) and abs(value) <= FARTHEST for value in metres)


def _check_encodable(reading: RcaState) -> None:
    """Raise TypeError for numbers of NumPy's, which no message can hold."""
    scan = reading.scan
    if scan is not None:
        if odd := {*map(type, scan.ranges)} - NUMBERS:
            raise TypeError(f"the ranges of the scan are {odd.pop().__module__} numbers")
        scan = msgspec.structs.replace(scan, ranges=())
    msgspec.to_builtins(
        (
            scan,
            reading.stamp,
            reading.clearance,
            reading.contacts,
            reading.distance,
            reading.path,
            reading.bumper,
            reading.charger_contact,
            reading.estop,
        )
    )


def _battery(battery: Battery) -> Battery:
    unknown = {
        name: None
        for name in ("charge", "voltage")
        if isinstance(value := getattr(battery, name), float) and not math.isfinite(value)
    }
    return _in_range(msgspec.structs.replace(battery, **unknown))


def _points(seen: ObstaclePoints | None) -> ObstaclePoints | None:
    """Return the points without those that are not finite. Raises UnsoundReadingError."""
    if seen is None:
        return None
    if seen.points.ndim != PLANE or seen.points.shape[1] != PLANE:
        raise UnsoundReadingError("the obstacle points are not pairs")
    return ObstaclePoints(seen.stamp, seen.points[np.isfinite(seen.points).all(axis=1)])


def _scan(scan: Scan | None) -> Scan | None:
    if scan is None:
        return None
    found = np.array(scan.ranges, dtype=np.float64)  # None becomes NaN
    sound_ones = (found >= 0.0) & (found <= scan.range_max)
    if int(np.count_nonzero(sound_ones)) + scan.ranges.count(None) == len(scan.ranges):
        return scan
    ranges = tuple(
        value if good else None
        for value, good in zip(scan.ranges, sound_ones.tolist(), strict=True)
    )
    return msgspec.structs.replace(scan, ranges=ranges)
