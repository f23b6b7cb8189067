"""A robot's scans and poses as localization, navigation and the simulator share them."""

import math
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import numpy.typing as npt

from robots.api.geometry import Pose2D
from robots.api.messages import Laser, Scan

Floats = npt.NDArray[np.float64]

CENTRE = Pose2D(0.0, 0.0, 0.0)
Covariance = tuple[float, float, float, float, float, float]


@dataclass(frozen=True, eq=False)
class LaserScan:
    """One sweep of a planar laser.

    `ranges` (n,) in metres from `angle_min` on, counter-clockwise, `inf` without an echo; `mount`
    is the laser's pose in the robot's frame. Invalid ranges (NaN, negative, beyond `range_max`)
    become `inf`.
    """

    stamp: float
    angle_min: float
    angle_increment: float
    range_max: float
    ranges: Floats
    mount: Pose2D = CENTRE
    angles: Floats = field(init=False)

    def __post_init__(self) -> None:
        ranges = np.array(self.ranges, dtype=np.float64)
        with np.errstate(invalid="ignore"):
            ranges[~((ranges >= 0.0) & (ranges <= self.range_max))] = np.inf
        angles = self.angle_min + self.angle_increment * np.arange(len(ranges), dtype=np.float64)
        object.__setattr__(self, "ranges", ranges)
        object.__setattr__(self, "angles", angles)

    def points(self) -> Floats:
        """Return (m, 2) the ends of the beams with an echo, in the robot's frame, metres."""
        return self._points

    @cached_property
    def _points(self) -> Floats:
        met = np.isfinite(self.ranges)
        angles, ranges = self.angles[met] + self.mount.theta, self.ranges[met]
        points = np.empty((len(angles), 2))
        points[:, 0] = self.mount.x + ranges * np.cos(angles)
        points[:, 1] = self.mount.y + ranges * np.sin(angles)
        points.flags.writeable = False  # all callers share it
        return points


def beams_of(scan: Scan, laser: Laser) -> LaserScan:
    """Return a message as the sweep of a laser at its place; `null` is a beam without an echo."""
    ranges = np.array([np.inf if value is None else value for value in scan.ranges], dtype=float)
    mount = Pose2D(laser.x, laser.y, laser.theta)
    return LaserScan(
        scan.stamp, scan.angle_min, scan.angle_increment, scan.range_max, ranges, mount
    )


@dataclass(frozen=True)
class Estimate:
    """A robot's estimated pose in the map's frame, at `stamp`.

    `covariance` is the upper triangle over (x, y, theta) as in `robots.api.messages.Pose`; `score`,
    from 0 to 1, is the confidence in the pose; below one half the robot is lost and `localized`
    false.
    """

    stamp: float
    pose: Pose2D
    covariance: Covariance
    score: float
    localized: bool


def points_in_frame(frame: Pose2D, points: Floats) -> Floats:
    """Return (n, 2) points of the outer frame in the inner one, whose pose is `frame`."""
    cosine, sine = math.cos(frame.theta), math.sin(frame.theta)
    turn = np.array([[cosine, -sine], [sine, cosine]])
    result: Floats = (points[:, :2] - (frame.x, frame.y)) @ turn
    return result


def points_from_frame(frame: Pose2D, points: Floats) -> Floats:
    """Return (n, 2) points of the inner frame, whose pose is `frame`, in the outer one."""
    cosine, sine = math.cos(frame.theta), math.sin(frame.theta)
    result: Floats = points[:, :2] @ np.array([[cosine, sine], [-sine, cosine]])
    result += (frame.x, frame.y)
    return result
