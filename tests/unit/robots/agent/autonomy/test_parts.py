"""Pose extrapolation, and the messages to and from the navigation process."""

import math

import numpy as np
import pytest
from hypothesis import given, seed, strategies as st

from robots.agent.autonomy import wire
from robots.agent.autonomy.__main__ import Conversation, frames
from robots.agent.autonomy.area import update_of
from robots.agent.autonomy.pose_extrapolator import STALE, PoseExtrapolator
from robots.agent.autonomy.sensor_snapshot import Body, NavigationOutput, SensorSnapshot
from robots.agent.robot_interface import NOWHERE
from robots.api.geometry import Pose2D
from robots.api.messages import Goto, Laser, Scan, Velocity
from robots.process import framing
from robots.world.robot_models import model_of
from robots.world.sensing import LaserScan, beams_of
from robots.world.sites import load_site

GIRAFF = model_of("giraff")
AHEAD = Velocity(linear=0.5, angular=0.0)
COVARIANCE = (0.01, 0.0, 0.0, 0.01, 0.0, 0.001)


def output(**fields):
    values = {"pose": Pose2D(2.0, 3.0, 1.0), "odometry": Pose2D(10.0, -4.0, 0.5), "stamp": 5.0}
    values |= {"covariance": COVARIANCE, "score": 0.9, "localized": True} | fields
    return NavigationOutput(**values)


def wall(distance, stamp=1.0):
    """A sweep of a laser in the robot's centre that sees a wall `distance` ahead."""
    angles = np.linspace(-1.0, 1.0, 81)
    return LaserScan(stamp, -1.0, 2.0 / 80, 10.0, distance / np.cos(angles))


# --- poses ----------------------------------------------------------------------------------------


def test_the_pose_is_unknown_before_the_first_output():
    assert PoseExtrapolator().pose(Pose2D(1.0, 2.0, 3.0), 0.0) == NOWHERE


@seed(5)
@given(
    st.tuples(*[st.floats(-50.0, 50.0)] * 2, st.floats(-3.0, 3.0)),
    st.tuples(*[st.floats(-1.0, 1.0)] * 3),
)
def test_between_two_outputs_the_pose_moves_with_the_odometry(before, moved):
    poses = PoseExtrapolator()
    odometry, step = Pose2D(*before), Pose2D(*moved)
    poses.take(output(odometry=odometry), 0.0)
    expected = Pose2D(2.0, 3.0, 1.0).compose(step)
    found = poses.pose(odometry.compose(step), 0.1)
    assert math.hypot(found.x - expected.x, found.y - expected.y) < 1e-6
    assert math.cos(found.theta - expected.theta) > 1.0 - 1e-9
    assert found.localized
    assert found.score == 0.9


def test_a_stale_pose_is_not_localized():
    poses = PoseExtrapolator()
    poses.take(output(), 0.0)
    late = poses.pose(Pose2D(10.0, -4.0, 0.5), STALE + 0.1)
    assert (late.localized, late.score) == (False, 0.0)
    assert (late.x, late.y) == pytest.approx((2.0, 3.0))


def test_infinite_variances_become_finite():
    poses = PoseExtrapolator()
    poses.take(output(covariance=(math.inf,) * 6, localized=False, score=1.5), 0.0)
    pose = poses.pose(Pose2D(0.0, 0.0, 0.0), 0.0)
    assert all(math.isfinite(value) for value in pose.covariance)
    assert pose.score == 1.0


# --- messages -------------------------------------------------------------------------------------


def test_beams_without_an_echo_are_infinite():
    scan = Scan(
        stamp=2.0, angle_min=-1.0, angle_increment=0.5, range_max=8.0, ranges=(1.0, None, 3.0)
    )
    beams = beams_of(scan, Laser(x=0.2, y=0.1, theta=0.3))
    assert beams.ranges.tolist() == [1.0, math.inf, 3.0]
    assert beams.mount == Pose2D(0.2, 0.1, 0.3)


def snapshot(**fields):
    values = {"stamp": 1.0, "odometry": Pose2D(1.0, 2.0, 0.3), "velocity": AHEAD}
    values |= {"beams": wall(1.5), "points": np.array([[1.0, 2.0], [3.0, 4.0]])}
    return SensorSnapshot(**values | fields)


def test_a_snapshot_is_packed_and_unpacked():
    sent = snapshot(charger_contact=True)
    message = frames(bytearray(framing.pack(wire.perceive(sent, new=True))))[0]
    got = wire.perceived(message, wire.beams_in(message.sweep))
    for name in ("stamp", "odometry", "velocity", "charger_contact"):
        assert getattr(got, name) == getattr(sent, name)
    assert np.allclose(got.points, sent.points)
    assert np.allclose(got.beams.ranges, sent.beams.ranges, atol=1e-5)
    assert wire.perceive(sent, new=False).sweep is None


def test_invalid_message_is_refused():
    with pytest.raises(framing.WireError):
        frames(bytearray(b"\x00\x00\x00\x02{}"))
    with pytest.raises(framing.WireError):
        frames(bytearray(b"\xff\xff\xff\xff"))
    with pytest.raises(framing.WireError):
        wire.unpack_answer(b"\x01")
    broken = wire.Perceive(
        1.0, Pose2D(0.0, 0.0, 0.0), AHEAD, charger_contact=False, sweep=None, points=b"123"
    )
    with pytest.raises(framing.WireError):
        wire.perceived(broken, None)


def settle():
    body = Body("giraff", GIRAFF.footprint, GIRAFF.limits)
    return wire.Settle(body, update_of(load_site("office")), 1)


def test_a_process_that_fell_behind_computes_only_the_newest_snapshot():
    answers = []
    conversation = Conversation(answers.append)
    conversation.take([settle()])
    conversation.take([wire.perceive(snapshot(stamp=float(n)), new=n == 1) for n in range(1, 6)])
    assert [type(answer) for answer in answers] == [wire.Settled, wire.NodeOutput]
    assert answers[0].problem == ""
    assert answers[1].output.stamp == 5.0


def test_a_process_without_a_map_refuses_actions():
    answers = []
    goto = Goto(action_id="g", stamp=0.0, x=0.0, y=0.0)
    Conversation(answers.append).take(
        [
            wire.perceive(snapshot(), new=True),
            wire.CancelAction("a"),
            wire.BeginAction(7, goto),
        ]
    )
    assert answers == [wire.OrderReply(7, "no map")]
