"""The ground that a footprint sweeps, sampled as poses, and its distance to points. All in the
robot's present frame.

A convex footprint is the half planes n . p <= d of its sides; a point is outside when the largest n
. p - d is positive, and by at least so much. At a corner that is less than the distance, never
more, so it is a safe lower bound.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from robots.api.messages import Limits, Velocity
from robots.world.sensing import Floats


@dataclass(frozen=True, eq=False)
class Hull:
    """A footprint: outward unit `normals` (e, 2) of its sides, their `offsets` (e,) from the
    centre, and the `radius` about it.

    `turning` (2 e, 2) times (cosine, sine) of a heading are the turned normals: their x, then their
    y.
    """

    normals: Floats
    offsets: Floats
    radius: float
    turning: Floats


def hull(footprint: tuple[tuple[float, float], ...]) -> Hull:
    """Return the sides of a convex polygon in either direction. Raises ValueError for fewer than
    three corners, no area, or a centre outside.
    """
    corners = np.array(footprint, dtype=np.float64).reshape(-1, 2)
    along = np.roll(corners, -1, axis=0) - corners
    lengths = np.hypot(along[:, 0], along[:, 1])
    if len(corners) < 3 or not np.isfinite(corners).all() or lengths.min() <= 0.0:
        raise ValueError("a footprint must be a convex polygon of at least three different corners")
    normals = np.column_stack([along[:, 1], -along[:, 0]]) / lengths[:, None]
    offsets = (normals * corners).sum(axis=1)
    if offsets.sum() < 0.0:
        normals, offsets = -normals, -offsets
    if offsets.min() <= 0.0 or ((corners @ normals.T) - offsets).max() > 1e-9:
        raise ValueError("a footprint must be a convex polygon around the robot's centre")
    turning = np.vstack([normals * (1.0, -1.0), normals[:, ::-1]])
    return Hull(normals, offsets, float(np.hypot(corners[:, 0], corners[:, 1]).max()), turning)


def stops(
    velocities: Floats, limits: Limits, hold: float, count: int, *, stand: bool = False
) -> Floats:
    """Return poses (c, count, 3) until rest of a base that keeps (c, 2) m/s, rad/s for `hold`
    seconds and then brakes.

    Each axis brakes by its own limit, so that an arc straightens or tightens. The last pose is at
    rest; with `stand` the present pose comes first, which makes it (c, count + 1, 3).
    """
    braking = np.array([limits.linear_braking, limits.angular_braking])
    speeds = np.abs(velocities)
    needed = speeds / braking
    times = (hold + needed.max(axis=1))[:, None] * (np.arange(count + 1) / count)
    rolling = np.minimum(np.maximum(times[:, :, None] - hold, 0.0), needed[:, None, :])
    ways = np.sign(velocities)[:, None, :] * (
        speeds[:, None, :] * (np.minimum(times, hold)[:, :, None] + rolling)
        - braking * rolling**2 / 2.0
    )
    if stand:
        ways = np.concatenate([np.zeros((len(ways), 1, 2)), ways], axis=1)
    return along(ways)


def arcs(
    start: Velocity, targets: Floats, acceleration: float, seconds: float, count: int
) -> Floats:
    """Return poses (c, count, 3) over `seconds` while the turn changes from that of `start` to each
    of `targets` (c,) rad/s.
    """
    times = seconds * np.arange(count + 1) / count
    changes = acceleration * times
    rates = start.angular + np.minimum(
        np.maximum(targets[:, None] - start.angular, -changes), changes
    )
    ways = np.zeros((len(targets), count + 1, 2))
    ways[:, :, 0] = start.linear * times
    ways[:, 1:, 1] = (rates[:, 1:] + rates[:, :-1]).cumsum(axis=1) * (seconds / count / 2.0)
    return along(ways)


def along(ways: Floats) -> Floats:
    """Return poses (c, k, 3) after the first of (c, k + 1, 2) metres driven and radians turned
    since the start.
    """
    headings = (ways[:, 1:, 1] + ways[:, :-1, 1]) / 2.0
    steps = ways[:, 1:, 0] - ways[:, :-1, 0]
    poses = np.empty((ways.shape[0], ways.shape[1] - 1, 3))
    (steps * np.cos(headings)).cumsum(axis=1, out=poses[:, :, 0])
    (steps * np.sin(headings)).cumsum(axis=1, out=poses[:, :, 1])
    poses[:, :, 2] = ways[:, 1:, 1]
    return poses


def distances(
    shape: Hull, poses: Floats, points: Floats, margins: Floats
) -> npt.NDArray[np.float32]:
    """Return (c, k, n): the distances of points (n, 2) from the hull at poses (c, k, 3), its sides
    pushed out by `margins` (c, e).
    """
    # The sides are moved and not the points, which are many: n . p - d of all of them is one
    # product of (3, e, c, k) with (3, n).
    x, y, heading = poses.reshape(-1, 3).T
    turned = shape.turning @ np.stack([np.cos(heading), np.sin(heading)])
    across, up = turned[: len(shape.offsets)], turned[len(shape.offsets) :]
    kept = (shape.offsets + margins).T.repeat(poses.shape[1], axis=1)
    # half the time, and precise to a thousandth of a millimetre
    sides = np.empty((3, *across.shape), dtype=np.float32)
    sides[0], sides[1], sides[2] = across, up, -(across * x + up * y + kept)
    spots = np.ones((3, len(points)), dtype=np.float32)
    spots[:2] = points.T
    found: npt.NDArray[np.float32] = (
        (sides.reshape(3, -1).T @ spots).reshape(-1, *poses.shape[:2], len(points)).max(axis=0)
    )
    return found


def outside(shape: Hull, points: Floats) -> Floats:
    """Return (n,) the distances of points (n, 2) from the footprint; negative inside."""
    if len(points) == 0:
        return np.zeros(0)
    found: Floats = (shape.normals @ points.T - shape.offsets[:, None]).max(axis=0)
    return found
