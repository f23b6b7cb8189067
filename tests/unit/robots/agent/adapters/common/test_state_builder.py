"""States that are built from an RCA's single readings, in virtual time."""

import math

import numpy as np
import pytest

from robots.agent.adapters.common.robot_profile import BatteryRange
from robots.agent.adapters.common.state_builder import Readings
from robots.agent.control.state_validation import sound
from robots.agent.ramp import ZERO
from robots.agent.robot_interface import NOWHERE, UNKNOWN_BATTERY, ObstaclePoints
from robots.api.geometry import Pose2D
from robots.api.messages import Battery, Pose, Scan, Velocity

AHEAD = Velocity(linear=0.3, angular=0.0)
SCAN = Scan(stamp=1.0, angle_min=0.0, angle_increment=0.1, range_max=5.0, ranges=(1.0, None))


def moved_by_poses(readings, count=20, speed=0.5, turn=0.0, start=100.0):
    """Take poses every 50 ms, of a robot that reports no velocity."""
    here = Pose2D(0.0, 0.0, 0.0)
    for number in range(count):
        stamp = start + 0.05 * number
        readings.located(Pose(x=here.x, y=here.y, theta=here.theta), stamp, stamp)
        here = here.compose(Pose2D(speed * 0.05, 0.0, turn * 0.05))
    return readings


@pytest.fixture
def readings():
    return Readings()


def test_stamps_count_once_the_clocks_have_agreed_also_of_late_messages(readings):
    assert readings.believed("scan", 98.0, 100.0) == 100.0
    assert readings.believed("scan", 100.8, 101.0) == 100.8
    assert readings.believed("scan", 100.9, 103.0) == 100.9
    assert readings.believed("odometry", 100.9, 103.0) == 103.0, "its clock has not agreed"
    assert readings.believed("scan", 104.0, 103.1) == 103.1, "its clock has been set"
    assert readings.believed("scan", 102.0, 104.0) == 104.0


def test_a_simulations_clock_is_not_believed(readings):
    assert readings.believed("scan", 5.0, 100.0) == 100.0


def test_pose_is_unknown_before_the_first_reading(readings):
    state = readings.state(10.0)
    assert (state.pose, state.velocity) == (NOWHERE, ZERO)
    assert (state.odometry, state.distance) == (None, 0.0)
    assert readings.last_received_at == -math.inf


def test_velocity_and_distance_are_derived_from_poses():
    state = moved_by_poses(Readings(), speed=0.4, turn=0.2).state(0.0)
    assert state.velocity.linear == pytest.approx(0.4, abs=0.01)
    assert state.velocity.angular == pytest.approx(0.2, abs=0.01)
    assert state.distance == pytest.approx(0.4 * 0.05 * 19, abs=0.001)
    assert state.odometry is None


def test_a_pose_that_jumps_is_a_new_fix_and_no_motion():
    readings = moved_by_poses(Readings(), speed=0.0)
    readings.located(Pose(x=8.0, y=3.0, theta=1.0), 101.0, 101.0)
    state = readings.state(0.0)
    assert state.velocity == ZERO
    assert state.distance == 0.0
    assert (state.pose.x, state.pose.y) == (8.0, 3.0)


def test_an_old_fix_is_carried_on_by_the_odometry(readings):
    readings.moved(Pose2D(10.0, 0.0, 0.0), AHEAD, 100.0, 100.0)
    readings.located(Pose(x=1.0, y=2.0, theta=math.pi / 2), 100.0, 100.0)
    readings.moved(Pose2D(10.05, 0.0, 0.0), AHEAD, 100.1, 100.1)
    pose = readings.pose
    assert (pose.x, pose.y, pose.theta) == pytest.approx((1.0, 2.05, math.pi / 2))
    assert readings.velocity == AHEAD


def test_a_fix_belongs_to_the_odometry_of_its_own_moment(readings):
    for number in range(10):
        stamp = 100.0 + 0.1 * number
        readings.moved(Pose2D(0.05 * number, 0.0, 0.0), AHEAD, stamp, stamp)
    # computed late, of an earlier scan
    readings.located(Pose(x=5.0, y=0.0, theta=0.0), 100.3, 101.0)
    assert readings.pose.x == pytest.approx(5.0 + 0.05 * 6)


def test_a_transform_locates_the_odometry_in_the_map_until_localization_is_lost(readings):
    readings.moved(Pose2D(1.0, 0.0, 0.0), AHEAD, 100.0, 100.0)
    readings.corrected(Pose2D(2.0, 3.0, math.pi), 100.0)
    assert (readings.pose.x, readings.pose.y) == pytest.approx((1.0, 3.0))
    assert readings.pose.localized
    readings.lost(101.0)
    assert readings.pose == NOWHERE


def test_a_robot_without_odometry_that_lost_its_pose_counts_as_at_rest():
    readings = moved_by_poses(Readings(), speed=0.3)
    assert readings.velocity.linear > 0.2
    readings.lost(101.0)
    for _ in range(2):
        state = readings.state(101.0)
        assert state.velocity == ZERO
        assert state.is_measured


def test_a_repeated_velocity_is_not_a_measurement(readings):
    readings.moved(Pose2D(0.0, 0.0, 0.0), ZERO, 100.0, 100.0)
    readings.lost(100.0)
    assert [readings.state(100.0).is_measured for _ in range(2)] == [True, False]


def test_stamps_grow_although_clocks_step_back(readings):
    stamps = []
    for stamp in (100.0, 99.0, 99.0, 100.5):
        readings.moved(Pose2D(0.0, 0.0, 0.0), ZERO, stamp, stamp)
        stamps += [readings.state(100.0).stamp for _ in range(2)]
    assert stamps == sorted(set(stamps))


def test_a_scan_is_in_one_state(readings):
    readings.scanned(SCAN)
    assert readings.state(1.0).scan == SCAN
    assert readings.state(1.1).scan is None


def test_a_missing_charge_is_estimated_from_the_voltage():
    readings = Readings(BatteryRange(20.0, 30.0))
    readings.charged(voltage=25.0)
    assert readings.state(1.0).battery.charge == pytest.approx(0.5)
    readings.charged(voltage=35.0, charging=True)
    state = readings.state(1.1)
    assert state.battery.charge == 1.0
    assert state.charger_contact
    readings.charged(voltage=25.0, charge=0.9)
    assert readings.state(1.2).battery.charge == 0.9


def test_each_press_of_a_bumper_is_a_contact(readings):
    for touching in (False, True, True, False, True):
        readings.bumped(touching=touching)
    assert readings.state(1.0).contacts == 2


def test_bumper_bearings_are_reported_while_pressed_if_known(readings):
    assert readings.state(1.0).bumper is None
    readings.bumped(touching=True, bearings=(0.1,))
    assert [readings.state(1.1).bumper, readings.state(1.2).bumper] == [(0.1,), (0.1,)]
    readings.bumped(touching=False, bearings=())
    assert readings.state(1.3).bumper == ()


def test_echoes_and_points_are_in_one_state(readings):
    readings.echoed(0, 0.5, 1.0)
    readings.echoed(1, None, 1.0)
    readings.saw(ObstaclePoints(1.0, np.zeros((0, 2))))
    first = readings.state(1.1)
    assert [(echo.sonar, echo.distance) for echo in first.sonar] == [(0, 0.5), (1, None)]
    assert first.points is not None
    again = readings.state(1.2)
    assert (again.sonar, again.points) == ((), None)


def test_charge_is_unknown_without_a_battery_range_or_a_current_reading(readings):
    state = readings.state(1.0)
    assert (state.battery, state.charger_contact) == (UNKNOWN_BATTERY, False)
    readings.charged(voltage=25.0, charge=0.9, charging=True)
    readings.charged(voltage=25.0)
    state = readings.state(1.0)
    assert (state.battery, state.charger_contact) == (Battery(voltage=25.0, charging=None), False)


def test_a_charge_of_nan_is_unknown(readings):
    readings.charged(charge=math.nan, charging=False)
    assert sound(readings.state(1.0)).battery.charge is None


def test_odometry_keeps_its_stamp_in_repeated_states_and_after_them(readings):
    assert readings.state(1.0).odometry_stamp is None
    for stamp, now in ((9.6, 10.0), (9.7, 10.1)):
        readings.moved(Pose2D(stamp, 0.0, 0.0), None, stamp, now)
        states = readings.state(now), readings.state(now + 0.05)
        assert [state.odometry_stamp for state in states] == [stamp, stamp]
        assert [state.is_measured for state in states] == [True, False]
