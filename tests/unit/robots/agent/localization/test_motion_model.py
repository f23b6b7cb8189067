"""Particles that move with the odometry, with noise."""

import math

import numpy as np
import pytest

from robots.agent.localization.motion_model import MotionNoise, move
from robots.api.geometry import Pose2D


def test_the_spread_of_a_motion_does_not_depend_on_the_number_of_steps() -> None:
    rng = np.random.default_rng(2)
    once = many = np.zeros((20_000, 3))
    once = move(once, Pose2D(1.0, 0.0, 0.0), MotionNoise(), rng)
    for _ in range(20):
        many = move(many, Pose2D(0.05, 0.0, 0.0), MotionNoise(), rng)
    assert many[:, 0].std() == pytest.approx(once[:, 0].std(), rel=0.05)
    assert many[:, 2].std() == pytest.approx(once[:, 2].std(), rel=0.05)


def test_a_turn_in_place_leaves_the_place_and_widens_the_heading() -> None:
    moved = move(
        np.zeros((5_000, 3)), Pose2D(0.0, 0.0, math.pi / 2), MotionNoise(), np.random.default_rng(3)
    )
    assert np.abs(moved[:, :2]).max() < 0.1
    assert moved[:, 2].std() == pytest.approx(math.sqrt(0.0016 * math.pi / 2), rel=0.1)
