"""The way of the wheels, without its gaps."""

import math

import pytest

from robots.agent.safety.collision.odometry import Delay, OdometryTrack
from robots.api.geometry import Pose2D


@pytest.fixture
def track() -> OdometryTrack:
    return OdometryTrack()


def test_between_two_readings_the_way_is_interpolated_also_across_the_turn_of_the_circle(
    track: OdometryTrack,
) -> None:
    track.add(0.0, Pose2D(0.0, 0.0, math.pi - 0.1))
    track.add(1.0, Pose2D(1.0, 2.0, -math.pi + 0.1))
    assert track.at(0.5) == pytest.approx((0.5, 1.0, -math.pi))


def test_beyond_the_readings_the_nearest_counts(track: OdometryTrack) -> None:
    track.add(1.0, Pose2D(1.0, 0.0, 0.0))
    track.add(2.0, Pose2D(2.0, 0.0, 0.0))
    assert track.at(0.0) == Pose2D(1.0, 0.0, 0.0)
    assert track.at(9.0) == Pose2D(2.0, 0.0, 0.0)


def test_before_any_reading_the_robot_is_at_the_start() -> None:
    assert OdometryTrack().at(3.0) == OdometryTrack().newest() == Pose2D(0.0, 0.0, 0.0)


def test_a_jump_of_the_counters_is_removed_and_the_way_continues(track: OdometryTrack) -> None:
    track.add(0.0, Pose2D(5.0, 1.0, 1.0))
    assert track.add(0.1, Pose2D(0.0, 0.0, 0.0)) == Pose2D(5.0, 1.0, 1.0)
    moved = track.add(0.2, Pose2D(0.1, 0.0, 0.0))
    assert track.jumps == 1
    assert moved == pytest.approx((5.0 + 0.1 * math.cos(1.0), 1.0 + 0.1 * math.sin(1.0), 1.0))


def test_a_gap_in_which_the_robot_drove_is_no_jump(track: OdometryTrack) -> None:
    track.add(0.0, Pose2D(0.0, 0.0, 0.0))
    assert track.add(3.0, Pose2D(2.0, 0.0, 1.0)) == Pose2D(2.0, 0.0, 1.0)
    assert track.jumps == 0


@pytest.mark.parametrize("reading", [Pose2D(math.nan, 0.0, 0.0), Pose2D(0.0, math.inf, 0.0)])
def test_reading_that_is_not_a_number_counts_as_rest(reading: Pose2D, track: OdometryTrack) -> None:
    track.add(0.0, Pose2D(1.0, 0.0, 0.0))
    assert track.add(0.1, reading) == Pose2D(1.0, 0.0, 0.0)
    assert track.jumps == 0


def test_a_clock_that_steps_back_clears_the_past_at_the_same_place(track: OdometryTrack) -> None:
    track.add(100.0, Pose2D(1.0, 0.0, 0.0))
    track.add(50.0, Pose2D(1.05, 0.0, 0.0))
    assert track.at(50.0) == track.at(100.0) == Pose2D(1.05, 0.0, 0.0)


def test_the_delay_of_a_reading_is_beyond_that_of_the_fastest() -> None:
    delay = Delay()
    assert delay.of(100.0, 3.0) == 0.0, "the clocks differ by 97 s"
    assert delay.of(100.5, 3.9) == pytest.approx(0.4, abs=0.01)
    assert delay.of(101.0, 4.0) == pytest.approx(0.0, abs=0.01)
    assert delay.of(101.2, 4.1) == 0.0, "the fastest so far"
    assert delay.of(101.3, 4.3) == pytest.approx(0.1, abs=0.01)


def test_a_delay_that_lasts_is_forgotten_as_is_one_of_a_clock_that_steps_back() -> None:
    delay = Delay()
    delay.of(0.0, 0.0)
    found = [delay.of(now - 0.3, now) for now in (1.0, 41.0, 61.0)]
    assert found == pytest.approx([0.295, 0.095, 0.0])
    assert delay.of(10.0, 61.1) == 0.0
