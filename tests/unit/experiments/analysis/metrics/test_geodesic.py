"""Shortest paths with open and closed doors."""

import math

import pytest

from experiments.analysis.metrics.geodesic import ShortestPaths, nearer
from robots.world.sites import load_plan

OFFICE, _ = load_plan("office")
CORRIDOR, LAB = (2.0, 1.0), (2.0, 4.4)


def test_a_straight_corridor_is_as_long_as_it_is():
    assert nearer(OFFICE, frozenset(), (9.0, 1.0), (2.0, 1.0), (8.0, 1.0)) == pytest.approx(
        6.0, rel=0.03
    )


def test_an_oblique_line_is_at_most_3_percent_too_long():
    start, end = (2.0, 3.5), (4.9, 5.1)
    assert (
        math.dist(start, end) * 0.98
        <= nearer(OFFICE, frozenset(), end, start, end)
        <= math.dist(start, end) * 1.04
    )


def test_a_closed_door_makes_the_way_longer_by_the_way_around():
    through = nearer(OFFICE, frozenset(), LAB, CORRIDOR, LAB)
    around = nearer(OFFICE, frozenset({"lab-door"}), LAB, CORRIDOR, LAB)
    assert through == pytest.approx(3.4, abs=0.3)
    assert around > through + 10.0


def test_with_both_doors_closed_there_is_no_way():
    assert math.isnan(nearer(OFFICE, frozenset({"lab-door", "lounge-door"}), LAB, CORRIDOR, LAB))


def test_a_place_far_outside_has_no_way():
    assert ShortestPaths(OFFICE).nearest((50.0, 50.0)) == -1
    assert math.isnan(nearer(OFFICE, frozenset(), LAB, (50.0, 50.0), LAB))


def test_a_station_is_where_the_robot_docks_and_not_in_its_way():
    dock = next(one for one in OFFICE.docks if one.type == "giraff")
    assert nearer(
        OFFICE, frozenset(), (dock.x, dock.y), (2.0, 5.5), (dock.x, dock.y)
    ) == pytest.approx(1.7, abs=0.3)
