"""The laser against walls that one can compute by hand."""

import dataclasses
import math

import numpy as np
import pytest

from robots.api.geometry import Pose2D
from robots.simulator.physics.range_sensors import scan
from robots.world.robot_models import GIRAFF
from robots.world.solids import rectangle, sides

SILENT = dataclasses.replace(GIRAFF.laser, noise=0.0, dropout=0.0)
ROOM = sides(rectangle(Pose2D(0, 0, 0), 4.0, 4.0)[::-1])  # seen from inside: clockwise


def rng() -> np.random.Generator:
    return np.random.default_rng(3)


def test_in_the_middle_of_a_square_room_opposite_beams_are_equal() -> None:
    model = dataclasses.replace(SILENT, x=0.0)
    ranges = scan(ROOM, Pose2D(0, 0, 0), model, rng())
    angles = model.angle_min + model.angle_increment * np.arange(model.beams)
    expected = 2.0 / np.maximum(np.abs(np.cos(angles)), np.abs(np.sin(angles)))
    assert ranges == pytest.approx(expected, abs=1e-6)


def test_the_laser_is_mounted_as_in_the_profile() -> None:
    ranges = scan(ROOM, Pose2D(0, 0, math.pi / 2), SILENT, rng())
    assert ranges[SILENT.beams // 2] == pytest.approx(2.0 - SILENT.x, abs=1e-6)


def test_beyond_its_range_a_laser_measures_nothing() -> None:
    ranges = scan(ROOM, Pose2D(0, 0, 0), dataclasses.replace(SILENT, range_max=1.0), rng())
    assert np.isinf(ranges).all()


def test_noise_is_small_seeded_and_never_negative() -> None:
    noisy = dataclasses.replace(GIRAFF.laser, dropout=0.0)
    one, again = (scan(ROOM, Pose2D(0, 0, 0), noisy, rng()) for _ in range(2))
    exact = scan(ROOM, Pose2D(0, 0, 0), SILENT, rng())
    assert np.array_equal(one, again)
    assert 0.003 < np.std(one - exact) < 0.02
    assert (one >= 0).all()


def test_lost_beams_are_lost_at_the_given_rate() -> None:
    model, generator = dataclasses.replace(SILENT, dropout=0.1), rng()
    ranges = np.concatenate([scan(ROOM, Pose2D(0, 0, 0), model, generator) for _ in range(20)])
    assert 0.07 < np.isinf(ranges).mean() < 0.13
