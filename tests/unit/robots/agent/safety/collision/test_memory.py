import math

import numpy as np
import pytest
from hypothesis import given, strategies as st

from robots.agent.safety.collision.memory import (
    MemorySettings,
    RollingObstacleMap,
    compare,
)
from robots.api.geometry import Pose2D
from robots.world.raycaster import cast
from robots.world.sensing import LaserScan, points_from_frame, points_in_frame
from tests.support.examples import examples

HALF_CIRCLE = np.linspace(-math.pi / 2, math.pi / 2, 181)
MOUNT = Pose2D(0.15, 0.0, 0.0)
START = Pose2D(0.0, 0.0, 0.0)
#  a room of 4 m x 3 m about the origin
ROOM = np.array(
    [[-2.0, -1.5, 2.0, -1.5], [2.0, -1.5, 2.0, 1.5], [2.0, 1.5, -2.0, 1.5], [-2.0, 1.5, -2.0, -1.5]]
)
BOX = np.array(
    [[1.0, -0.2, 1.0, 0.2], [1.0, 0.2, 1.2, 0.2], [1.2, 0.2, 1.2, -0.2], [1.2, -0.2, 1.0, -0.2]]
)


def look(pose: Pose2D, segments: np.ndarray = ROOM, stamp: float = 0.0) -> LaserScan:
    eye = pose.compose(MOUNT)
    ranges, _ = cast(segments, eye.x, eye.y, HALF_CIRCLE + eye.theta)
    return LaserScan(stamp, -math.pi / 2, math.radians(1.0), 10.0, ranges, MOUNT)


def with_ranges(ranges: np.ndarray, stamp: float = 0.0) -> LaserScan:
    return LaserScan(stamp, -math.pi / 2, math.radians(1.0), 10.0, ranges, MOUNT)


def nearest_to(memory: RollingObstacleMap, odometry: Pose2D, x: float, y: float) -> float:
    points = memory.near(odometry, 4.0)
    return float(np.hypot(points[:, 0] - x, points[:, 1] - y).min())


def turned_away(memory: RollingObstacleMap, segments: np.ndarray = ROOM, far: int = 180) -> Pose2D:
    """Look at things, turn left by `far` degrees, and return the pose."""
    for step in range(0, far + 1, 5):
        pose = Pose2D(0.0, 0.0, math.radians(step))
        memory.update(pose, look(pose, segments))
    return pose


@pytest.fixture
def memory():
    return RollingObstacleMap()


@pytest.mark.parametrize("step", [0.1, 0.3, -0.3, 0.45, -0.45, 0.9])
def test_points_that_leave_the_view_slowly_are_remembered_as_well(step):
    """The last beam, 1° from its neighbour, must not remove a point half a degree beyond it."""
    memory, turned = RollingObstacleMap(), 0.0
    while abs(turned) < 90.0:
        pose = Pose2D(0.0, 0.0, math.radians(turned))
        memory.update(pose, look(pose))
        turned += step
    points = memory.near(pose, 4.0)
    eye = points_in_frame(MOUNT, points)
    bearings = np.sort(np.degrees(np.arctan2(eye[:, 1], eye[:, 0])) % 360.0)
    low = 95.0 if step < 0 else 195.0
    behind = bearings[(bearings > low) & (bearings < low + 70.0)]
    assert np.diff(behind).max() < 3.0


def test_points_in_view_are_exact_and_remembered_points_may_be_off(memory):
    pose = turned_away(memory)
    points, errors = memory.about(pose, 4.0)
    assert errors[points[:, 0] > 0.3].max() == 0.0
    assert errors[points[:, 0] < -1.5].min() > 0.8 * memory.settings.inexact
    assert errors.max() == memory.settings.inexact


def test_time_removes_no_obstacle(memory):
    memory.update(START, look(START, stamp=0.0))
    turned = Pose2D(0.0, 0.0, math.pi)
    for minute in range(60):
        memory.update(turned, look(turned, stamp=60.0 * minute))
    assert nearest_to(memory, turned, -2.0, 0.0) < 0.05


def test_points_are_forgotten_by_the_distance_driven():
    memory = RollingObstacleMap(MemorySettings(distance=1.0))
    memory.update(START, look(START))
    for step in range(1, 30):
        pose = Pose2D(-0.05 * step, 0.0, math.pi)
        memory.update(pose, with_ranges(look(pose).ranges))
    assert nearest_to(memory, pose, -2.0 - 1.45, 0.0) > 1.0


def test_close_point_behind_is_kept_while_the_robot_drives_to_and_fro():
    memory = RollingObstacleMap(MemorySettings(distance=1.0))
    memory.update(START, look(START, np.vstack([ROOM, BOX])))
    for step in range(60):
        pose = Pose2D(0.05 * (step % 2), 0.0, math.pi)
        memory.update(pose, look(pose))
    assert nearest_to(memory, pose, -1.0 + pose.x, 0.0) < 0.05  # the box, a metre behind
    assert nearest_to(memory, pose, -2.0 + pose.x, 0.8) > 0.5  # the wall beyond


def test_second_scan_through_a_point_removes_it(memory):
    memory.update(START, look(START, np.vstack([ROOM, BOX])))
    memory.update(START, look(START))
    assert nearest_to(memory, START, 1.0, 0.0) < 0.05
    memory.update(START, look(START))
    assert nearest_to(memory, START, 1.0, 0.0) > 0.5


def test_a_lost_echo_removes_no_point(memory):
    full = look(START, np.vstack([ROOM, BOX]))
    memory.update(START, full)
    for lost in (88, 90, 92):
        ranges = full.ranges.copy()
        ranges[lost] = np.inf
        memory.update(START, with_ranges(ranges))
        memory.update(START, with_ranges(ranges))
    assert nearest_to(memory, START, 1.0, 0.0) < 0.05


def test_no_echo_from_many_neighbours_is_free_space_except_where_the_laser_is_blind(memory):
    ranges = np.full(181, 2.0)
    ranges[80:101] = 1.0
    ranges[:20] = 0.2
    memory.update(START, with_ranges(ranges))
    lost = np.full(181, 2.0)
    lost[70:111], lost[:40] = np.inf, np.inf
    for _ in range(3):
        memory.update(START, with_ranges(lost))
    assert nearest_to(memory, START, 1.15, 0.0) > 0.5
    assert nearest_to(memory, START, 0.15, -0.2) < 0.05


def test_a_covered_laser_neither_adds_nor_removes_points(memory):
    memory.update(START, look(START, stamp=5.0))
    count = len(memory)
    for ranges in (np.full(181, np.nan), np.full(181, np.inf), np.full(181, -1.0), np.zeros(0)):
        memory.update(START, with_ranges(ranges, stamp=6.0))
    assert memory.seen == 5.0
    assert len(memory) == count
    assert RollingObstacleMap().seen == -math.inf


def test_a_jump_of_the_odometry_clears_the_memory(memory):
    memory.update(START, look(START))
    there = Pose2D(50.0, 0.0, 0.0)
    memory.update(there, look(START))
    assert nearest_to(memory, there, 2.0, 0.0) < 0.05
    assert len(memory.near(START, 4.0)) == 0


def test_a_robot_at_rest_remembers_at_most_one_scan(memory):
    rng = np.random.default_rng(3)
    clean = look(START).ranges
    for _ in range(300):
        memory.update(START, with_ranges(clean + rng.normal(0.0, 0.008, len(clean))))
    assert len(memory) <= 181


def test_a_clockwise_laser_is_compared_with_its_own_beams():
    points = np.array([[1.15, 0.5], [1.15, -0.5]])
    # sees through to the left, where its beams begin
    ranges = np.where(np.arange(181) < 90, 3.0, np.hypot(1.0, 0.5))
    beams = LaserScan(0.0, math.pi / 2, math.radians(-1.0), 10.0, ranges, MOUNT)
    again, through = compare(points, beams, MemorySettings())
    assert again.tolist() == [False, True]
    assert through.tolist() == [True, False]


@pytest.mark.slow
@examples(30, thorough=300)
@given(st.floats(-1.0, 1.0), st.floats(-0.8, 0.8), st.floats(-3, 3), st.integers(0, 1000))
def test_every_observed_wall_is_remembered_in_its_place(x, y, heading, seed):
    rng = np.random.default_rng(seed)
    memory = RollingObstacleMap()
    pose = Pose2D(x, y, heading)
    for _ in range(20):
        memory.update(pose, look(pose))
        pose = Pose2D(pose.x, pose.y, pose.theta + float(rng.uniform(-0.2, 0.2)))
    beams = look(pose)
    memory.update(pose, beams)
    world = points_from_frame(pose, memory.near(pose, 4.0))
    off_wall = np.minimum(np.abs(np.abs(world[:, 0]) - 2.0), np.abs(np.abs(world[:, 1]) - 1.5))
    assert off_wall.max() < 1e-6
    seen = beams.points()
    known = memory.near(pose, 4.0)
    assert all(np.hypot(*(known - point).T).min() < 0.06 for point in seen)


NEAR_BOX = np.vstack([ROOM, BOX - (0.4, 0.0, 0.4, 0.0)])


def test_an_obstacle_continues_behind_an_edge_that_is_out_of_view(memory):
    away = turned_away(memory, NEAR_BOX)
    seen, (points, errors) = memory.near(away, 4.0), memory.about(away, 4.0)
    hidden = points_from_frame(away, points[len(seen) :])
    assert len(points) == len(errors) > len(seen)
    assert np.array_equal(points[: len(seen)], seen)
    # Both front corners, at (0.6, 0.2) and (0.6, -0.2), were edges; the box continues behind them
    # where the laser never looked.
    for corner in (0.2, -0.2):
        beside = np.hypot(hidden[:, 0] - 0.6, hidden[:, 1] - corner)
        assert beside.min() < 0.06
        assert 0.03 < hidden[beside < 0.12, 0].max() - 0.6 < 0.09


def test_points_hidden_by_an_edge_do_not_count_in_view_or_after_another_scan(memory):
    memory.update(START, look(START, NEAR_BOX))
    memory.update(START, look(START, NEAR_BOX))
    assert len(memory.about(START, 4.0)[0]) == len(memory.near(START, 4.0))
    turned_away(memory, NEAR_BOX)
    turned_away(memory, NEAR_BOX, far=0)
    assert len(memory.about(START, 4.0)[0]) == len(memory.near(START, 4.0))


def test_points_behind_edges_do_not_accumulate_for_a_robot_at_rest(memory):
    away = turned_away(memory, NEAR_BOX, far=90)
    known = len(memory.about(away, 4.0)[0])
    for _ in range(100):
        memory.update(away, look(away, NEAR_BOX))
    assert len(memory.about(away, 4.0)[0]) <= known


@examples(25, thorough=250)
@given(st.floats(0.45, 0.8), st.floats(0.1, 0.3), st.floats(-0.4, 0.4))
def test_the_hidden_flank_of_a_round_obstacle_is_not_nearer_than_its_points(
    distance: float, radius: float, aside: float
):
    turns = np.linspace(0.0, 2.0 * math.pi, 49)
    circle = np.column_stack(
        [distance + radius + radius * np.cos(turns), aside + radius * np.sin(turns)]
    )
    memory = RollingObstacleMap()
    away = turned_away(memory, np.vstack([ROOM, np.hstack([circle[:-1], circle[1:]])]))
    kept = points_from_frame(away, memory.about(away, 2.0)[0])
    away_from_robot = np.hypot(circle[:, 0], circle[:, 1])
    flank = circle[away_from_robot < away_from_robot.min() + 0.06]
    # A robot that turns about the origin meets the remembered points, less their error, no later
    # than the obstacle.
    reach = np.hypot(kept[:, 0], kept[:, 1])
    for point in flank:
        beside = np.hypot(*(kept - point).T) < 0.06
        assert beside.any()
        assert reach[beside].min() < np.hypot(*point) + memory.settings.inexact
