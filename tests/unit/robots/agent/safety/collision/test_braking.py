"""Speeds at which the robot can stop before it touches anything."""

import math

import numpy as np
import pytest
from hypothesis import given, strategies as st

from robots.agent.ramp import ZERO
from robots.agent.safety.collision.braking import BRAKING, BrakeCheck, Hazards, stop_course
from robots.api.geometry import Pose2D
from robots.api.messages import Velocity
from robots.world.robot_models import GIRAFF, RHODON
from robots.world.sensing import points_in_frame
from tests.support.examples import examples

NONE = np.zeros((0, 2))
CHECK = BrakeCheck(np.array(GIRAFF.footprint), GIRAFF.limits)


def walker(x: float, y: float) -> Hazards:
    return Hazards(NONE, NONE, np.array([[x, y]]))


def moving(linear: float, angular: float = 0.0) -> Velocity:
    return Velocity(linear=linear, angular=angular)


def in_frame(points: np.ndarray, x: float, y: float, theta: float) -> np.ndarray:
    """Return points (n, 2) of the world in the frame of a pose."""
    return points_in_frame(Pose2D(x, y, theta), points)


def test_a_walking_person_gets_more_room_than_one_at_rest() -> None:
    at_rest = Hazards(NONE, np.array([[1.0, 0.4]]), NONE)
    share = CHECK.fastest(moving(0.3), moving(0.5), at_rest).share
    assert share > CHECK.fastest(moving(0.3), moving(0.5), walker(1.0, 0.4)).share
    left = CHECK.fastest(ZERO, moving(0.5), walker(0.5, 0.4))
    assert left == CHECK.fastest(ZERO, moving(0.3), walker(0.5, -0.4))
    assert left.why == "walker"


@examples(60, thorough=600)
@given(
    speed=st.floats(0.0, 0.6),
    wanted=st.floats(0.05, 0.6),
    turn=st.floats(-0.7, 0.7),
    at=st.tuples(st.floats(0.2, 2.0), st.floats(-1.0, 1.0)),
    heading=st.floats(-math.pi, math.pi),
)
def test_person_walking_straight_cannot_reach_the_robot_before_it_is_at_rest(
    speed: float, wanted: float, turn: float, at: tuple[float, float], heading: float
) -> None:
    """The allowed course is driven while a person walks at 1.2 m/s in any direction."""
    done = CHECK.fastest(moving(speed), moving(wanted, turn), walker(*at))
    if done.velocity == ZERO:
        return
    walk = 1.2 * np.array([math.cos(heading), math.sin(heading)])
    poses, times = stop_course(moving(speed), done.velocity, GIRAFF.limits)
    for pose, time in zip(poses[:-1], times[:-1], strict=True):
        person = np.array([at]) + walk * time
        assert float(CHECK.gaps(in_frame(person, *pose))[0]) > 0.0


@examples(40, thorough=400)
@given(
    speed=st.floats(-0.25, 0.5),
    wanted=st.floats(-0.25, 0.5),
    turn=st.floats(-1.0, 1.0),
    seed=st.integers(0, 1000),
)
def test_an_allowed_course_keeps_its_distance_from_obstacles(
    speed: float, wanted: float, turn: float, seed: int
) -> None:
    check = BrakeCheck(np.array(RHODON.footprint), RHODON.limits)
    points = np.random.default_rng(seed).uniform(-1.5, 1.5, (12, 2))
    points = points[check.gaps(points) > 0.05]
    done = check.fastest(moving(speed), moving(wanted, turn), Hazards(points, NONE, NONE))
    if done.velocity == ZERO:
        return
    for pose in stop_course(moving(speed), done.velocity, RHODON.limits)[0]:
        assert float(check.gaps(in_frame(points, *pose)).min(initial=math.inf)) > 0.015


def test_the_course_ends_at_rest_after_reaction_and_braking() -> None:
    poses, times = stop_course(moving(0.5), moving(0.5), GIRAFF.limits)
    braking = GIRAFF.limits.linear_braking
    assert times[-1] == pytest.approx(BRAKING.reaction + 0.5 / braking)
    assert poses[-1, 0] == pytest.approx(0.5 * BRAKING.reaction + 0.125 / braking, abs=0.04)
