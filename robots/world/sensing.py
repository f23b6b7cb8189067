"""What a robot's own sensors say, in numbers that localization and navigation share."""

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

    `ranges` (n,) in metres from `angle_min` on, counter-clockwise, `inf` where nothing came back;
    `mount` is the laser's pose in the robot's frame. What no laser measures (NaN, negative, beyond
    `range_max`) counts as nothing.
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
        object.__setattr__(self, "ranges", ranges)
        object.__setattr__(
            self,
            "angles",
            self.angle_min + self.angle_increment * np.arange(len(ranges), dtype=np.float64),
        )

    def points(self) -> Floats:
        """Return (m, 2) where the beams that came back ended, in the robot's frame, metres."""
        return self._points

    @cached_property
    def _points(self) -> Floats:
        met = np.isfinite(self.ranges)
        angles, ranges = self.angles[met] + self.mount.theta, self.ranges[met]
        points = np.empty((len(angles), 2))
        points[:, 0] = self.mount.x + ranges * np.cos(angles)
        points[:, 1] = self.mount.y + ranges * np.sin(angles)
        points.flags.writeable = False  # several ask, and get the same
        return points


def beams_of(scan: Scan, laser: Laser) -> LaserScan:
    """Return a scan as the sweep of a laser that sits where `laser` says; `null` is where nothing
    came back.
    """
    ranges = np.array(
        [np.inf if value is None else value for value in scan.ranges], dtype=np.float64
    )
    mount = Pose2D(laser.x, laser.y, laser.theta)
    return LaserScan(
        scan.stamp, scan.angle_min, scan.angle_increment, scan.range_max, ranges, mount
    )


@dataclass(frozen=True)
class Estimate:
    """Where a robot believes it is, in the map's frame, at `stamp`.

    `covariance` is the upper triangle over (x, y, theta) as in `robots.api.messages.Pose`; `score`
    from 0 to 1 says how far to trust the pose, and below one half the robot is lost: `localized` is
    false.
    """

    stamp: float
    pose: Pose2D
    covariance: Covariance
    score: float
    localized: bool


def points_in_frame(frame: Pose2D, points: Floats) -> Floats:
    """Return (n, 2) points of the outer frame in the inner one, whose pose in the
    outer is `frame`.
    """
    cosine, sine = math.cos(frame.theta), math.sin(frame.theta)
    result: Floats = (points[:, :2] - (frame.x, frame.y)) @ np.array(
        [[cosine, -sine], [sine, cosine]]
    )
    return result


def points_from_frame(frame: Pose2D, points: Floats) -> Floats:
    """Return (n, 2) points of the inner frame, whose pose in the outer is `frame`, in the outer
    one.
    """
    cosine, sine = math.cos(frame.theta), math.sin(frame.theta)
    result: Floats = points[:, :2] @ np.array([[cosine, sine], [-sine, cosine]])
    result += (frame.x, frame.y)
    return result
