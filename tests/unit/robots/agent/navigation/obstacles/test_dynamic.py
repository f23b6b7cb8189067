"""Who walked out of sight a moment ago."""

import math

import numpy as np

from robots.agent.navigation.obstacles.dynamic import LOST, LostObstacles
from robots.api.geometry import Pose2D
from robots.world.sensing import LaserScan

HERE = Pose2D(2.0, 1.0, 0.5)


def half_round(mount: Pose2D = Pose2D(0.15, 0.0, 0.0)) -> LaserScan:  # noqa: B008 -- a tuple
    return LaserScan(0.0, -math.pi / 2.0, math.pi / 180.0, 10.0, np.full(181, 5.0), mount)


def test_only_people_out_of_sight_are_remembered() -> None:
    lost_obstacles = LostObstacles()
    lost_obstacles.take(0.0, HERE, np.array([[0.4, 0.5]]))
    assert len(lost_obstacles.out_of_sight(0.1, HERE, half_round())) == 0
    ahead = HERE.compose(Pose2D(0.5, 0.0, 0.0))
    assert np.allclose(lost_obstacles.out_of_sight(1.0, ahead, half_round()), [[-0.1, 0.5]])


def test_passed_people_are_forgotten_after_a_while_distant_ones_at_once() -> None:
    lost_obstacles = LostObstacles()
    lost_obstacles.take(0.0, HERE, np.array([[0.1, 0.5], [-0.1, LOST.near + 0.1]]))
    assert len(lost_obstacles.out_of_sight(LOST.hold - 0.1, HERE, half_round())) == 1
    assert len(lost_obstacles.out_of_sight(LOST.hold + 0.1, HERE, half_round())) == 0


def test_a_laser_with_a_full_view_has_no_hidden_places() -> None:
    round_about = LaserScan(0.0, -math.pi, math.tau / 360.0, 10.0, np.full(361, 5.0))
    lost_obstacles = LostObstacles()
    lost_obstacles.take(0.0, HERE, np.array([[-0.5, 0.1], [-0.5, -0.1]]))
    assert len(lost_obstacles.out_of_sight(0.1, HERE, round_about)) == 0
