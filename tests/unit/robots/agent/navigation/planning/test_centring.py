"""Paths through gaps hardly wider than the robot, planned and driven."""

import math

import numpy as np
import pytest

from robots.agent.navigation.planning.centring import centred_between
from robots.agent.navigation.planning.costmap import CostMap
from robots.agent.navigation.planning.follower import Follower
from robots.agent.navigation.planning.path import PlannedPath, resampled
from robots.agent.navigation.planning.planner import Planner
from robots.agent.ramp import ZERO
from robots.agent.safety.collision.braking import BrakeCheck, Hazards
from robots.api.geometry import MapTransform, Pose2D
from robots.api.messages import Velocity
from robots.world.grid import FREE, OCCUPIED, OccupancyGrid
from robots.world.robot_models import GIRAFF
from robots.world.sensing import CENTRE, Floats, points_in_frame

HALF = max(y for _, y in GIRAFF.footprint)
CELL = 0.1
GAP_ROWS = 20  # below the gap, of 50
WALL_COLUMNS = 30, 33  # of 60
NONE = np.zeros((0, 2))


def middle_of_gap(cells: int, origin: Pose2D, start: float, goal: float) -> Floats:
    """Return (n, 2) the path through a gap in a wall, from `start` to `goal` metres up on both
    sides of it: metres along the gap and beside its middle.
    """
    image = np.full((50, 60), FREE, dtype=np.uint8)
    image[:, WALL_COLUMNS[0] : WALL_COLUMNS[1]] = OCCUPIED
    top = 50 - GAP_ROWS - cells
    image[top : top + cells, WALL_COLUMNS[0] : WALL_COLUMNS[1]] = FREE
    planner = Planner(
        CostMap(OccupancyGrid(image, MapTransform(CELL, origin, 50)), np.array(GIRAFF.footprint))
    )
    found = planner.plan(
        origin.apply(1.0, start), origin.apply(5.0, goal), planner.costmap.clearance
    )
    assert found is not None
    x, y = points_in_frame(origin, found.points).T
    return np.column_stack([x - WALL_COLUMNS[0] * CELL, y - (GAP_ROWS + cells / 2.0) * CELL])


@pytest.mark.parametrize("origin", [CENTRE, Pose2D(3.02, -1.03, 0.4)])
@pytest.mark.parametrize("cells", [7, 8])
@pytest.mark.parametrize(("start", "goal"), [(1.0, 1.0), (2.3, 2.5), (1.0, 4.0)])
def test_a_path_through_a_narrow_gap_keeps_to_the_middle_of_it(
    cells: int, origin: Pose2D, start: float, goal: float
) -> None:
    """Wherever in a cell of a decimetre the middle lies: a robot has 7 cm on each side."""
    along, aside = middle_of_gap(cells, origin, start, goal).T
    inside = (along > 0.0) & (along < 0.3)
    assert inside.sum() > 3
    assert np.abs(aside[inside]).max() < 0.01


def test_a_robot_with_a_wrong_pose_drives_through_the_middle_of_an_observed_gap() -> None:
    follower = Follower(BrakeCheck(np.array(GIRAFF.footprint), GIRAFF.limits), GIRAFF.limits)
    follower.take(PlannedPath(resampled(np.array([[0.0, 0.0], [3.0, 0.0]]))), None)
    seen = np.linspace(1.4, 1.7, 13)
    jambs = np.concatenate(
        [np.column_stack([seen, np.full(13, side * (HALF + 0.07))]) for side in (1.0, -1.0)]
    )
    pose, velocity, dt = Pose2D(0.2, 0.05, 0.0), ZERO, 0.1
    aside = []
    for _ in range(150):
        believed = Pose2D(pose.x, pose.y - 0.05, pose.theta)
        hazards = Hazards(points_in_frame(pose, jambs), NONE, NONE)
        velocity = follower.step(believed, velocity, hazards).velocity
        step = velocity.linear * dt
        pose = pose.compose(Pose2D(step, 0.0, velocity.angular * dt))
        if seen[0] < pose.x + 0.18 < seen[-1]:
            aside.append(pose.y)
    assert pose.x > 2.5
    assert np.abs(aside).max() < 0.02


def test_a_line_is_moved_between_two_posts_and_returns_behind_them() -> None:
    line = np.column_stack([np.linspace(0.0, 3.0, 61), np.zeros(61)])
    moved = centred_between(line, line[:, 0], np.array([(1.5, 0.40), (1.5, -0.30)]), HALF)
    assert moved[30] == pytest.approx((1.5, 0.05), abs=0.005)
    assert np.array_equal(moved[[0, -1]], line[[0, -1]])
    assert np.abs(np.diff(moved[:, 1])).max() / 0.05 < math.tan(0.3)


def test_a_gap_that_is_left_is_no_reason_to_turn() -> None:
    follower = Follower(BrakeCheck(np.array(GIRAFF.footprint), GIRAFF.limits), GIRAFF.limits)
    follower.take(PlannedPath(resampled(np.array([[0.0, 0.0], [3.0, 0.0]]))), None)
    behind = Hazards(np.array([(-0.4, 0.3), (-0.4, -0.4)]), NONE, NONE)
    for _ in range(2):  # the first finds where on the path it is
        step = follower.step(Pose2D(1.0, 0.0, 0.0), Velocity(linear=0.2, angular=0.0), behind)
    assert step.velocity.angular == 0.0
