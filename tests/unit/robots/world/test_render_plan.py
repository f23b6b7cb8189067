"""Maps that are drawn of plans."""

import math
from dataclasses import replace

import msgspec
import numpy as np
import pytest

from robots.api.geometry import Pose2D
from robots.world.grid import OCCUPIED
from robots.world.render_plan import rasterise, with_stations
from robots.world.sites import load_plan, shipped_sites


@pytest.mark.parametrize("site", shipped_sites())
def test_a_map_that_shows_no_stations_gets_them_as_the_plan_is_drawn(site):
    plan, _ = load_plan(site)
    whole = rasterise(plan)
    bare = rasterise(msgspec.structs.replace(plan, docks=()))
    assert not np.array_equal(bare.occupied(), whole.occupied())
    assert np.array_equal(with_stations(bare, plan).occupied(), whole.occupied())
    assert np.array_equal(with_stations(whole, plan).image, whole.image)


def test_stations_are_drawn_on_a_turned_map_whose_values_are_turned_round_too():
    plan, _ = load_plan("office")
    straight = rasterise(msgspec.structs.replace(plan, docks=()))
    turn = Pose2D(-3.0, 2.0, math.radians(30.0))
    dock = plan.docks[0]
    pose = turn.compose(Pose2D(dock.x, dock.y, dock.theta))
    moved = msgspec.structs.replace(dock, x=pose.x, y=pose.y, theta=pose.theta)
    origin = turn.compose(straight.transform.origin)
    turned = replace(
        straight,
        image=255 - straight.image,
        negate=True,
        transform=replace(straight.transform, origin=origin),
    )
    of_turned = with_stations(turned, msgspec.structs.replace(plan, docks=(moved,)))
    of_straight = with_stations(straight, msgspec.structs.replace(plan, docks=(dock,)))
    assert (of_turned.occupied() == of_straight.occupied()).mean() > 0.9999
    assert (of_straight.image == OCCUPIED).sum() > (straight.image == OCCUPIED).sum()


def test_a_station_beyond_the_map_leaves_it_as_it_is():
    plan, _ = load_plan("office")
    grid = rasterise(plan)
    away = msgspec.structs.replace(plan.docks[0], x=100.0)
    drawn = with_stations(grid, msgspec.structs.replace(plan, docks=(away,)))
    assert np.array_equal(drawn.image, grid.image)
