"""Messages of ROS 1 and ROS 2 as JSON, valid and malformed."""

import math

import pytest
from hypothesis import given, strategies as st

from robots.agent.adapters.ros import messages
from robots.api.geometry import Pose2D
from robots.api.messages import Velocity
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
def test_a_pose_is_converted_and_read_back(x, y, theta):
    assert messages.pose_in(messages.pose(Pose2D(x, y, theta))) == pytest.approx(
        (x, y, theta), abs=1e-9
    )


@pytest.mark.parametrize("version", [1, 2])
def test_a_stamp_is_converted_and_read_back_in_both_versions(version):
    header = messages.header("map", 1_700_000_000.25, version)
    assert messages.stamp_in({"header": header}, 0.0) == pytest.approx(1_700_000_000.25, abs=1e-6)
    assert set(header["stamp"]) == ({"secs", "nsecs"} if version == 1 else {"sec", "nanosec"})


def test_a_message_without_a_stamp_has_the_time_of_its_arrival():
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


def test_the_score_of_a_fix_falls_with_its_variance():
    def fix(variance):
        covariance = [variance, *[0.0] * 6, variance, *[0.0] * 28]
        return messages.fix_in({"pose": {"pose": HERE, "covariance": covariance}})

    assert fix(0.001).score > 0.98
    assert fix(0.001).localized
    assert not fix(1.0).localized
    assert fix(0.04).score > fix(0.2).score


def test_ranges_without_an_echo_are_none():
    scan = messages.scan_in(laser(), 3.0)
    assert scan.ranges == (1.0, None, None, None, 2.0)
    assert (scan.stamp, scan.angle_min, scan.angle_increment) == (3.0, -1.0, 0.5)
    assert scan.range_max == 8.0


def test_a_scan_of_an_inverted_laser_is_turned_round():
    scan = messages.scan_in(laser(angle_min=1.0, angle_increment=-0.5), 3.0)
    assert scan.ranges == (2.0, None, None, None, 1.0)
    assert (scan.angle_min, scan.angle_increment) == (-1.0, 0.5)


def test_too_many_beams_are_thinned_out():
    scan = messages.scan_in(laser(ranges=[1.0] * 5000, angle_increment=0.001), 3.0)
    assert len(scan.ranges) <= 2000
    assert scan.angle_increment * (len(scan.ranges) - 1) == pytest.approx(5.0, abs=0.01)


def test_only_the_transform_of_both_frames_is_read():
    transform = {"translation": {"x": 1.0, "y": 2.0}, "rotation": QUARTER}
    entry = {"header": {"frame_id": "/map"}, "child_frame_id": "odom", "transform": transform}
    found = messages.transform_in({"transforms": [entry]}, "map", "odom")
    assert found == pytest.approx((1.0, 2.0, math.pi / 2))
    assert messages.transform_in({"transforms": [entry]}, "map", "base") is None


def test_a_joint_is_found_by_its_name():
    assert messages.joint_in({"name": ["a", "b"], "position": [0.1, 0.2]}, "b") == 0.2
    assert messages.joint_in({"name": ["a"], "position": []}, "a") is None


@pytest.mark.parametrize("message", [{}, {"data": None}, {"data": 1}, {"data": "true"}])
def test_a_bool_is_true_or_false_and_nothing_else(message):
    assert [messages.flag_in({"data": value}) for value in (True, False)] == [True, False]
    with pytest.raises(messages.RosError, match="not true or false"):
        messages.flag_in(message)


KEYS = st.sampled_from(["pose", "ranges", "header", "x", "transforms", "angle_min"])
JSON = st.recursive(
    st.none() | st.booleans() | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(KEYS, inner),
)
FIELDS = KEYS | st.sampled_from(["twist", "angle_increment", "range_max"])


@examples(60, thorough=600)
@given(st.dictionaries(FIELDS, JSON))
def test_a_malformed_message_raises_only_a_ros_error(message):
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
    ("volts", "percentage", "status", "known"),
    [
        (24.5, 0.5, 1, (24.5, 0.5, True)),
        (24.5, 50.0, 0, (24.5, 0.5, None)),
        (None, math.nan, 0, (None, None, None)),
        (math.nan, math.nan, 0, (None, None, None)),
        (0.0, -1.0, 0, (None, None, None)),
        (25.0, 0.0, 2, (25.0, 0.0, False)),
        (25.0, 100.0, 4, (25.0, 1.0, True)),
    ],
)
def test_a_battery_counts_to_one_or_a_hundred_or_is_unknown(volts, percentage, status, known):
    battery = messages.battery_in(
        {"voltage": volts, "percentage": percentage, "power_supply_status": status}
    )
    assert (battery.voltage, battery.charge, battery.charging) == known
