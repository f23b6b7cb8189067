import math
from itertools import pairwise

import pytest

from experiments.bots.routes import NoRouteError, RouteGrid
from robots.world.sites import load_site

DOCK, OUTSIDE_LAB, LOUNGE = (1.4, 6.2), (2.0, 1.0), (9.6, 4.4)


@pytest.fixture(scope="module")
def plan():
    return load_site("office").plan


def length(route):
    return sum(math.dist(a, b) for a, b in pairwise(route))


def test_a_route_takes_another_door_when_the_nearest_is_closed(
    plan,
):
    direct = RouteGrid(plan).route(DOCK, OUTSIDE_LAB)
    assert RouteGrid(plan).door_on(direct, 20.0).name == "lab-door"
    round_about = RouteGrid(plan, ["lab-door"]).route(DOCK, OUTSIDE_LAB)
    assert RouteGrid(plan, ["lab-door"]).door_on(round_about, 30.0).name == "lounge-door"
    assert length(round_about) > 2.0 * length(direct)


def test_a_route_keeps_its_distance_from_furniture(plan):
    route = RouteGrid(plan).route(OUTSIDE_LAB, LOUNGE)
    for piece in plan.furniture:
        if piece.shape == "cylinder":
            assert (
                min(math.dist((piece.x, piece.y), point) for point in route)
                > piece.width / 2.0 + 0.28
            )


def test_a_route_ends_at_its_goal(plan):
    assert RouteGrid(plan).route(OUTSIDE_LAB, LOUNGE)[-1] == LOUNGE


def test_there_is_no_route_when_every_door_is_closed(plan):
    with pytest.raises(NoRouteError):
        RouteGrid(plan, ["lab-door", "lounge-door"]).route(DOCK, OUTSIDE_LAB)
