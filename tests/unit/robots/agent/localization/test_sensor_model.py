"""Beams that fit the map, fall short of it, or pass through its walls."""

import math

import numpy as np
import pytest

from robots.agent.localization.field import field_of
from robots.agent.localization.sensor_model import (
    Agreement,
    SensorModel,
    Sweep,
    agreement,
    likelihood_field,
    sweep_of,
)
from robots.api.geometry import Pose2D
from robots.world.sensing import CENTRE, LaserScan
from tests.support.agents.drawn_map import beams_from, drawn_map, standing

MAP = """
####################
#......#...........#
#......#...........#
#......#...........#
#..................#
#..................#
####################
"""
CHANGED = MAP.replace("#..................#", "#......~~~~~~......#", 1)
FIELD = field_of(drawn_map(MAP, scale=4))
MODEL = SensorModel()
POSE = Pose2D(2.4, 1.0, 2.8)


def at(*poses: Pose2D) -> np.ndarray:
    return np.array([FIELD.world_from_field.inverse().compose(pose) for pose in poses])


def sweep(picture: str = MAP, pose: Pose2D = POSE, mount: Pose2D = CENTRE) -> Sweep:
    return sweep_of(beams_from(standing(picture, 0.2), pose, mount=mount), 0.1)


def test_the_lasers_mount_counts() -> None:
    mount = Pose2D(0.2, 0.1, 0.5)
    seen = sweep(mount=mount)
    assert agreement(FIELD, MODEL, at(POSE), seen).fits[0] > 0.95
    assert likelihood_field(FIELD, MODEL).of(at(POSE), seen)[0] > -1.0


def test_a_new_obstacle_before_a_wall_is_short_and_not_through() -> None:
    pose = Pose2D(2.4, 0.5, 2.0)
    judged = agreement(FIELD, MODEL, at(pose), sweep(CHANGED, pose))
    assert judged.short[0] > 0.2
    assert judged.through[0] < 0.05


def test_beams_through_a_wall_outweigh_as_many_that_fit() -> None:
    half = np.array([0.5])
    assert Agreement(half, 0.0 * half, half).merit[0] == 0.0
    assert Agreement(half, 0.0 * half, half).against_others[0] < 0.0
    fits = Agreement(half, half, 0.0 * half)
    assert fits.against_others[0] == fits.merit[0] > 0.8


def test_a_beam_without_a_match_costs_the_same_at_any_length() -> None:
    likelihood = likelihood_field(FIELD, MODEL)
    near, far = (
        Sweep(np.array([[x, 0.0]]), 0.0, 0.0, np.zeros(1), np.array([x]), 10.0) for x in (5.0, 9.0)
    )
    assert likelihood.of(at(POSE), near) == pytest.approx(likelihood.of(at(POSE), far), abs=0.1)


def test_beams_without_an_echo_and_of_the_robot_itself_are_left_out() -> None:
    ranges = np.array([math.nan, math.inf, 0.02, -1.0, 2.0])
    seen = sweep_of(LaserScan(0.0, 0.0, 0.1, 8.0, ranges), 0.1)
    assert seen.ranges.tolist() == [2.0]
    assert seen.angles == pytest.approx([0.4])


def test_a_scan_without_beams_has_no_likelihood() -> None:
    nothing = sweep_of(LaserScan(0.0, 0.0, 0.1, 8.0, np.array([math.inf])), 0.1)
    assert likelihood_field(FIELD, MODEL).of(at(POSE, POSE), nothing).tolist() == [0.0, 0.0]
    assert agreement(FIELD, MODEL, at(POSE), nothing).fits[0] == 0.0


def test_thinning_keeps_both_ends_and_the_count() -> None:
    thin = sweep().thinned(20)
    assert len(thin) == 20
    assert thin.angles[[0, -1]] == pytest.approx(sweep().angles[[0, -1]])
