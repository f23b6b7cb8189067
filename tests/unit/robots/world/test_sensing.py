import math

import numpy as np
import pytest

from robots.api.geometry import Pose2D
from robots.world.sensing import CENTRE, LaserScan


def sweep(ranges, mount=CENTRE):
    return LaserScan(1.0, -math.pi / 2, math.pi / 2, 8.0, np.array(ranges), mount)


def test_points_are_the_ends_of_the_beams_in_the_robots_frame():
    points = sweep([1.0, 2.0, 3.0], Pose2D(0.2, 0.1, 0.0)).points()
    assert points == pytest.approx(np.array([[0.2, -0.9], [2.2, 0.1], [0.2, 3.1]]))


def test_a_turned_mount_turns_the_beams():
    points = sweep([np.inf, 2.0, np.inf], Pose2D(0.0, 0.0, math.pi / 2)).points()
    assert points == pytest.approx(np.array([[0.0, 2.0]]))


@pytest.mark.parametrize("nonsense", [math.nan, -0.1, 8.01, math.inf, -math.inf])
def test_ranges_that_no_laser_measures_count_as_no_echo(nonsense):
    beams = sweep([1.0, nonsense, 1.0])
    assert np.isinf(beams.ranges[1])
    assert len(beams.points()) == 2


def test_the_readings_it_was_made_of_are_not_touched():
    ranges = np.array([np.nan, 1.0, 2.0])
    sweep(ranges)
    assert np.isnan(ranges[0])
