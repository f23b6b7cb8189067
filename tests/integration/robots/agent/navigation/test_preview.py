"""Where a robot would go, before it is asked: to the point, beside it, or nowhere and why."""

import math

import numpy as np
import pytest

from robots.simulator.physics.simulation import Simulation
from robots.world.robot_models import GIRAFF
from robots.world.sites import load_site
from tests.support.agents.navigation_rig import Rig

SITE = load_site("office")


def looking(start):
    """Return a robot that has looked around for a moment."""
    made = Rig(Simulation(GIRAFF, SITE.plan, seed=1, start=start), SITE.grid, 1)
    for _ in range(20):
        made.step()
    return made


def end(points):
    return tuple(points[-1])


def test_free_point_has_a_route_that_a_journey_follows_to_it():
    made = looking("lab-before-door")
    points, reason = made.navigator.preview(4.0, 1.1)
    assert (end(points), reason) == ((4.0, 1.1), "")
    assert np.hypot(*np.diff(points, axis=0).T).max() < 0.3
    made.navigator.goto(*end(points))
    assert made.run(60.0).status == "FINISHED"
    assert math.dist(made.sim.pose[:2], end(points)) < 0.25


FURNITURE = {thing.name: thing for thing in SITE.plan.furniture}


@pytest.mark.nightly
@pytest.mark.parametrize("name", FURNITURE)
def test_route_to_furniture_ends_beside_it_and_can_be_driven(name):
    made = looking("corridor-centre")
    thing = FURNITURE[name]
    points, reason = made.navigator.preview(thing.x, thing.y)
    assert reason in {"in_wall", "goal_taken"}
    if len(points) == 0:
        assert max(thing.width, thing.depth or 0.0) > 1.0, "a small thing has a place beside it"
        return
    assert math.dist(end(points), (thing.x, thing.y)) < 1.0
    made.navigator.goto(*end(points))
    assert made.run(90.0).status == "FINISHED"
    assert math.dist(made.sim.pose[:2], end(points)) < 0.25


def test_point_outside_the_map_has_no_route_but_a_reason():
    navigator = looking("corridor-centre").navigator
    for point, reason in [((-50.0, 0.0), "outside"), ((math.nan, 0.0), "no_goal")]:
        points, said = navigator.preview(*point)
        assert (len(points), said) == (0, reason)
