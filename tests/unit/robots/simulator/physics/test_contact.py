"""Nothing passes through anything."""

import math

import numpy as np
import pytest
from hypothesis import given, strategies as st

from robots.api.geometry import Pose2D
from robots.simulator.physics.contact import Convex, Obstacles, gap, normals, place
from robots.simulator.physics.drive import WheelMotion
from robots.world.robot_models import GIRAFF, RHODON
from robots.world.sites import load_plan
from robots.world.solids import Solid, fixed_solids, leaf_solid, rectangle
from tests.support.examples import examples

PLAN, _ = load_plan("office")
OFFICE = Obstacles((*fixed_solids(PLAN), *(leaf_solid(door, "open") for door in PLAN.doors)))
GIRAFF_FOOT = np.array(GIRAFF.footprint)


def wall(x: float) -> Obstacles:
    """Return one long wall, its face at `x`, looking to -x."""
    return Obstacles((Solid("wall", "wall", rectangle(Pose2D(x + 0.1, 0.0, 0.0), 0.2, 10.0), 2.6),))


def convex(outline: np.ndarray) -> Convex:
    return Convex.of(outline, normals(outline))


def test_gap_of_squares_is_their_distance_or_their_overlap_with_its_direction() -> None:
    a, b = rectangle(Pose2D(0.0, 0.0, 0.0), 2.0, 2.0), rectangle(Pose2D(1.9, 0.0, 0.0), 2.0, 2.0)
    depth, direction = gap(convex(a), convex(b))
    assert depth == pytest.approx(-0.1)
    assert direction == pytest.approx((-1.0, 0.0))
    c = rectangle(Pose2D(3.0, 0.0, 0.0), 2.0, 2.0)
    assert gap(convex(a), convex(c))[0] == pytest.approx(1.0)


def test_driving_straight_into_a_wall_ends_at_the_wall() -> None:
    world, pose = wall(2.0), Pose2D(0.0, 0.0, 0.0)
    for _ in range(400):
        move = world.move(GIRAFF_FOOT, pose, WheelMotion(0.7, 0.0), 0.01)
        pose = move.pose
    assert pose.x + 0.32 == pytest.approx(2.0, abs=0.002)
    assert move.touched == {"wall"}
    assert move.motion.linear == pytest.approx(0.0, abs=1e-6)


def test_driving_along_a_wall_at_an_angle_slides() -> None:
    world, pose = wall(2.0), Pose2D(1.5, 0.0, math.radians(60))
    for _ in range(300):
        move = world.move(GIRAFF_FOOT, pose, WheelMotion(0.5, 0.0), 0.01)
        pose = move.pose
        assert not world.hits(place(GIRAFF_FOOT, pose))
    assert pose.y > 0.8
    assert 0.0 < move.motion.linear <= 0.5


def test_turning_beside_a_wall_pushes_away_or_stops_and_never_enters() -> None:
    world, pose = wall(2.0), Pose2D(2.0 - 0.285, 0.0, math.pi / 2)
    for _ in range(500):
        pose = world.move(GIRAFF_FOOT, pose, WheelMotion(0.0, 0.7), 0.01).pose
        assert not world.hits(place(GIRAFF_FOOT, pose))


@examples(15, thorough=150)
@given(st.integers(0, 2**32 - 1), st.sampled_from([GIRAFF, RHODON]))
def test_no_command_moves_the_robot_into_a_solid(seed: int, model: object) -> None:
    rng = np.random.default_rng(seed)
    footprint = np.array(model.footprint)
    start = PLAN.starts[int(rng.integers(len(PLAN.starts)))]
    pose = Pose2D(start.x, start.y, start.theta)
    for _ in range(12):
        motion = WheelMotion(float(rng.uniform(-1.5, 1.5)), float(rng.uniform(-2, 2)))
        for _ in range(25):
            then = OFFICE.move(footprint, pose, motion, 0.05).pose
            assert (
                then.distance(pose)
                <= (abs(motion.linear) + abs(motion.angular) * 0.4) * 0.05 * 4 + 0.01
            )
            pose = then
            assert not OFFICE.hits(place(footprint, pose))


@given(st.floats(0.5, 11.5), st.floats(0.4, 7.2), st.floats(-3.1, 3.1))
@examples(80, thorough=800)
def test_clearance_is_the_distance_to_the_nearest_of_many_points(
    x: float, y: float, theta: float
) -> None:
    outline = place(GIRAFF_FOOT, Pose2D(x, y, theta))
    if OFFICE.hits(outline):
        return
    share = np.linspace(0, 1, 60)[:, None, None]
    sides = OFFICE.segments
    points = (sides[None, :, :2] * (1 - share) + sides[None, :, 2:] * share).reshape(-1, 2)
    own = (outline[None] * (1 - share) + np.roll(outline, -1, axis=0)[None] * share).reshape(-1, 2)
    near = points[np.argsort(np.hypot(points[:, 0] - x, points[:, 1] - y))[:400]]
    brute = float(
        np.hypot(near[:, None, 0] - own[None, :, 0], near[:, None, 1] - own[None, :, 1]).min()
    )
    exact = OFFICE.clearance(outline)
    assert exact <= brute + 1e-9
    assert brute - exact < 0.06


def test_an_empty_world_is_infinitely_clear() -> None:
    assert Obstacles(()).clearance(GIRAFF_FOOT) == math.inf
    assert Obstacles(()).move(
        GIRAFF_FOOT, Pose2D(0, 0, 0), WheelMotion(0.5, 0), 0.1
    ).pose.x == pytest.approx(0.05)
