"""Identities that every planar pose and every map transform must keep."""

import math

import pytest
from hypothesis import given, strategies as st

from robots.api.geometry import MapTransform, Pose2D, wrap_angle
from tests.support.examples import examples

metres = st.floats(-500, 500)
radians = st.floats(-20, 20)
poses = st.builds(Pose2D, metres, metres, st.floats(-math.pi, 3.14159))
transforms = st.builds(MapTransform, st.floats(0.01, 1.0), poses, st.integers(1, 4000))


def near(a: Pose2D, b: Pose2D) -> bool:
    return a.distance(b) < 1e-6 and abs(wrap_angle(a.theta - b.theta)) < 1e-9


@examples(50, thorough=1000)
@given(radians)
def test_a_wrapped_angle_is_the_same_direction_in_the_half_open_range(angle: float) -> None:
    wrapped = wrap_angle(angle)
    assert -math.pi <= wrapped < math.pi
    assert math.isclose(math.cos(wrapped), math.cos(angle), abs_tol=1e-9)
    assert math.isclose(math.sin(wrapped), math.sin(angle), abs_tol=1e-9)


@examples(50, thorough=1000)
@given(poses)
def test_a_pose_times_its_inverse_is_the_identity(pose: Pose2D) -> None:
    assert near(pose.compose(pose.inverse()), Pose2D(0.0, 0.0, 0.0))
    assert near(pose.inverse().compose(pose), Pose2D(0.0, 0.0, 0.0))


@examples(50, thorough=1000)
@given(poses, poses, poses)
def test_composition_is_associative(a: Pose2D, b: Pose2D, c: Pose2D) -> None:
    assert near(a.compose(b).compose(c), a.compose(b.compose(c)))


@examples(50, thorough=1000)
@given(poses, poses, metres, metres)
def test_applying_a_composition_is_applying_one_after_the_other(
    a: Pose2D, b: Pose2D, x: float, y: float
) -> None:
    once = a.compose(b).apply(x, y)
    twice = a.apply(*b.apply(x, y))
    assert math.dist(once, twice) < 1e-6


@examples(50, thorough=1000)
@given(transforms, metres, metres)
def test_a_point_is_recovered_from_its_pixel(transform: MapTransform, x: float, y: float) -> None:
    assert math.dist(transform.to_world(*transform.to_pixel(x, y)), (x, y)) < 1e-6


@examples(50, thorough=1000)
@given(transforms, metres, metres)
def test_a_centimetre_in_the_world_is_a_centimetre_in_the_image(
    transform: MapTransform, x: float, y: float
) -> None:
    a, b = transform.to_pixel(x, y), transform.to_pixel(x + 0.01, y)
    assert math.isclose(math.dist(a, b) * transform.resolution, 0.01, abs_tol=1e-7)


def test_the_origin_is_the_lower_left_corner_and_up_is_up() -> None:
    transform = MapTransform(0.05, Pose2D(-0.2, -0.3, 0.0), 160)
    assert transform.to_pixel(-0.2, -0.3) == pytest.approx((0.0, 160.0))
    assert transform.to_pixel(-0.2, -0.25) == pytest.approx((0.0, 159.0))
    assert transform.to_cell(-0.175, -0.275) == (159, 0)


def test_a_turned_map_turns_its_axes() -> None:
    transform = MapTransform(0.1, Pose2D(1.0, 2.0, math.pi / 2), 50)
    assert transform.to_world(0.0, 50.0) == pytest.approx((1.0, 2.0))
    assert transform.to_world(10.0, 50.0) == pytest.approx((1.0, 3.0))


@pytest.mark.parametrize(
    ("resolution", "height"), [(0.0, 10), (-0.05, 10), (math.nan, 10), (math.inf, 10), (0.05, 0)]
)
def test_a_map_without_a_scale_is_refused(resolution: float, height: int) -> None:
    with pytest.raises(ValueError, match="positive resolution"):
        MapTransform(resolution, Pose2D(0.0, 0.0, 0.0), height)
