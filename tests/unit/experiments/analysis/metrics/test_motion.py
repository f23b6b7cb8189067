"""What a robot did, from states that were made for the purpose."""

import math

import numpy as np
import pytest

from experiments.analysis.metrics.motion import drive
from experiments.dataset.columns import columns_of
from experiments.dataset.states import STATES
from experiments.dataset.trajectory import Trajectory


def track(seconds=None, **given):
    n = len(next(iter(given.values())))
    stamps = np.arange(n) * 0.25 if seconds is None else np.array(seconds)
    plain = {
        "clock_offset": np.zeros(n),
        "boot": np.zeros(n),
        "x": np.zeros(n),
        "y": np.zeros(n),
        "theta": np.zeros(n),
        "linear": np.zeros(n),
        "angular": np.zeros(n),
    }
    return Trajectory.of(columns_of(STATES, stamp=stamps, **(plain | given)))


def test_a_position_that_trembles_by_less_than_a_centimetre_is_no_way():
    x = np.random.default_rng(1).uniform(-0.004, 0.004, 400)
    assert drive(track(x=x))["path"] == 0.0


def test_a_slow_drive_is_a_way_although_each_step_is_below_the_dead_band():
    assert drive(track(x=np.linspace(0.0, 1.0, 401)))["path"] == pytest.approx(1.0, abs=0.01)


def test_a_robot_that_finds_itself_elsewhere_did_not_drive_there():
    found = drive(track(x=np.array([0.0, 0.1, 5.1, 5.2])))
    assert (found["path"], found["jumps"]) == (pytest.approx(0.2), 1)


def test_turning_counts_to_both_sides_and_across_the_back():
    theta = np.concatenate((np.linspace(3.0, 4.0, 21), np.linspace(4.0, 3.0, 21)))
    wrapped = (theta + math.pi) % (2 * math.pi) - math.pi
    assert drive(track(theta=wrapped))["rotation"] == pytest.approx(2.0, abs=0.02)


def test_a_stop_is_a_second_of_standing_after_having_gone():
    speed = (
        [0.0] * 8
        + [0.3] * 8
        + [0.0] * 3
        + [0.3] * 8
        + [0.0] * 6
        + [0.03] * 4
        + [0.0] * 8
        + [0.3] * 4
    )
    assert drive(track(linear=np.array(speed)))["stops"] == 1


def test_standstill_interrupted_by_a_gap_is_no_stop():
    seconds = [0.0, 0.25, 0.5, 0.75, 9.0, 9.25, 9.5, 9.75, 10.0]
    speed = np.array([0.3, 0.3, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    assert drive(track(seconds[:6], linear=speed[:6]))["stops"] == 0
    assert drive(track(seconds, linear=speed))["stops"] == 1, "a second was seen after the gap"


def test_a_robot_in_its_station_is_near_no_collision():
    clearance = np.array([0.05] * 8 + [0.15] * 2 + [0.5] * 4 + [0.1] * 2 + [0.5] + [0.15, 0.05])
    docked = np.array([1.0] * 8 + [0.0] * 10 + [1.0])
    found = drive(track(clearance=clearance, docked=docked))
    assert (found["near_collisions"], found["near_seconds"]) == (1, 0.5)
    docked = drive(track(clearance=np.full(40, 0.05), docked=np.ones(40)))
    assert (docked["near_collisions"], docked["near_seconds"]) == (0, 0.0)


def test_a_near_collision_ends_only_when_the_way_is_clear_again():
    clearance = np.array([1.0, 0.19, 0.22, 0.19, np.nan, 0.26, 0.3, 0.1, 0.3, 0.3])
    found = drive(track(clearance=clearance))
    assert (found["near_collisions"], found["least_clearance"]) == (2, 0.1)
    assert found["near_seconds"] == pytest.approx(5 * 0.25)


def test_a_drive_that_begins_near_something_counts_it_once():
    assert drive(track(clearance=np.array([0.1, 0.1, 0.5])))["near_collisions"] == 1
    assert drive(track(clearance=np.array([np.nan, 0.1, 0.5])))["near_collisions"] == 1


def test_metrics_that_a_robot_cannot_measure_are_missing_and_not_0():
    found = drive(track(clearance=np.full(3, np.nan), localized=np.zeros(3)))
    assert set(found) == {"idle", "stops", "collisions"}
    found = drive(track(distance=np.arange(3.0), localized=np.zeros(3)))
    assert (found["path"], "rotation" in found) == (2.0, False)
    found = drive(track(localized=np.ones(3)))
    assert (found["path"], "slipped" in found) == (0.0, False)


def test_a_gap_between_states_is_time_of_nothing():
    found = track([0.0, 0.25, 0.5, 10.0, 10.25], linear=np.full(5, 0.3))
    assert found.gaps().tolist() == [9.5]
    assert found.lasts.sum() == pytest.approx(0.75)
    assert found.rate() == pytest.approx(4 / 10.25)


def test_two_runs_of_an_agent_are_not_one_drive():
    found = track(
        [0.0, 0.25, 0.3, 0.55], boot=np.array([0.0, 0.0, 1.0, 1.0]), linear=np.full(4, 0.3)
    )
    assert found.lasts.sum() == pytest.approx(0.5)


def test_the_way_over_a_gap_is_neither_path_nor_time_but_known_at_least():
    stamps = np.delete(np.arange(0.0, 60.0, 0.25), np.arange(100, 112))
    for odometer in ({"distance": 0.4 * stamps}, {}):
        found = drive(track(stamps, x=0.4 * stamps, linear=np.full(len(stamps), 0.4), **odometer))
        assert found["speed"] == pytest.approx(0.4, rel=0.001)
        assert found["path"] == pytest.approx(0.4 * (len(stamps) - 2) * 0.25, rel=0.001)
        assert found["path_unseen"] == pytest.approx(0.4 * 3.25)
        assert found["path_by_odometry"] == bool(odometer)


def test_the_share_of_time_that_was_seen_is_less_by_the_gaps():
    stamps = np.concatenate([np.arange(0.0, 17.01, 0.25) + 20.0 * n for n in range(5)])
    found = track(stamps, linear=np.full(len(stamps), 0.3))
    assert found.share_seen(97.0) == pytest.approx(85.0 / 97.0)
    assert found.between(20.0, 37.0).share_seen(17.0) == 1.0
    assert found.between(36.0, 41.0).share_seen(5.0) == pytest.approx(2.0 / 5.0)
    assert found.between(17.5, 19.5).share_seen(2.0) == 0.0
    assert math.isnan(found.share_seen(0.0))


def test_a_part_of_a_drive_ends_with_its_last_state():
    stamps = np.arange(0.0, 10.0, 0.25)
    part = track(stamps, x=0.3 * stamps).between(2.0, 4.0)
    found = drive(part)
    assert (part.lasts.sum(), found["path"]) == (pytest.approx(2.0), pytest.approx(0.6))
    assert found["speed"] == pytest.approx(0.3)


def test_holes_in_the_numbers_of_states_are_missing_states():
    seq = np.array([7.0, 8.0, 11.0, 12.0, 0.0, 1.0, 3.0])
    boot = np.array([0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0])
    assert track(seq=seq, boot=boot).missing() == 3
    assert track(seq=np.array([0.0, 1.0, 5e6])).missing() == 0
    assert track(seq=np.array([4.0, 4.0, 3.0])).missing() == 0


def test_standing_and_moving_fill_the_time():
    speed, turning = np.array([0.0, 0.3, 0.3, 0.0, 0.0]), np.array([0.0, 0.0, 0.0, 0.5, 0.0])
    x = np.array([0.0, 0.0, 0.075, 0.15, 0.15])
    found = drive(track(x=x, linear=speed, angular=turning))
    assert found["idle"] == pytest.approx(0.25)
    assert found["moving_speed"] == pytest.approx(0.15 / 0.75)
    assert found["speed"] == pytest.approx(0.15 / 1.0)


def test_time_is_that_of_the_servers_clock():
    found = Trajectory.of(
        columns_of(STATES, stamp=[7.0, 7.25], clock_offset=[2.0, 2.0], boot=[0.0, 0.0])
    )
    assert found.at.tolist() == [5.0, 5.25]
    assert len(found.between(5.1, math.nan)) == 1


@pytest.mark.parametrize("n", [0, 1])
def test_no_state_and_one_state_are_a_track(n):
    found = track(x=np.zeros(n))
    about = drive(found)
    assert (about.get("path"), about["stops"]) == (0.0 if n else None, 0)
    assert math.isnan(found.rate())
    assert math.isnan(about.get("speed", math.nan))
