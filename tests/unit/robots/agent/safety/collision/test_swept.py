import math

import numpy as np
import pytest
from hypothesis import given, strategies as st

from robots.agent.safety.collision.swept import arcs, distances, hull, outside, stops
from robots.api.geometry import Pose2D
from robots.api.messages import Velocity
from robots.simulator.physics.drive import WheelMotion, advance, follow
from robots.world.robot_models import GIRAFF, MODELS
from tests.support.examples import examples

SQUARE = ((-0.2, -0.2), (0.2, -0.2), (0.2, 0.2), (-0.2, 0.2))
SPEEDS = st.tuples(st.floats(-0.3, 0.7), st.floats(-0.7, 0.7))


def test_a_footprint_is_the_same_either_way_round():
    one, other = hull(SQUARE), hull(SQUARE[::-1])
    point = np.array([[0.5, 0.1]])
    assert outside(one, point) == pytest.approx(0.3)
    assert outside(other, point) == pytest.approx(0.3)
    assert one.radius == pytest.approx(0.2 * math.sqrt(2))


@pytest.mark.parametrize(
    "corners",
    [
        ((0, 0), (1, 1)),
        ((0, 0), (0, 0), (1, 1)),
        ((1, 1), (2, 1), (2, 2), (1, 2)),  # the centre lies outside
        ((-1, -1), (1, -1), (1, 1), (0, 0.5), (-1, 1)),  # the centre lies inside, a side is dented
        ((-1, -1), (1, -1), (math.nan, 1)),
    ],
)
def test_footprint_must_be_a_convex_polygon_around_the_centre(corners):
    with pytest.raises(ValueError, match="footprint"):
        hull(corners)


@pytest.mark.parametrize("series", sorted(MODELS))
@examples(40, thorough=400)
@given(SPEEDS)
def test_the_predicted_stop_is_that_of_the_simulated_base(series, speeds):
    limits = MODELS[series].limits
    pose, motion = Pose2D(0.0, 0.0, 0.0), WheelMotion(*speeds)
    for step in range(400):
        pose = advance(pose, motion, 0.01)
        if step >= 11:
            motion = follow(motion, WheelMotion(0.0, 0.0), limits, 0.01)
    x, y, theta = stops(np.array([speeds]), limits, 0.12, 8)[0, -1]
    assert math.hypot(x - pose.x, y - pose.y) < 0.01
    assert abs(theta - pose.theta) < 0.01


def test_an_arc_whose_turn_must_grow_first_bends_later():
    start = Velocity(linear=0.5, angular=0.0)
    slow, quick = (arcs(start, np.array([0.4]), rate, 2.0, 20)[0, -1] for rate in (0.4, 1e6))
    assert slow[2] == pytest.approx(0.4 * 2.0 - 0.4 / 2.0, abs=1e-6)
    assert quick[2] == pytest.approx(0.8, abs=0.03)
    assert 0.0 < slow[1] < quick[1]


@examples(60, thorough=600)
@given(
    st.builds(Pose2D, st.floats(-1, 1), st.floats(-1, 1), st.floats(-3, 3)),
    st.lists(st.tuples(st.floats(-2, 2), st.floats(-2, 2)), min_size=1, max_size=8),
    st.floats(0.0, 0.1),
)
def test_a_point_is_never_nearer_than_its_distance(pose, points, margin):
    shape, points = hull(GIRAFF.footprint), np.array(points)
    found = distances(shape, np.array([[pose]]), points, np.full((1, 8), margin))[0, 0]
    local = np.array([pose.inverse().apply(*point) for point in points])
    assert found == pytest.approx(outside(shape, local) - margin, abs=1e-5)
    corners = np.array(GIRAFF.footprint)
    ends = np.roll(corners, -1, axis=0)
    sides, offsets = ends - corners, local[:, None] - corners
    share = np.clip((offsets * sides).sum(axis=2) / (sides**2).sum(axis=1), 0, 1)
    gaps = offsets - share[:, :, None] * sides  # (points, sides, 2) to the nearest point of a side
    real = np.linalg.norm(gaps, axis=2).min(axis=1)
    assert (found + margin <= real + 1e-5).all()


def test_without_points_nothing_is_near():
    assert outside(hull(SQUARE), np.zeros((0, 2))).shape == (0,)
