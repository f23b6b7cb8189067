"""How far robots drove whose true ways are known, by states with noise, gaps, slipping wheels."""

import math

import numpy as np
import pytest
from hypothesis import given, strategies as st

from experiments.analysis.metrics.path import (
    BAND,
    WANDER,
    noise_of,
    path_travelled,
    position_steps,
    smoothed,
    steps_of,
    turned,
)
from tests.support.examples import examples

RATE = 4.0


def times(seconds):
    return np.arange(0.0, seconds, 1.0 / RATE)


def path_of(position, odometer=None, at=None, *, seen=None, trusted=None):
    n = len(position)
    at = np.arange(n) / RATE if at is None else at
    seen = np.append(np.diff(at) <= 1.0, [False]) if seen is None else seen
    trusted = np.ones(n, bool) if trusted is None else trusted
    odometer = np.full(n, np.nan) if odometer is None else odometer
    return path_travelled(position, odometer, at, seen, trusted)


def noisy(truth, sigma=0.02, seed=1):
    return truth + np.random.default_rng(seed).normal(0.0, sigma, truth.shape)


def straight(seconds=100.0, speed=0.3):
    at = times(seconds)
    return np.column_stack((speed * at, np.zeros(len(at))))


def around(radius=0.8, speed=0.3, seconds=120.0):
    angle = times(seconds) * speed / radius
    return radius * np.column_stack((np.cos(angle), np.sin(angle)))


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("sigma", [0.005, 0.02, 0.05])
def test_path_of_a_robot_at_rest_for_two_minutes_is_almost_zero(sigma, seed):
    stands = noisy(np.zeros((480, 2)), sigma, seed)
    raw = np.hypot(*np.diff(stands, axis=0).T).sum()
    assert raw > 480 * sigma
    assert path_of(stands).length < 0.02 * raw


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("speed", [0.1, 0.3, 0.6])
def test_a_straight_drive_with_noise_is_as_long_as_it_was(speed, seed):
    truth = straight(100.0, speed)
    found = path_of(noisy(truth, 0.02, seed)).length
    assert found == pytest.approx(truth[-1, 0], rel=0.02, abs=0.08)


@pytest.mark.parametrize("sigma", [0.0, 0.02])
def test_a_drive_in_circles_is_as_long_as_it_was(sigma):
    assert path_of(noisy(around(), sigma)).length == pytest.approx(0.3 * 119.75, rel=0.02)


def test_a_drive_that_stops_and_goes_is_as_long_as_it_was():
    x = np.cumsum(np.where(times(200.0) % 40.0 < 20.0, 0.3, 0.0)) / RATE
    found = path_of(noisy(np.column_stack((x, np.zeros(len(x))))))
    assert found.length == pytest.approx(x[-1], rel=0.02)


def test_a_drive_there_and_back_counts_both():
    at = times(60.0)
    x = 3.0 - np.abs(3.0 - 0.1 * at)
    assert path_of(noisy(np.column_stack((x, 0.0 * x)))).length == pytest.approx(
        6.0, abs=3 * BAND * 0.02
    )


def test_gaps_are_no_path_and_their_way_is_known_at_least():
    truth, at = straight(), times(100.0)
    kept = np.ones(len(at), bool)
    for start in (10, 25, 40, 55, 70):
        kept &= ~((at > start) & (at < start + 3.0))
    for odometer in (None, truth[kept, 0] + 5.0):
        found = path_of(truth[kept], odometer, at[kept])
        assert found.length == pytest.approx(0.3 * (99.75 - 5 * 3.0), rel=0.001)
        assert found.unseen == pytest.approx(0.3 * 5 * 3.0)
        assert (found.by_odometry, found.jumps) == (odometer is not None, 0)


def test_over_a_gap_the_wheels_know_of_a_detour_and_over_a_restart_the_straight_line():
    position = np.array([[0.0, 0.0], [0.1, 0.0], [1.0, 0.0], [1.1, 0.0]])
    at, seen = np.array([0.0, 0.25, 10.0, 10.25]), np.array([True, False, True, False])
    detour = path_of(position, np.array([0.0, 0.1, 4.0, 4.1]), at, seen=seen)
    assert (detour.length, detour.unseen) == (pytest.approx(0.2), pytest.approx(3.9))
    restart = path_of(position, np.array([7.0, 7.1, 0.0, 0.1]), at, seen=seen)
    assert (restart.length, restart.unseen) == (pytest.approx(0.2), pytest.approx(0.9))


def test_odometry_counts_whatever_the_position_trembles():
    truth = straight()
    found = path_of(noisy(truth, 0.05), truth[:, 0] + 12.0)
    assert found.by_odometry
    assert (found.length, found.slipped) == (pytest.approx(truth[-1, 0]), 0.0)


def test_wheels_that_spin_at_a_wall_drive_nowhere():
    at = times(100.0)
    wheels = 0.3 * at
    x = np.where(at < 40.0, 0.3 * at, np.where(at < 60.0, 12.0, 12.0 + 0.3 * (at - 60.0)))
    found = path_of(noisy(np.column_stack((x, 0.0 * x))), wheels)
    assert found.by_odometry
    # When the robot slips in part of five seconds, up to a third looks like noise.
    assert found.slipped == pytest.approx(6.0, abs=0.6)
    assert found.length == pytest.approx(x[-1], abs=0.6)


def test_a_robot_that_does_not_know_where_it_is_proves_no_slipping():
    wheels = 0.3 * times(100.0)
    lost = path_of(np.zeros((400, 2)), wheels, trusted=np.zeros(400, bool))
    assert (lost.length, lost.slipped) == (pytest.approx(wheels[-1]), 0.0)


def test_without_an_odometer_that_ever_turned_the_position_counts():
    truth = straight(20.0)
    for odometer in (np.zeros(80), np.full(80, np.nan)):
        found = path_of(truth, odometer)
        assert not found.by_odometry
        assert found.length == pytest.approx(truth[-1, 0], abs=0.011)


def test_repeated_position_is_one_measurement():
    stands = np.repeat(noisy(np.zeros((120, 2))), 4, axis=0)
    assert path_of(stands).length < 0.3


def test_noise_is_found_on_the_move_too():
    at = times(100.0)
    assert noise_of([(at, noisy(around(seconds=100.0)))]) == pytest.approx(0.02, rel=0.15)
    assert noise_of([(at, straight())]) == pytest.approx(0.0, abs=1e-9)
    assert noise_of([(at[:2], straight()[:2])]) == 0.0


def test_smoothing_is_the_cubic_smoothing_spline():
    """By its closed form: Green and Silverman, Nonparametric Regression (1994), section 2.1."""
    rng = np.random.default_rng(3)
    at, values = np.cumsum(rng.uniform(0.1, 0.5, 12)), rng.normal(0.0, 0.02, (12, 1))
    h = np.diff(at)
    q, r = np.zeros((12, 10)), np.zeros((10, 10))
    for column in range(10):
        a, b = h[column], h[column + 1]
        q[column : column + 3, column] = 1 / a, -1 / a - 1 / b, 1 / b
        r[column, column] = (a + b) / 3
        if column < 9:
            r[column, column + 1] = r[column + 1, column] = b / 6
    rough = q @ np.linalg.solve(r, q.T)
    expected = np.linalg.solve(np.eye(12) + 0.02**2 / WANDER * rough, values)
    assert smoothed(at, values, 0.02, WANDER) == pytest.approx(expected)


def test_turning_counts_and_a_heading_that_trembles_does_not():
    at = times(120.0)
    seen = np.append(np.ones(len(at) - 1, bool), [False])
    stands = np.random.default_rng(2).normal(0.0, 0.02, len(at))
    assert np.abs(np.diff(stands)).sum() > 8.0
    assert turned(stands, at, seen) < 0.3
    turns = 1.5 * np.sin(at / 6.0)
    truth = np.abs(np.diff(turns)).sum()
    assert turned(turns + stands, at, seen) == pytest.approx(truth, rel=0.04)


@examples(50, thorough=1000)
@given(st.lists(st.tuples(st.floats(-5, 5), st.floats(-5, 5)), min_size=1, max_size=30))
def test_a_way_is_never_shorter_than_the_straight_line_less_a_dead_band(points):
    found = steps_of(np.array(points), 0.01).sum()
    assert found >= math.dist(points[0], points[-1]) - 0.0101


@pytest.mark.parametrize("n", [0, 1, 2])
def test_no_state_one_and_two_are_a_drive(n):
    found = path_of(np.zeros((n, 2)), np.zeros(n))
    assert (found.length, found.unseen, found.jumps) == (0.0, 0.0, 0)
    assert len(position_steps(np.zeros((n, 2)), np.arange(n), np.ones(n, bool)).steps) == n
    assert BAND > 0.0
