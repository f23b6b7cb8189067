"""Messages of ROS as JSON, of both generations, whole and broken."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robots.agent.adapters.ros import messages
from robots.agent.robot_interface import UNKNOWN_BATTERY
from robots.api.geometry import Pose2D
from robots.api.messages import Battery, Velocity
from tests.support.examples import examples

QUARTER = {"x": 0.0, "y": 0.0, "z": math.sin(math.pi / 4), "w": math.cos(math.pi / 4)}
HERE = {"position": {"x": 1.0, "y": 2.0, "z": 0.0}, "orientation": QUARTER}


def laser(**fields):
    return {
        "angle_min": -1.0,
        "angle_increment": 0.5,
        "range_min": 0.1,
        "range_max": 8.0,
        "ranges": [1.0, None, 0.05, 8.0, 2.0],
    } | fields


@given(st.floats(-50, 50), st.floats(-50, 50), st.floats(-3.1, 3.1))
def test_a_pose_on_the_floor_comes_back(x, y, theta):
    assert messages.pose_in(messages.pose(Pose2D(x, y, theta))) == pytest.approx(
        (x, y, theta), abs=1e-9
    )


@pytest.mark.parametrize("version", [1, 2])
def test_a_stamp_comes_back_in_both_generations(version):
    header = messages.header("map", 1_700_000_000.25, version)
    assert messages.stamp_in({"header": header}, 0.0) == pytest.approx(1_700_000_000.25, abs=1e-6)
    assert set(header["stamp"]) == ({"secs", "nsecs"} if version == 1 else {"sec", "nanosec"})


def test_without_a_stamp_the_arrival_counts():
    assert messages.stamp_in({}, 5.0) == 5.0
    assert messages.stamp_in({"header": {"stamp": {"sec": 0, "nanosec": 0}}}, 5.0) == 5.0


def test_odometry_is_read():
    message = {
        "pose": {"pose": HERE},
        "twist": {"twist": {"linear": {"x": 0.5}, "angular": {"z": -0.1}}},
    }
    here, velocity = messages.odometry_in(message)
    assert here == pytest.approx((1.0, 2.0, math.pi / 2))
    assert velocity == Velocity(linear=0.5, angular=-0.1)


def test_how_wide_a_fix_is_says_how_far_to_trust_it():
    def fix(variance):
        covariance = [0.0] * 36
        covariance[0] = covariance[7] = variance
        return messages.fix_in({"pose": {"pose": HERE, "covariance": covariance}})

    assert fix(0.001).score > 0.98
    assert fix(0.001).localized
    assert not fix(1.0).localized
    assert fix(0.04).score > fix(0.2).score


def test_a_scan_keeps_what_came_back():
    scan = messages.scan_in(laser(), 3.0)
    assert scan.ranges == (1.0, None, None, None, 2.0)
    assert (scan.stamp, scan.angle_min, scan.angle_increment, scan.range_max) == (
        3.0,
        -1.0,
        0.5,
        8.0,
    )


def test_a_laser_that_hangs_upside_down_is_turned_round():
    scan = messages.scan_in(laser(angle_min=1.0, angle_increment=-0.5), 3.0)
    assert scan.ranges == (2.0, None, None, None, 1.0)
    assert (scan.angle_min, scan.angle_increment) == (-1.0, 0.5)


def test_of_too_many_beams_every_so_many_are_kept():
    scan = messages.scan_in(laser(ranges=[1.0] * 5000, angle_increment=0.001), 3.0)
    assert len(scan.ranges) <= 2000
    assert scan.angle_increment * (len(scan.ranges) - 1) == pytest.approx(5.0, abs=0.01)


def test_a_battery_may_count_to_one_or_to_a_hundred_or_not_at_all():
    assert messages.battery_in(
        {"voltage": 24.5, "percentage": 0.5, "power_supply_status": 1}
    ) == Battery(voltage=24.5, charge=0.5, charging=True)
    assert messages.battery_in({"voltage": 24.5, "percentage": 50.0}).charge == 0.5
    assert messages.battery_in({"voltage": None, "percentage": float("nan")}) == UNKNOWN_BATTERY


def test_a_transform_of_others_is_none_of_ours():
    entry = {
        "header": {"frame_id": "/map"},
        "child_frame_id": "odom",
        "transform": {"translation": {"x": 1.0, "y": 2.0}, "rotation": QUARTER},
    }
    assert messages.transform_in({"transforms": [entry]}, "map", "odom") == pytest.approx(
        (1.0, 2.0, math.pi / 2)
    )
    assert messages.transform_in({"transforms": [entry]}, "map", "base") is None


def test_a_joint_is_found_by_its_name():
    assert messages.joint_in({"name": ["a", "b"], "position": [0.1, 0.2]}, "b") == 0.2
    assert messages.joint_in({"name": ["a"], "position": []}, "a") is None


json = st.recursive(
    st.none() | st.booleans() | st.floats() | st.text(max_size=5),
    lambda inner: (
        st.lists(inner, max_size=3)
        | st.dictionaries(
            st.sampled_from(["pose", "ranges", "header", "x", "transforms", "angle_min"]), inner
        )
    ),
)


# a busy computer is slow at everything
@examples(60, thorough=600)
@given(
    st.dictionaries(
        st.sampled_from(
            ["pose", "twist", "ranges", "angle_min", "angle_increment", "range_max", "transforms"]
        ),
        json,
    )
)
def test_nonsense_is_refused_and_nothing_else(message):
    for read in (
        messages.odometry_in,
        messages.fix_in,
        lambda m: messages.scan_in(m, 0.0),
        lambda m: messages.transform_in(m, "map", "odom"),
    ):
        try:
            read(message)
        except messages.RosError:
            continue


@pytest.mark.parametrize(
    ("message", "known"),
    [
        (
            {"voltage": math.nan, "percentage": math.nan, "power_supply_status": 0},
            (None, None, None),
        ),
        ({"voltage": 0.0, "percentage": -1.0, "power_supply_status": 0}, (None, None, None)),
        ({"voltage": 25.0, "percentage": 0.0, "power_supply_status": 2}, (25.0, 0.0, False)),
        ({"voltage": 25.0, "percentage": 100.0, "power_supply_status": 4}, (25.0, 1.0, True)),
    ],
)
def test_readings_that_a_battery_lacks_are_unknown(message, known):
    battery = messages.battery_in(message)
    assert (battery.voltage, battery.charge, battery.charging) == known
