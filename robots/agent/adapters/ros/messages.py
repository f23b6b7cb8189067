"""Messages of ROS as JSON objects, as rosbridge writes them, and back to ours. Pure. Functions that
read one (`…_in`) raise RosError when it is malformed.

Both generations: the stamp of a header is `secs, nsecs` in ROS 1 and `sec, nanosec` in ROS 2.
Numbers that JSON lacks (NaN, infinity) arrive as null, bytes as base64 or as a list of numbers.
Frames and signs are ROS's (REP 103) and ours: x forward, y left, a positive pitch looks down.
"""

import base64
import binascii
import math
from collections.abc import Mapping
from typing import Any

from robots.api.geometry import Pose2D, wrap_angle
from robots.api.messages import Battery, Pose, Scan, Velocity

MOST_RANGES = 2000
# metres of standard deviation at which a pose scores 0.5; beyond it the robot is lost
HALF_TRUSTED = 0.3
CHARGING, FULL = 1, 4  # sensor_msgs/BatteryState
STATUS_KNOWN = frozenset({1, 2, 3, 4})

Json = Mapping[str, Any]


class RosError(ValueError):
    """A message does not have the fields of its type."""


def time_of(unix: float, version: int) -> dict[str, int]:
    """Return a stamp of ROS `version`."""
    seconds = math.floor(unix)
    nano = min(999_999_999, round((unix - seconds) * 1e9))
    return {"secs": seconds, "nsecs": nano} if version == 1 else {"sec": seconds, "nanosec": nano}


def header(frame: str, unix: float, version: int) -> dict[str, Any]:
    return {"frame_id": frame, "stamp": time_of(unix, version)}


def twist(velocity: Velocity) -> dict[str, Any]:
    """Return a geometry_msgs/Twist."""
    return {
        "linear": {"x": velocity.linear, "y": 0.0, "z": 0.0},
        "angular": {"x": 0.0, "y": 0.0, "z": velocity.angular},
    }


def pose(place: Pose2D) -> dict[str, Any]:
    """Return a geometry_msgs/Pose on the floor."""
    orientation = {
        "x": 0.0,
        "y": 0.0,
        "z": math.sin(place.theta / 2.0),
        "w": math.cos(place.theta / 2.0),
    }
    return {"position": {"x": place.x, "y": place.y, "z": 0.0}, "orientation": orientation}


def stamp_in(message: Json, arrived: float) -> float:
    """Return the Unix time in a message's header; `arrived` when it has none."""
    stamp = message.get("header", {}).get("stamp", {})
    seconds = stamp.get("sec", stamp.get("secs", 0))
    nano = stamp.get("nanosec", stamp.get("nsecs", 0))
    return float(seconds) + float(nano) * 1e-9 if seconds else arrived


def pose_in(message: Json) -> Pose2D:
    """Read a geometry_msgs/Pose as a pose on the floor."""
    try:
        place, turn = message["position"], message["orientation"]
        return _checked(Pose2D(float(place["x"]), float(place["y"]), _yaw(turn)))
    except (KeyError, TypeError, ValueError) as error:
        raise RosError(f"invalid pose: {error}") from error


def odometry_in(message: Json) -> tuple[Pose2D, Velocity]:
    """Read a nav_msgs/Odometry: the pose in its own frame, and the velocity of the robot."""
    try:
        return pose_in(message["pose"]["pose"]), velocity_in(message["twist"])
    except (KeyError, TypeError) as error:
        raise RosError(f"invalid odometry: {error}") from error


def velocity_in(message: Json) -> Velocity:
    """Read a geometry_msgs/Twist or TwistStamped."""
    try:
        twist = message.get("twist", message)
        return Velocity(
            linear=_number(twist["linear"]["x"]), angular=_number(twist["angular"]["z"])
        )
    except (KeyError, TypeError, AttributeError) as error:
        raise RosError(f"invalid velocity: {error}") from error


def fix_in(message: Json) -> Pose:
    """Read a geometry_msgs/PoseWithCovarianceStamped; the score follows from the covariance."""
    try:
        here = pose_in(message["pose"]["pose"])
        wide = [_number(value) for value in message["pose"]["covariance"]]
        xx, xy, xt, yy, yt, tt = (wide[index] for index in (0, 1, 5, 7, 11, 35))
    except (KeyError, TypeError, IndexError) as error:
        raise RosError(f"invalid pose with covariance: {error}") from error
    score = 1.0 / (1.0 + max(0.0, xx, yy) / HALF_TRUSTED**2)
    covariance = (xx, xy, xt, yy, yt, tt)
    return Pose(**here._asdict(), covariance=covariance, localized=score >= 0.5, score=score)


def transform_in(message: Json, parent: str, child: str) -> Pose2D | None:
    """Return parent_from_child of a tf2_msgs/TFMessage, None when it has only others."""
    try:
        for each in message["transforms"]:
            frames = each["header"]["frame_id"], each["child_frame_id"]
            if tuple(frame.lstrip("/") for frame in frames) == (parent, child):
                shift, turn = each["transform"]["translation"], each["transform"]["rotation"]
                return _checked(Pose2D(float(shift["x"]), float(shift["y"]), _yaw(turn)))
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise RosError(f"invalid transform: {error}") from error
    return None


def scan_in(message: Json, stamp: float) -> Scan:
    """Read a sensor_msgs/LaserScan; clockwise beams are reversed, and too many are thinned."""
    try:
        ranges = list(message["ranges"])
        low, step = _number(message["angle_min"]), _number(message["angle_increment"])
        nearest, farthest = _number(message.get("range_min", 0.0)), _number(message["range_max"])
    except (KeyError, TypeError) as error:
        raise RosError(f"invalid laser scan: {error}") from error
    if not ranges or step == 0.0 or farthest <= 0.0:
        raise RosError("a laser scan without beams")
    if step < 0.0:
        ranges, low, step = ranges[::-1], low + step * (len(ranges) - 1), -step
    every = math.ceil(len(ranges) / MOST_RANGES)
    kept = tuple(_range(value, nearest, farthest) for value in ranges[::every])
    return Scan(
        stamp=stamp,
        angle_min=wrap_angle(low),
        angle_increment=step * every,
        range_max=min(farthest, 1000.0),
        ranges=kept,
    )


def battery_in(message: Json) -> Battery:
    """Read a sensor_msgs/BatteryState, in which NaN is unmeasured; some drivers count to 100, and
    some send -1 or 0 V for unknown.
    """
    voltage, share = _finite(message.get("voltage")), _finite(message.get("percentage"))
    if share is not None and share > 1.0:
        share /= 100.0
    status = message.get("power_supply_status")
    return Battery(
        voltage=voltage if voltage is not None and voltage > 0.0 else None,
        charge=share if share is not None and share >= 0.0 else None,
        charging=status in {CHARGING, FULL} if status in STATUS_KNOWN else None,
    )


def flag_in(message: Json) -> bool:
    """Read a std_msgs/Bool."""
    data = message.get("data")
    if not isinstance(data, bool):
        raise RosError(f"not true or false: {data!r}")
    return data


def picture_in(message: Json) -> bytes:
    """Read a sensor_msgs/CompressedImage: the bytes of a JPEG or PNG."""
    data = message.get("data")
    try:
        return base64.b64decode(data, validate=True) if isinstance(data, str) else bytes(data or ())
    except (TypeError, ValueError, binascii.Error) as error:
        raise RosError(f"invalid image: {error}") from error


def joint_in(message: Json, name: str) -> float | None:
    """Return the angle of one joint of a sensor_msgs/JointState, None when it has only others."""
    names, positions = message.get("name", ()), message.get("position", ())
    return next(
        (_finite(angle) for joint, angle in zip(names, positions, strict=False) if joint == name),
        None,
    )


def _yaw(turn: Json) -> float:
    x, y, z, w = (float(turn[axis]) for axis in "xyzw")
    return math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


def _checked(place: Pose2D) -> Pose2D:
    if not all(map(math.isfinite, place)):
        raise ValueError("not a number")
    return place


def _number(value: Any) -> float:
    found = _finite(value)
    if found is None:
        raise RosError(f"not a number: {value!r}")
    return found


def _finite(value: Any) -> float | None:
    return float(value) if isinstance(value, int | float) and math.isfinite(value) else None


def _range(value: Any, nearest: float, farthest: float) -> float | None:
    found = _finite(value)
    return found if found is not None and nearest <= found < farthest else None
