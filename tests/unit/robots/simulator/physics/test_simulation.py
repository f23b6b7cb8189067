"""The simulated robot, faster than real time."""

import dataclasses
import math
from typing import Any

import numpy as np
import pytest

from robots.api.geometry import Pose2D, wrap_angle
from robots.simulator.physics.contact import distance_to
from robots.simulator.physics.drive import STILL
from robots.simulator.physics.people import BODY
from robots.simulator.physics.simulation import BUMP_TIME, Simulation, StartError, TrueState
from robots.simulator.wire import Faults
from robots.world.robot_models import GIRAFF, MODELS, OdometryModel
from robots.world.sites import load_plan

PLAN, _ = load_plan("office")


def giraff(start: str = "lab-centre", seed: int = 1, **more: Any) -> Simulation:
    return Simulation(GIRAFF, PLAN, seed=seed, start=start, **more)


def drive(sim: Simulation, linear: float, angular: float, seconds: float) -> None:
    for step in range(round(seconds / 0.01)):
        if step % 5 == 0:
            sim.command(linear, angular)
        sim.step(0.01)


def wait(sim: Simulation, seconds: float, dt: float = 0.01) -> None:
    for _ in range(round(seconds / dt)):
        sim.step(dt)


def wander(seed: int, scans: bool) -> list[TrueState]:
    sim, rng, samples = giraff(seed=seed), np.random.default_rng(99), []
    for step in range(1500):
        if step % 30 == 0:
            sim.command(float(rng.uniform(-0.3, 0.7)), float(rng.uniform(-0.7, 0.7)))
        if scans and step % 10 == 0:
            sim.scan()
        sim.step(0.01)
        samples.append(sim.sample())
    return samples


@pytest.fixture
def sim() -> Simulation:
    return giraff()


def test_the_same_seed_and_commands_give_the_same_trajectory_to_the_last_bit() -> None:
    assert wander(4, scans=False) == wander(4, scans=False)


def test_a_scan_does_not_change_the_trajectory() -> None:
    assert wander(4, scans=True) == wander(4, scans=False)


def test_the_same_seed_gives_the_same_scan_and_another_seed_another() -> None:
    assert np.array_equal(giraff(seed=4).scan(), giraff(seed=4).scan())
    assert not np.array_equal(giraff(seed=4).scan(), giraff(seed=5).scan())


def test_the_watchdog_brakes_a_robot_without_commands() -> None:
    sim = giraff("corridor-centre")
    drive(sim, 0.7, 0.0, 4.0)
    speed, last = sim.motion.linear, sim.commanded_at
    assert speed == pytest.approx(0.7)
    while sim.motion != STILL:
        sim.step(0.01)
    assert sim.time - last <= GIRAFF.watchdog + speed / GIRAFF.limits.linear_braking + 0.03


def test_a_contact_of_any_length_counts_once() -> None:
    sim = giraff("2.2,5.6,1.5708")
    drive(sim, 0.4, 0.0, 6.0)
    assert sim.contacts == 1
    assert sim.clearance() < 0.01
    drive(sim, -0.3, 0.0, 1.5)
    assert sim.contacts == 1
    drive(sim, 0.4, 0.0, 6.0)
    assert sim.contacts == 2


def test_in_the_dock_the_battery_charges_and_outside_it_drains() -> None:
    sim = giraff("dock", charge=0.5)
    assert sim.docked
    drive(sim, 0.0, 0.0, 2.0)
    charged = sim.charge
    assert charged > 0.5
    drive(sim, -0.3, 0.0, 4.0)
    assert not sim.docked
    drained = sim.charge
    drive(sim, 0.0, 0.0, 2.0)
    assert sim.charge < drained


@pytest.mark.parametrize("series", sorted(MODELS))
def test_each_robot_backs_out_of_its_dock_and_noses_in_again_without_a_contact(series: str) -> None:
    sim = Simulation(MODELS[series], PLAN, seed=1)
    assert sim.docked
    drive(sim, -0.25, 0.0, 4.0)
    assert not sim.docked
    for _ in range(2000):
        sim.command(0.12, 0.0)
        sim.step(0.01)
        if sim.docked:
            break
    drive(sim, 0.1, 0.0, 2.0)  # leaning on the station
    assert sim.docked
    assert sim.contacts == 0


def test_the_wrong_robot_does_not_charge_in_a_dock() -> None:
    dock = PLAN.dock_of("rhodon")
    assert dock is not None
    assert not Simulation(
        GIRAFF, PLAN, seed=1, start=f"{dock.x - 0.1},{dock.y},{dock.theta}"
    ).docked


def test_beside_the_dock_or_turned_in_it_there_is_no_contact_with_it() -> None:
    assert not giraff("0.55,6.45,3.14159").docked
    assert not giraff("0.6,6.3,2.7").docked


def test_an_empty_battery_stops_the_robot_and_is_reported() -> None:
    sim = giraff(charge=0.0)
    drive(sim, 0.5, 0.0, 1.0)
    assert sim.motion == STILL
    assert sim.errors() == ("battery empty",)


def test_the_head_tilts_with_its_speed_and_within_its_range(sim: Simulation) -> None:
    sim.tilt_target = 0.8
    before = sim.tilt
    wait(sim, 0.2)
    assert sim.tilt == pytest.approx(before + 0.2 * GIRAFF.tilt.speed)
    sim.tilt_target = 5.0
    wait(sim, 5.0)
    assert sim.tilt == GIRAFF.tilt.maximum


def test_a_closed_door_stops_the_robot_and_an_open_one_lets_it_through() -> None:
    for state, through in (("closed", False), ("open", True)):
        sim = giraff("2.02,1.0,1.5708")
        sim.set_doors({"lab-door": state})
        drive(sim, 0.5, 0.0, 8.0)
        assert (sim.pose.y > 3.0) == through
        assert (sim.contacts == 0) == through


def test_odometry_without_slip_is_the_motion_from_the_start() -> None:
    perfect = dataclasses.replace(GIRAFF, wheel_noise=0.0, odometry=OdometryModel(0.0, 0.0))
    sim = Simulation(perfect, PLAN, seed=1, start="lab-centre")
    start = sim.pose
    drive(sim, 0.4, 0.3, 5.0)
    back = start.compose(sim.odometry)
    assert back.distance(sim.pose) < 0.01
    assert abs(wrap_angle(back.theta - sim.pose.theta)) < 1e-6
    assert sim.distance == pytest.approx(1.6, abs=0.1)


def test_odometry_drifts_by_the_seed_of_the_robot() -> None:
    ends = []
    for seed in (1, 1, 2):
        sim = giraff(seed=seed)
        start = sim.pose
        drive(sim, 0.3, 0.3, 20.0)
        ends.append(start.compose(sim.odometry).distance(sim.pose))
    assert ends[0] == ends[1] != ends[2]
    assert all(0.02 < end < 2.0 for end in ends)


def test_carrying_a_robot_does_not_change_its_odometry(sim: Simulation) -> None:
    drive(sim, 0.2, 0.0, 1.0)
    odometry, distance = sim.odometry, sim.distance
    sim.carry_to(Pose2D(8.6, 4.4, 1.0))
    assert (sim.odometry, sim.distance) == (odometry, distance)
    assert sim.pose == Pose2D(8.6, 4.4, 1.0)
    assert sim.motion == STILL


def test_a_robot_is_not_carried_into_furniture_or_out_of_the_site(sim: Simulation) -> None:
    before = sim.pose
    with pytest.raises(StartError, match="desk-1 is in that spot"):
        sim.carry_to(Pose2D(2.4, 7.2, 0.0))
    with pytest.raises(StartError, match="not in a room"):
        sim.carry_to(Pose2D(50.0, 1.0, 0.0))
    assert sim.pose == before


def test_stopped_wheels_ignore_commands(sim: Simulation) -> None:
    sim.faults = Faults(wheels_stopped=True)
    drive(sim, 0.4, 0.2, 2.0)
    assert sim.motion == STILL
    sim.faults = Faults()
    drive(sim, 0.4, 0.2, 2.0)
    assert sim.motion.linear > 0.3


def test_a_broken_laser_is_silent_or_measures_nan(sim: Simulation) -> None:
    assert np.isfinite(sim.beams().ranges).mean() > 0.9
    sim.faults = Faults(laser="nan")
    assert np.isnan(sim.scan()).all()
    assert np.isinf(sim.beams().ranges).all()
    sim.faults = Faults(laser="silent")
    assert sim.beams() is None


def test_doors_that_move_by_themselves_do_so_at_the_same_times_for_the_same_seed() -> None:
    def changes(seed: int) -> list[tuple[float, str]]:
        sim, seen, before = giraff(seed=seed, door_changes=5.0), [], {}
        for _ in range(3000):
            sim.step(0.02)
            if sim.doors != before:
                before = dict(sim.doors)
                seen.append((round(sim.time, 2), str(before)))
        return seen

    first = changes(3)
    assert first == changes(3) != changes(4)
    assert len(first) > 5


def person_ahead(sim: Simulation, ahead: float, *, path: bool) -> None:
    """Put the only person `ahead` metres before the robot's centre, at rest or walking towards the
    robot and beyond.
    """
    walker = sim._pedestrians._walkers[0]
    walker.x, walker.y = sim.pose.apply(ahead, 0.0)
    walker.path, walker.stay = ([sim.pose.apply(-3.0, 0.0)], 0.0) if path else ([], 1e6)
    walker.heading, walker.patience = sim.pose.theta + math.pi, 100.0
    sim.step(0.001)


def test_robot_that_drives_into_a_person_stops_with_one_contact() -> None:
    sim = giraff("2.0,1.0,0", people=1)
    person_ahead(sim, 1.5, path=False)
    drive(sim, 0.4, 0.0, 6.0)
    assert (sim.contacts, sim.bumped) == (1, 0)
    assert sim.clearance() < 0.01
    assert sim.pose.x < 2.0 + 1.5 - BODY - 0.3
    drive(sim, -0.2, 0.0, 1.0)
    assert sim.clearance() > 0.05


def test_person_who_walks_into_a_robot_at_rest_waits_and_is_no_contact() -> None:
    sim = giraff("2.0,1.0,0", people=1)
    person_ahead(sim, 2.5, path=True)
    wait(sim, 10.0, 0.02)
    assert (sim.contacts, sim.bumped) == (0, 1)
    assert sim.pose == Pose2D(2.0, 1.0, 0.0)
    person = sim.people[0]
    assert person.speed == 0.0
    assert distance_to(person.x, person.y, sim.outline()) >= BODY - 1e-9


def test_robot_that_keeps_pushing_a_person_has_a_contact() -> None:
    sim = giraff("2.0,1.0,0", people=1)
    person_ahead(sim, 1.2, path=True)
    while not sim.bumped:
        sim.step(0.02)
    drive(sim, 0.3, 0.0, 0.8 * BUMP_TIME)
    assert sim.contacts == 0
    drive(sim, 0.3, 0.0, BUMP_TIME)
    assert sim.contacts == 1


@pytest.mark.parametrize("bearing", [0.0, 0.3, -0.5, 1.0, 2.4])
def test_robot_can_drive_away_from_a_person_who_walked_into_it(bearing: float) -> None:
    sim = giraff("2.0,1.0,0", people=1)
    away = math.copysign(0.2, math.cos(bearing))
    walker = sim._pedestrians._walkers[0]
    walker.x, walker.y = sim.pose.apply(0.8 * math.cos(bearing), 0.8 * math.sin(bearing))
    walker.path, walker.stay, walker.patience = [(sim.pose.x, sim.pose.y)], 0.0, 1e6
    wait(sim, 3.0, 0.02)
    assert walker.touching
    assert not sim.obstacles.hits(sim.outline(), sim._near(sim.pose))
    walker.path, walker.stay = [], 1e6
    begun = sim.pose
    drive(sim, -away, 0.1, 1.5)
    assert sim.pose.distance(begun) > 0.1


def test_laser_sees_the_legs_of_a_person_ahead() -> None:
    sim = giraff("2.0,1.0,0", people=1)
    person_ahead(sim, 2.0, path=False)
    ranges = sim.scan()
    ahead = ranges[len(ranges) // 2 - 8 : len(ranges) // 2 + 8]
    assert 1.5 < np.min(ahead) < 2.0 - GIRAFF.laser.x
    assert np.max(ahead[np.isfinite(ahead)]) > 3.0


def test_distant_people_do_not_change_a_drive() -> None:
    def ends(people: int) -> Pose2D:
        sim = giraff("corridor-centre", people=people)
        for walker in sim._pedestrians._walkers if people else ():
            walker.x, walker.y, walker.path, walker.stay = 9.4, 4.9, [], 1e6
        drive(sim, 0.3, 0.1, 4.0)
        return sim.pose

    assert ends(0) == ends(1)


@pytest.mark.parametrize(
    ("start", "words"),
    [
        ("moon", "cannot start at"),
        ("1,2", "cannot start at"),
        ("100,100,0", "not in a room"),
        ("nan,1,0", "not in a room"),
        ("2.4,7.2,0", "is in that spot"),
    ],
)
def test_an_impossible_start_is_refused_with_a_sentence(start: str, words: str) -> None:
    with pytest.raises(StartError, match=words):
        giraff(start)


def test_a_start_may_be_a_pose() -> None:
    assert giraff("3.0,4.0,0.5").pose == Pose2D(3.0, 4.0, 0.5)
    assert math.isclose(giraff("3.0,4.0,7.0").pose.theta, wrap_angle(7.0))
