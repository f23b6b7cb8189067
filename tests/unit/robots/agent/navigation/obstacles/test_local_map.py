"""Obstacles that are not on the map."""

import dataclasses
import math

import numpy as np
import pytest

from robots.agent.navigation.obstacles.doors import DOORS
from robots.agent.navigation.obstacles.local_map import LOCAL_MAP, LocalObstacleMap
from robots.agent.navigation.planning.costmap import CostMap
from robots.api.geometry import Pose2D
from robots.simulator.physics.simulation import Simulation
from robots.world.robot_models import GIRAFF
from robots.world.sensing import LaserScan
from robots.world.sites import load_site

SITE = load_site("office")
BEFORE_DOOR = "2.0,3.6,-1.5708"


def with_thing(sim: Simulation, distance: float = 1.0) -> LaserScan:
    """A scan with an obstacle of 20 cm straight ahead, at a distance from the laser."""
    beams = sim.beams()
    ranges = np.where(np.abs(beams.angles) <= 0.1 / distance, distance, beams.ranges)
    return dataclasses.replace(beams, ranges=ranges)


def giraff(start: str = "lab-centre", **doors: str) -> tuple[Simulation, LocalObstacleMap]:
    sim = Simulation(GIRAFF, SITE.plan, seed=1, start=start)
    sim.set_doors({name.replace("_", "-"): state for name, state in doors.items()})
    return sim, LocalObstacleMap(CostMap(SITE.grid, sim.footprint), SITE.plan)


def thing_at(obstacle_map: LocalObstacleMap, pose: Pose2D, distance: float, now: float) -> bool:
    """Tell whether something is marked straight ahead, within 10 cm."""
    x, y = pose.apply(GIRAFF.laser.x + distance, 0.0)
    row, column = obstacle_map.costmap.transform.to_cell(x, y)
    return bool(obstacle_map.live(now)[row - 2 : row + 3, column - 2 : column + 3].any())


def test_an_obstacle_is_marked_until_the_laser_sees_through_it() -> None:
    sim, obstacle_map = giraff()
    obstacle_map.look(sim.pose, with_thing(sim), 0.0)
    assert thing_at(obstacle_map, sim.pose, 1.0, 0.0)
    obstacle_map.look(sim.pose, sim.beams(), 0.1)
    assert not thing_at(obstacle_map, sim.pose, 1.0, 0.1)


def test_an_obstacle_is_forgotten_later_the_longer_it_was_observed() -> None:
    sim, briefly = giraff()
    briefly.look(sim.pose, with_thing(sim), 0.0)
    _, long = giraff()
    for step in range(120):
        long.look(sim.pose, with_thing(sim), step / 10.0)
    assert not thing_at(briefly, sim.pose, 1.0, 6.0)
    assert thing_at(long, sim.pose, 1.0, 12.0 + LOCAL_MAP.kept_at_most / 2.0)
    assert not thing_at(long, sim.pose, 1.0, 13.0 + LOCAL_MAP.kept_at_most)


def test_only_long_still_obstacles_are_settled() -> None:
    sim, obstacle_map = giraff()
    point = np.array([[GIRAFF.laser.x + 1.0, 0.0]])
    elsewhere = np.array([[GIRAFF.laser.x + 1.0, 0.5]])
    for step in range(round(LOCAL_MAP.settled * 10) + 5):
        now = step / 10.0
        obstacle_map.look(sim.pose, with_thing(sim), now)
        if now < LOCAL_MAP.settled - 0.5:
            assert not obstacle_map.settled(sim.pose, point, now).any()
    assert obstacle_map.settled(sim.pose, point, now).all()
    assert not obstacle_map.settled(sim.pose, elsewhere, now).any()
    assert obstacle_map.strange(sim.pose, np.vstack([point, elsewhere]), now).all()


def test_an_occasionally_observed_obstacle_that_no_ray_passes_becomes_permanent() -> None:
    """Most scans of an obstacle's edge close to a wall show the wall."""
    sim, obstacle_map = giraff()
    point = np.array([[GIRAFF.laser.x + 1.0, 0.0]])
    behind = LOCAL_MAP.seen_through - 0.02
    for step in range(round(LOCAL_MAP.settled * 10) + 5):
        away = 0.0 if step % 20 == 0 else behind
        obstacle_map.look(sim.pose, with_thing(sim, 1.0 + away), step / 10.0)
    assert obstacle_map.settled(sim.pose, point, step / 10.0).all()


def test_obstacle_after_a_free_view_is_new() -> None:
    sim, obstacle_map = giraff()
    point = np.array([[GIRAFF.laser.x + 1.0, 0.0]])
    for step in range(round(LOCAL_MAP.settled * 10) + 5):
        is_free = 50 <= step < 65
        obstacle_map.look(sim.pose, sim.beams() if is_free else with_thing(sim), step / 10.0)
    assert not obstacle_map.settled(sim.pose, point, step / 10.0).any()


def test_the_leaf_of_an_open_door_is_no_obstacle() -> None:
    sim, obstacle_map = giraff(BEFORE_DOOR)
    beams = sim.beams()
    obstacle_map.look(sim.pose, beams, 0.0)
    assert not obstacle_map.strange(sim.pose, beams.points(), 0.0).any()


@pytest.mark.parametrize("start", [BEFORE_DOOR, "3.2,4.6,-2.2", "2.0,1.0,1.5708", "1.0,0.9,0.9"])
def test_a_closed_door_is_seen_from_either_side_and_an_open_one_is_not(start: str) -> None:
    closed, obstacle_map = giraff(start, lab_door="closed")
    obstacle_map.look(closed.pose, closed.beams(), 0.0)
    assert [door.name for door in obstacle_map.doors.closed(0.0)] == ["lab-door"]
    opened, others = giraff(start)
    others.look(opened.pose, opened.beams(), 0.0)
    assert others.doors.closed(0.0) == ()


def test_a_closed_door_counts_as_closed_for_a_while_or_until_it_is_seen_open() -> None:
    sim, obstacle_map = giraff(BEFORE_DOOR, lab_door="closed")
    obstacle_map.look(sim.pose, sim.beams(), 0.0)
    away = Simulation(GIRAFF, SITE.plan, seed=1, start="lounge-centre")
    obstacle_map.look(away.pose, away.beams(), 5.0)
    assert len(obstacle_map.doors.closed(5.0)) == 1
    assert len(obstacle_map.doors.closed(DOORS.memory + 1.0)) == 0
    opened, _ = giraff(BEFORE_DOOR)
    obstacle_map.look(opened.pose, opened.beams(), 6.0)
    assert obstacle_map.doors.closed(6.0) == ()


def test_a_scan_without_echoes_clears_no_obstacle() -> None:
    sim, obstacle_map = giraff()
    obstacle_map.look(sim.pose, with_thing(sim), 0.0)
    seen = sim.beams()
    blind = dataclasses.replace(seen, ranges=np.full(len(seen.ranges), math.nan))
    obstacle_map.look(sim.pose, blind, 0.1)
    assert thing_at(obstacle_map, sim.pose, 1.0, 0.1)
