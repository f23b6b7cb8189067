"""Planar poses, and conversion between metres of the world and pixels of a map image.

Frames: the world has x to the right and y up (REP 103 on a map hung on a wall); an image has u to
the right and v down, with (0, 0) at the outer corner of its first pixel, so that the centre of the
first pixel is (0.5, 0.5).
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

TAU = 2.0 * math.pi


def wrap_angle(angle: float) -> float:
    """Return the same direction in [-pi, pi)."""
    wrapped = (angle + math.pi) % TAU - math.pi
    return wrapped if wrapped < math.pi else -math.pi


class Pose2D(NamedTuple):
    """A rigid motion of the plane: turn by `theta`, then shift by (x, y). `world_from_robot` is the
    pose of a robot.
    """

    x: float
    y: float
    theta: float

    def compose(self, other: "Pose2D") -> "Pose2D":
        """Return self * other: with self = a_from_b and other = b_from_c, a_from_c."""
        x, y = self.apply(other.x, other.y)
        return Pose2D(x, y, wrap_angle(self.theta + other.theta))

    def inverse(self) -> "Pose2D":
        """Return b_from_a of a_from_b."""
        cosine, sine = math.cos(self.theta), math.sin(self.theta)
        return Pose2D(
            -cosine * self.x - sine * self.y,
            sine * self.x - cosine * self.y,
            wrap_angle(-self.theta),
        )

    def apply(self, x: float, y: float) -> tuple[float, float]:
        """Return the point (x, y), given in the inner frame, in the outer one."""
        cosine, sine = math.cos(self.theta), math.sin(self.theta)
        return self.x + cosine * x - sine * y, self.y + sine * x + cosine * y

    def distance(self, other: "Pose2D") -> float:
        """Return how far apart the two origins are, in metres."""
        return math.hypot(other.x - self.x, other.y - self.y)


@dataclass(frozen=True)
class MapTransform:
    """World metres to pixels of a ROS map_server image and back.

    `resolution` in metres a pixel, `origin` the world pose of the image's lower left corner (turned
    maps included), `height` of the image in pixels.
    """

    resolution: float
    origin: Pose2D
    height: int

    def __post_init__(self) -> None:
        if not (math.isfinite(self.resolution) and self.resolution > 0.0 and self.height > 0):
            given = f"{self.resolution} and {self.height}"
            raise ValueError(f"a map needs a positive resolution and height, not {given}")

    def to_pixel(self, x: float, y: float) -> tuple[float, float]:
        """Return (u, v), with fractions, of the world point (x, y)."""
        right, up = self.origin.inverse().apply(x, y)
        return right / self.resolution, self.height - up / self.resolution

    def to_world(self, u: float, v: float) -> tuple[float, float]:
        """Return the world point (x, y) at (u, v)."""
        return self.origin.apply(u * self.resolution, (self.height - v) * self.resolution)

    def to_cell(self, x: float, y: float) -> tuple[int, int]:
        """Return (row, column) of the pixel that holds (x, y); it may lie outside the image."""
        u, v = self.to_pixel(x, y)
        return math.floor(v), math.floor(u)
