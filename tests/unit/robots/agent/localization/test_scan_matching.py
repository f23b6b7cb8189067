"""Poses that slide onto the map."""

import math

import numpy as np
import pytest

from robots.agent.localization.field import field_of
from robots.agent.localization.scan_matching import Matching, refine
from robots.agent.localization.sensor_model import sweep_of
from robots.api.geometry import Pose2D
from tests.support.agents.drawn_map import beams_from, drawn_map, standing

ROOM = """
################
#..............#
#..............#
#..............#
#.........##...#
#.........##...#
#..............#
#..............#
################
"""
CORRIDOR = "#" * 120 + ("\n" + "." * 120) * 8 + "\n" + "#" * 120
WEAK = np.diag([1.0, 1.0, 10.0])
OFF = np.array([[0.12, -0.1, math.radians(6.0)], [-0.1, 0.12, math.radians(-6.0)], [0.0, 0.0, 0.0]])


def matched(
    picture: str, seen: str, pose: Pose2D, off: np.ndarray, prior: np.ndarray = WEAK
) -> np.ndarray:
    """Return the errors (n, 3) that are left after matching poses that are `off` by so much."""
    field = field_of(drawn_map(picture, scale=4))
    points = sweep_of(beams_from(standing(seen, 0.2), pose, reach=5.0), 0.1).points
    truth = np.array(field.world_from_field.inverse().compose(pose))
    return refine(field, truth + off, points, prior, Matching(rounds=15)) - truth


def test_along_a_bare_corridor_the_pose_stays_where_it_was() -> None:
    left = matched(CORRIDOR, CORRIDOR, Pose2D(12.0, 1.0, 0.1), np.array([[0.4, 0.1, 0.03]]))
    assert left[0, 0] == pytest.approx(0.4, abs=0.05)
    assert left[0, 1] == pytest.approx(0.0, abs=0.015)


def test_a_strong_prior_outweighs_the_beams() -> None:
    left = matched(ROOM, ROOM, Pose2D(1.3, 0.9, 0.4), OFF[:1], np.diag([1e8, 1e8, 1e8]))
    assert left == pytest.approx(OFF[:1], abs=1e-3)


def test_without_beams_nothing_moves() -> None:
    field = field_of(drawn_map(ROOM, scale=4))
    assert refine(field, OFF, np.zeros((0, 2)), WEAK, Matching()) == pytest.approx(OFF)
