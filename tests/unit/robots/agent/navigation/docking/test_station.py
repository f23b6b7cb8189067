"""The shape of a charging station in a scan."""

import dataclasses
import math

import numpy as np
import pytest

from robots.agent.navigation.docking.station import NARROW, WIDE, SearchWindow, find
from robots.api.geometry import Pose2D
from robots.simulator.physics.simulation import Simulation
from robots.world.robot_models import MODELS, RobotModel
from robots.world.sites import load_plan

PLAN, _ = load_plan("office")


def before_dock(model: RobotModel, offset: Pose2D, seed: int = 1) -> tuple[Simulation, Pose2D]:
    dock = PLAN.dock_of(model.series)
    assert dock is not None
    docked = Pose2D(dock.x, dock.y, dock.theta)
    start = docked.compose(offset)
    sim = Simulation(model, PLAN, seed=seed, start=f"{start.x},{start.y},{start.theta}")
    return sim, sim.pose.inverse().compose(docked).compose(Pose2D(dock.station.distance, 0.0, 0.0))


@pytest.mark.parametrize("series", sorted(MODELS))
@pytest.mark.parametrize("away", [0.1, 0.4, 0.9, 1.2])
def test_the_front_is_found_to_the_centimetre_though_expected_elsewhere(
    series: str, away: float
) -> None:
    model, rng = MODELS[series], np.random.default_rng(3)
    station = PLAN.dock_of(series).station
    for seed in range(4):
        aside, turned = rng.uniform(-0.2, 0.2, 2) * min(1.0, away)
        sim, front = before_dock(model, Pose2D(-away, float(aside), float(turned)), seed)
        expected = Pose2D(*(np.array(front) + rng.uniform(-1.0, 1.0, 3) * (0.2, 0.2, 0.15)))
        found = find(sim.beams(), expected, station, WIDE)
        assert found is not None
        error = front.inverse().compose(found.front)
        assert abs(error.x) < 0.015
        assert abs(error.y) < 0.03
        assert abs(error.theta) < 0.06


def test_a_plain_wall_is_no_station() -> None:
    sim = Simulation(MODELS["giraff"], PLAN, seed=1, start=f"8.4,1.0,{-math.pi / 2}")
    station = PLAN.dock_of("giraff").station
    assert find(sim.beams(), Pose2D(1.0, 0.0, 0.0), station, WIDE) is None


def test_person_before_half_of_the_front_hides_the_station() -> None:
    sim, front = before_dock(MODELS["giraff"], Pose2D(-0.9, 0.0, 0.0))
    seen = sim.beams()
    ranges = np.where((seen.angles > 0.0) & (seen.angles < 0.4), 0.4, seen.ranges)
    hidden = dataclasses.replace(seen, ranges=ranges)
    assert find(hidden, front, PLAN.dock_of("giraff").station, WIDE) is None


def test_a_station_beyond_the_window_is_not_found() -> None:
    sim, front = before_dock(MODELS["rhodon"], Pose2D(-0.9, 0.0, 0.0))
    elsewhere = Pose2D(front.x - 0.6, front.y, front.theta)
    tight = SearchWindow(along=0.08, aside=0.08, turned=0.1)
    assert find(sim.beams(), elsewhere, PLAN.dock_of("rhodon").station, tight) is None
    assert find(sim.beams(), front, PLAN.dock_of("rhodon").station, NARROW) is not None
