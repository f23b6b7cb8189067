"""What may be touched before the robot stands."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robots.agent.ramp import ZERO
from robots.agent.safety.collision.braking import BRAKING, BrakeCheck, Hazards, stop_course
from robots.api.messages import Velocity
from robots.world.robot_models import GIRAFF, RHODON
from tests.support.examples import examples

NONE = np.zeros((0, 2))
CHECK = BrakeCheck(np.array(GIRAFF.footprint), GIRAFF.limits)
NOSE = max(x for x, _ in GIRAFF.footprint)


def thing(x: float, y: float) -> Hazards:
    return Hazards(np.array([[x, y]]), NONE, NONE)


def walker(x: float, y: float) -> Hazards:
    return Hazards(NONE, NONE, np.array([[x, y]]))


def moving(linear: float, angular: float = 0.0) -> Velocity:
    return Velocity(linear=linear, angular=angular)


def test_with_nothing_about_the_wish_is_granted() -> None:
    assert CHECK.fastest(ZERO, moving(0.5, 0.2), Hazards(NONE, NONE, NONE)).velocity == moving(
        0.5, 0.2
    )


def test_a_wall_ahead_stops_the_robot_and_one_behind_does_not() -> None:
    assert CHECK.fastest(moving(0.1), moving(0.5), thing(NOSE + 0.03, 0.0)) == CHECK.fastest(
        ZERO, moving(0.5), thing(NOSE + 0.01, 0.0)
    )
    assert CHECK.fastest(moving(0.1), moving(0.5), thing(NOSE + 0.03, 0.0)).velocity == ZERO
    assert CHECK.fastest(moving(0.1), moving(0.5), thing(-NOSE - 0.03, 0.0)).velocity == moving(0.5)


def test_the_nearer_the_wall_the_slower() -> None:
    speeds = [
        CHECK.fastest(moving(0.5), moving(0.6), thing(NOSE + gap, 0.0)).velocity.linear
        for gap in (0.05, 0.15, 0.3, 0.6, 1.0)
    ]
    assert speeds == sorted(speeds)
    assert speeds[0] < 0.1
    assert speeds[-1] == 0.6


def test_robot_may_leave_a_contact_but_not_press_it() -> None:
    assert CHECK.fastest(ZERO, moving(-0.2), thing(NOSE + 0.002, 0.0)).velocity == moving(-0.2)
    assert CHECK.fastest(ZERO, moving(0.05), thing(NOSE + 0.002, 0.0)).velocity == ZERO


def test_a_turn_beside_a_wall_is_held_where_a_corner_would_touch_it() -> None:
    side = max(y for _, y in GIRAFF.footprint)
    wall = Hazards(
        np.column_stack([np.linspace(-0.5, 0.5, 41), np.full(41, side + 0.012)]), NONE, NONE
    )
    assert CHECK.fastest(ZERO, moving(0.0, 0.5), wall).velocity == ZERO
    assert CHECK.fastest(ZERO, moving(0.3), wall).velocity.linear > 0.0


def test_walking_person_gets_more_room_than_a_standing_one() -> None:
    standing = Hazards(NONE, np.array([[1.0, 0.4]]), NONE)
    assert (
        CHECK.fastest(moving(0.3), moving(0.5), standing).share
        > CHECK.fastest(moving(0.3), moving(0.5), walker(1.0, 0.4)).share
    )
    assert CHECK.fastest(ZERO, moving(0.5), walker(0.5, 0.4)) == CHECK.fastest(
        ZERO, moving(0.3), walker(0.5, -0.4)
    )
    assert CHECK.fastest(ZERO, moving(0.5), walker(0.5, 0.4)).why == "walker"


@examples(60, thorough=600)
@given(
    speed=st.floats(0.0, 0.6),
    wanted=st.floats(0.05, 0.6),
    turn=st.floats(-0.7, 0.7),
    at=st.tuples(st.floats(0.2, 2.0), st.floats(-1.0, 1.0)),
    way=st.floats(-math.pi, math.pi),
)
def test_person_walking_straight_cannot_reach_the_robot_before_it_stands(
    speed: float, wanted: float, turn: float, at: tuple[float, float], way: float
) -> None:
    """The allowed course is driven against somebody who walks at 1.2 m/s in any direction."""
    x, y = at
    hazards = walker(x, y)
    done = CHECK.fastest(moving(speed), moving(wanted, turn), hazards)
    if done.velocity == ZERO:
        return
    poses, times = stop_course(moving(speed), done.velocity, GIRAFF.limits)
    for (px, py, theta), time in zip(poses[:-1], times[:-1], strict=True):
        dx, dy = x + 1.2 * time * math.cos(way) - px, y + 1.2 * time * math.sin(way) - py
        seen = np.array(
            [
                [
                    math.cos(theta) * dx + math.sin(theta) * dy,
                    math.cos(theta) * dy - math.sin(theta) * dx,
                ]
            ]
        )
        assert float(CHECK.gaps(seen)[0]) > 0.0


@examples(40, thorough=400)
@given(
    speed=st.floats(-0.25, 0.5),
    wanted=st.floats(-0.25, 0.5),
    turn=st.floats(-1.0, 1.0),
    seed=st.integers(0, 1000),
)
def test_an_allowed_course_comes_near_to_nothing_that_it_was_not_near_to(
    speed: float, wanted: float, turn: float, seed: int
) -> None:
    check = BrakeCheck(np.array(RHODON.footprint), RHODON.limits)
    points = np.random.default_rng(seed).uniform(-1.5, 1.5, (12, 2))
    points = points[check.gaps(points) > 0.05]
    done = check.fastest(moving(speed), moving(wanted, turn), Hazards(points, NONE, NONE))
    if done.velocity == ZERO:
        return
    for px, py, theta in stop_course(moving(speed), done.velocity, RHODON.limits)[0]:
        away = points - np.array([px, py])
        seen = np.column_stack(
            [
                math.cos(theta) * away[:, 0] + math.sin(theta) * away[:, 1],
                math.cos(theta) * away[:, 1] - math.sin(theta) * away[:, 0],
            ]
        )
        assert float(check.gaps(seen).min(initial=math.inf)) > 0.015


def test_the_course_ends_standing_after_reaction_and_braking() -> None:
    poses, times = stop_course(moving(0.5), moving(0.5), GIRAFF.limits)
    assert times[-1] == pytest.approx(BRAKING.reaction + 0.5 / GIRAFF.limits.linear_braking)
    assert poses[-1, 0] == pytest.approx(
        0.5 * BRAKING.reaction + 0.25 / 2.0 / GIRAFF.limits.linear_braking, abs=0.04
    )
