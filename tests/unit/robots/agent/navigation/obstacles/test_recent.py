"""A robot that is held by an obstacle, with a noisy laser."""

import math

import numpy as np
import pytest

from robots.agent.navigation.obstacles.recent import RECENT, RecentSweeps
from robots.agent.ramp import ZERO
from robots.agent.safety.collision.braking import BRAKING, BrakeCheck, Hazards
from robots.agent.safety.collision.memory import RollingObstacleMap
from robots.api.geometry import Pose2D
from robots.api.messages import Velocity
from robots.world.robot_models import GIRAFF
from robots.world.sensing import CENTRE, LaserScan

NONE = np.zeros((0, 2))
LASER = GIRAFF.laser
CHECK = BrakeCheck(np.array(GIRAFF.footprint), GIRAFF.limits)
ANGLES = LASER.angle_min + LASER.angle_increment * np.arange(LASER.beams)
EVERY = 0.1  # s
MOUNT = Pose2D(LASER.x, 0.0, 0.0)


def sweep(stamp: float, post: tuple[float, float], error: float) -> LaserScan:
    """A sweep in which one beam meets a post in the robot's frame, and all others a far wall."""
    x, y = MOUNT.inverse().apply(*post)
    ranges = np.full(LASER.beams, 5.0)
    ranges[np.abs(ANGLES - math.atan2(y, x)).argmin()] = math.hypot(x, y) + error
    return LaserScan(stamp, LASER.angle_min, LASER.angle_increment, LASER.range_max, ranges, MOUNT)


@pytest.mark.parametrize("seed", range(6))
def test_robot_stays_held_despite_laser_noise(seed: int) -> None:
    """It is beside the corner of a wall, at the least distance, and wants to drive for 10 s."""
    rng = np.random.default_rng(seed)
    beside = 0.25 + BRAKING.touch / math.sqrt(2.0), 0.21 + BRAKING.touch / math.sqrt(2.0)
    memory, recent = RollingObstacleMap(), RecentSweeps(0.35)
    odometry, velocity = CENTRE, ZERO
    for tick in range(100 + RECENT.sweeps):
        now = tick * EVERY
        post = odometry.inverse().apply(*beside)
        beams = sweep(now, post, float(rng.normal(0.0, LASER.noise)))
        memory.update(odometry, beams)
        recent.take(odometry, beams)
        if tick < RECENT.sweeps:
            continue
        things = np.concatenate([memory.near(odometry, 3.0), recent.near(odometry, now)])
        wanted = Velocity(linear=0.1, angular=0.0)
        velocity = CHECK.fastest(velocity, wanted, Hazards(things, NONE, NONE)).velocity
        odometry = Pose2D(odometry.x + velocity.linear * EVERY, 0.0, 0.0)
    rest = float(CHECK.gaps(np.array([odometry.inverse().apply(*beside)]))[0])
    assert rest > BRAKING.touch - LASER.noise / 2.0


def test_points_lie_where_they_were_and_are_soon_forgotten() -> None:
    recent = RecentSweeps(0.35)
    recent.take(CENTRE, sweep(1.0, (0.4, 0.0), 0.0))
    ahead = Pose2D(0.02, 0.0, 0.0)
    assert recent.near(ahead, 1.1) == pytest.approx(np.array([[0.38, 0.0]]), abs=1e-6)
    assert len(recent.near(ahead, 1.0 + RECENT.seconds + 0.1)) == 0
    for number in range(RECENT.sweeps):
        recent.take(ahead, sweep(1.2 + number * 0.01, (2.0, 0.0), 0.0))
    assert len(recent.near(ahead, 1.25)) == 0


@pytest.mark.parametrize("moved", [Pose2D(0.1, 0.0, 0.0), Pose2D(0.0, 0.0, 0.2)])
def test_a_moving_robot_uses_only_its_newest_sweep(moved: Pose2D) -> None:
    recent = RecentSweeps(0.35)
    recent.take(CENTRE, sweep(1.0, (0.4, 0.0), 0.0))
    assert len(recent.near(moved, 1.1)) == 0
