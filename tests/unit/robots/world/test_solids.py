"""Outlines of walls, furniture, docks and doors."""

import math

import numpy as np
import pytest

from robots.api.geometry import Pose2D
from robots.world.sites import load_plan
from robots.world.solids import (
    bar,
    disc,
    edges,
    fixed_solids,
    inside,
    leaf_end,
    leaf_solid,
    rectangle,
    station_solid,
)

PLAN, _ = load_plan("office")


def area(outline: np.ndarray) -> float:
    x, y = outline.T
    return 0.5 * float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)))


def test_every_outline_of_the_office_is_convex_and_counter_clockwise() -> None:
    leaves = [leaf_solid(door, state) for door in PLAN.doors for state in ("open", "closed")]
    for solid in (*fixed_solids(PLAN), *leaves):
        along = np.roll(solid.outline, -1, axis=0) - solid.outline
        turn = along[:, 0] * np.roll(along[:, 1], -1) - along[:, 1] * np.roll(along[:, 0], -1)
        assert (turn > 0).all(), solid.name
        assert area(solid.outline) > 0, solid.name


def test_a_wall_has_its_length_and_thickness() -> None:
    assert area(bar((1.0, 1.0), (4.0, 5.0), 0.2)) == pytest.approx(1.0)


def test_a_cylinder_hides_its_whole_circle() -> None:
    angles = np.linspace(0, 2 * math.pi, 100)
    assert inside(
        disc(2.0, 3.0, 0.6), 2.0 + 0.299 * np.cos(angles), 3.0 + 0.299 * np.sin(angles)
    ).all()


def test_a_closed_door_fills_its_opening_and_an_open_one_leaves_it() -> None:
    for door in PLAN.doors:
        middle = np.mean([door.start, door.end], axis=0)
        assert inside(leaf_solid(door, "closed").outline, *middle)
        assert not inside(leaf_solid(door, "open").outline, *middle)
        assert math.dist(leaf_end(door, "open"), door.start) == pytest.approx(
            math.dist(door.end, door.start)
        )


def test_station_is_ahead_of_the_docked_robot() -> None:
    for dock in PLAN.docks:
        ahead = Pose2D(dock.x, dock.y, dock.theta).inverse()
        xs = [ahead.apply(*corner)[0] for corner in station_solid(dock).outline]
        assert min(xs) == pytest.approx(dock.station.distance)


def test_the_sides_of_solids_close() -> None:
    sides = edges(fixed_solids(PLAN)[:1])
    assert np.allclose(sides[:, 2:], np.roll(sides[:, :2], -1, axis=0))
    assert edges(()).shape == (0, 4)


def test_the_border_of_a_rectangle_belongs_to_it() -> None:
    outline = rectangle(Pose2D(0.0, 0.0, 0.0), 2.0, 2.0)
    assert inside(outline, np.array([1.0, 1.01]), np.array([0.0, 0.0])).tolist() == [True, False]
