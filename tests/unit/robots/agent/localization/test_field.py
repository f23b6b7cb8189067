"""Distances to the nearest wall, compared with ones computed by hand."""

import math

import numpy as np
import pytest
from hypothesis import given, strategies as st

from robots.agent.localization.field import field_of
from robots.world.raycaster import cast
from tests.support.agents.drawn_map import drawn_map, standing
from tests.support.examples import examples

ROOM = """
##########
#........#
#........#
#........#
#.....##.#
#........#
##########
"""
FIELD = field_of(drawn_map(ROOM, scale=4))  # a character is 0.2 m
SIDES = standing(ROOM, 0.2)


def here(x: float, y: float) -> tuple[np.ndarray, np.ndarray]:
    """Return a point of the world in the field's frame."""
    inside = FIELD.world_from_field.inverse().apply(x, y)
    return np.array([inside[0]]), np.array([inside[1]])


def test_the_surface_of_a_wall_is_at_zero_and_its_inside_is_negative() -> None:
    assert FIELD.distances(*here(0.2, 0.7))[0][0] == pytest.approx(0.0, abs=1e-6)
    assert FIELD.distances(*here(0.5, 0.7))[0][0] == pytest.approx(0.3, abs=1e-6)
    assert FIELD.distances(*here(0.125, 0.7))[0][0] == pytest.approx(-0.075, abs=1e-6)


def test_the_slope_points_away_from_the_wall() -> None:
    _, slope_x, slope_y = FIELD.distances(*here(0.4, 0.7))
    assert (slope_x[0], slope_y[0]) == pytest.approx((1.0, 0.0), abs=1e-6)


def test_points_off_the_map_are_far_from_everything() -> None:
    far = np.array([-5.0, 50.0])
    assert (FIELD.distances(far, far)[0] > 0.9).all()
    assert not FIELD.is_free(far, far).any()


@given(st.floats(0.45, 0.95), st.floats(0.45, 1.15), st.floats(-math.pi, math.pi))
@examples(60, thorough=600)
def test_a_ray_is_as_long_as_in_the_drawn_world(x: float, y: float, angle: float) -> None:
    at_x, at_y = here(x, y)
    cast_here = FIELD.cast(at_x, at_y, np.array([angle]), 10.0)[0]
    # a corner may be clipped by less than a cell
    beside, _ = cast(SIDES, x, y, angle + np.array([-0.08, 0.0, 0.08]))
    end_x, end_y = at_x + cast_here * math.cos(angle), at_y + cast_here * math.sin(angle)
    assert FIELD.distances(end_x, end_y)[0][0] < 0.05
    assert beside.min() - 0.1 < cast_here < beside.max() + 0.15


def test_a_ray_out_of_an_open_map_ends_at_the_lasers_reach() -> None:
    field = field_of(drawn_map("#....\n#....\n#....", scale=4))
    x, y = field.world_from_field.inverse().apply(0.5, 0.3)
    assert field.cast(np.array([x]), np.array([y]), np.array([0.0]), 7.0)[0] == pytest.approx(7.0)
