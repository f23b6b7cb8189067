"""Where a follower steers between obstacles on both sides of the robot."""

import numpy as np
import pytest

from robots.agent.navigation.planning.follower import Followed, Follower
from robots.agent.navigation.planning.path import PlannedPath, resampled
from robots.agent.ramp import ZERO
from robots.agent.safety.collision.braking import BrakeCheck, Hazards
from robots.api.geometry import Pose2D
from robots.world.robot_models import GIRAFF

HALF = max(y for _, y in GIRAFF.footprint)
NONE = np.zeros((0, 2))


def followed(*posts: tuple[float, float]) -> Followed:
    """One step along a straight path, by a robot on it, beside posts in its frame."""
    follower = Follower(BrakeCheck(np.array(GIRAFF.footprint), GIRAFF.limits), GIRAFF.limits)
    follower.take(PlannedPath(resampled(np.array([[0.0, 0.0], [3.0, 0.0]]))), None)
    return follower.step(Pose2D(0.0, 0.0, 0.0), ZERO, Hazards(np.array(posts), NONE, NONE))


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_in_a_narrow_place_the_robot_drives_in_the_middle_of_its_reading(side: float) -> None:
    """Where its pose is a few centimetres wrong, the path leads along one side."""
    step = followed((0.4, side * (HALF + 0.06)), (0.4, -side * (HALF + 0.03)))
    assert step.velocity.linear > 0.0
    assert step.velocity.angular * side > 0.0


def test_robot_keeps_to_the_path_where_there_is_room() -> None:
    assert followed((0.4, HALF + 0.4), (0.4, -HALF - 0.1)).velocity.angular == 0.0


def test_obstacle_on_one_side_does_not_draw_the_robot_aside() -> None:
    assert followed((0.4, HALF + 0.05)).velocity.angular == 0.0


def test_obstacle_ahead_is_no_side_of_a_tight_place() -> None:
    assert followed((0.55, 0.1), (0.4, -HALF - 0.03)).velocity.angular == 0.0


def test_an_end_that_something_blocks_is_good_enough_from_nearby_only() -> None:
    follower = Follower(BrakeCheck(np.array(GIRAFF.footprint), GIRAFF.limits), GIRAFF.limits)
    follower.take(PlannedPath(resampled(np.array([[0.0, 0.0], [3.0, 0.0]]))), None)
    assert not follower.rest(Pose2D(2.8, 0.0, 0.0))
    near = Pose2D(2.88, 0.0, 0.0)
    assert follower.rest(near)
    assert not follower.rest(near)  # it rests already
    follower.along = 2.8
    assert follower.step(near, ZERO, Hazards(NONE, NONE, NONE)).state == "arrived"
