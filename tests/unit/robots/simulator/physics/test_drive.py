"""Speeds follow commands within the limits, poses follow speeds."""

import math

import numpy as np
from hypothesis import given, strategies as st

from robots.api.geometry import Pose2D, wrap_angle
from robots.simulator.physics.drive import (
    STILL,
    WheelMotion,
    advance,
    approach,
    clamp,
    follow,
    slip,
)
from robots.world.robot_models import GIRAFF
from tests.support.examples import examples

LIMITS = GIRAFF.limits
speeds = st.floats(-3, 3)
steps = st.floats(0.001, 0.2)


@examples(50, thorough=1000)
@given(speeds, speeds, steps)
def test_no_speed_changes_faster_than_accelerating_or_braking_allows(
    now: float, wanted: float, dt: float
) -> None:
    then = approach(now, wanted, 0.2, 0.8, dt)
    assert abs(then - now) <= 0.8 * dt + 1e-12
    if abs(then) > abs(now) and now * then >= 0.0:
        assert abs(then) - abs(now) <= 0.2 * dt + 1e-12


@examples(50, thorough=1000)
@given(speeds, speeds, steps)
def test_a_speed_never_overshoots_its_target(now: float, wanted: float, dt: float) -> None:
    then = approach(now, wanted, 0.2, 0.8, dt)
    assert min(now, wanted) - 1e-12 <= then <= max(now, wanted) + 1e-12


@examples(50, thorough=1000)
@given(speeds, speeds)
def test_every_target_is_reached_in_the_end(now: float, wanted: float) -> None:
    for _ in range(3000):
        now = approach(now, wanted, 0.2, 0.8, 0.02)
    assert math.isclose(now, wanted, abs_tol=1e-9)


@examples(50, thorough=1000)
@given(speeds, speeds, speeds, speeds)
def test_the_base_never_goes_faster_than_its_profile(
    v: float, w: float, wanted_v: float, wanted_w: float
) -> None:
    motion = clamp(WheelMotion(v, w), LIMITS)
    for _ in range(50):
        motion = follow(motion, WheelMotion(wanted_v, wanted_w), LIMITS, 0.05)
        assert -LIMITS.reverse - 1e-9 <= motion.linear <= LIMITS.linear + 1e-9
        assert abs(motion.angular) <= LIMITS.angular + 1e-9


def test_braking_from_full_speed_takes_half_its_square_over_the_braking() -> None:
    motion, travelled = WheelMotion(0.7, 0.0), 0.0
    while motion != STILL:
        motion = follow(motion, STILL, LIMITS, 0.001)
        travelled += motion.linear * 0.001
    assert math.isclose(travelled, 0.7**2 / (2.0 * LIMITS.linear_braking), rel_tol=0.01)


@examples(50, thorough=1000)
@given(speeds, st.floats(-2, 2), st.integers(1, 40))
def test_an_arc_is_the_sum_of_its_parts(v: float, w: float, parts: int) -> None:
    whole = advance(Pose2D(1.0, 2.0, 0.5), WheelMotion(v, w), 1.0)
    pose = Pose2D(1.0, 2.0, 0.5)
    for _ in range(parts):
        pose = advance(pose, WheelMotion(v, w), 1.0 / parts)
    assert pose.distance(whole) < 1e-6
    assert abs(wrap_angle(pose.theta - whole.theta)) < 1e-6


def test_wheels_without_noise_do_not_slip_but_draw_random_numbers() -> None:
    one, other = np.random.default_rng(5), np.random.default_rng(5)
    assert slip(WheelMotion(0.5, 0.1), 0.467, 0.0, 0.01, one) == WheelMotion(0.5, 0.1)
    assert slip(WheelMotion(0.5, 0.1), 0.467, 0.05, 0.01, other) != WheelMotion(0.5, 0.1)
    assert one.standard_normal() == other.standard_normal()


def test_slip_grows_with_the_root_of_the_way() -> None:
    rng = np.random.default_rng(7)
    ends = [
        sum(slip(WheelMotion(0.5, 0.0), 0.467, 0.05, 0.02, rng).linear * 0.02 for _ in range(100))
        for _ in range(300)
    ]
    assert abs(np.mean(ends) - 1.0) < 0.01
    assert 0.02 < np.std(ends) < 0.05  # 0.05 a wheel and metre, two independent wheels: 0.035
