"""Assistance on a simulated robot with noisy laser, lost beams, slip and odometry drift."""

import pytest

from benchmarks.driving.assist import (
    BLIND,
    JUDGED,
    Rig,
    careless_drive,
    crossings,
    novice_drive,
)
from robots.agent.ramp import ZERO
from robots.agent.safety.collision_monitor import MONITOR
from robots.api.messages import Velocity
from robots.simulator.physics.simulation import Simulation
from robots.simulator.wire import Faults
from robots.world.robot_models import GIRAFF, MODELS
from robots.world.sites import load_site, shipped_sites

OFFICE = load_site("office").plan
AHEAD = Velocity(linear=0.5, angular=0.0)


def rig(start, level, seed=5):
    return Rig(Simulation(GIRAFF, OFFICE, seed=seed, start=start), level)


def drive(robot, stick, seconds):
    end = robot.world.time + seconds
    while robot.world.time < end:
        robot.drive(stick)


def test_careless_driver_hits_obstacles_without_assistance():
    assert careless_drive(OFFICE, GIRAFF, "off", 3, 1.0).collisions > 0


@pytest.mark.nightly
@pytest.mark.parametrize("level", ["slow", "steer"])
@pytest.mark.parametrize("series", sorted(MODELS))
def test_careless_driver_hits_nothing_with_assistance_and_still_moves(series, level):
    robot = careless_drive(OFFICE, MODELS[series], level, 3, 0.5)
    assert robot.touches == 0
    assert robot.world.distance > 0.5


@pytest.mark.nightly
@pytest.mark.parametrize("level", ["slow", "steer"])
@pytest.mark.parametrize("series", sorted(MODELS))
def test_with_sonars_and_bumper_a_careless_driver_touches_only_at_a_creep(series, level):
    robot = careless_drive(OFFICE, MODELS[series], level, 3, 0.5, sensors=BLIND)
    assert robot.hardest <= MONITOR.creep
    assert robot.world.distance > 0.5


@pytest.mark.nightly
def test_with_sonars_a_careless_driver_hits_hard_without_assistance():
    assert careless_drive(OFFICE, GIRAFF, "off", 3, 1.0, sensors=BLIND).hardest > MONITOR.creep


@pytest.mark.soak
@pytest.mark.parametrize("level", ["slow", "steer"])
def test_careless_driver_with_sonars_and_bumper_for_sixty_minutes(level):
    drives = [
        careless_drive(load_site(site).plan, model, level, seed, 5.0, sensors=BLIND)
        for site in shipped_sites()
        for model in MODELS.values()
        for seed in range(JUDGED, JUDGED + 3)
    ]
    assert sum(drive.world.time for drive in drives) >= 3600.0 - 1.0
    assert [drive.hardest for drive in drives if drive.hardest > MONITOR.creep] == []
    assert sum(drive.world.distance for drive in drives) > 100.0


@pytest.mark.parametrize(
    "fault", [Faults(laser="silent"), Faults(laser="nan")], ids=["silent", "not a number"]
)
@pytest.mark.parametrize("level", ["slow", "steer"])
def test_laser_fault_stops_the_robot_within_1_5_s(fault, level):
    robot = rig("corridor-centre", level)
    drive(robot, AHEAD, 3.0)
    assert robot.world.motion.linear > 0.4
    robot.world.faults = fault
    drive(robot, AHEAD, 1.5)
    assert (robot.why, robot.last_sent) == ("blind", ZERO)
    assert robot.stands
    robot.world.faults = Faults()
    drive(robot, AHEAD, 1.0)
    assert not robot.stands


@pytest.mark.parametrize("speed", [0.2, 0.4, 0.7])
@pytest.mark.parametrize("delay", [0.1, 0.2, 0.4])
def test_robot_stops_before_a_wall_by_readings_that_become_late(speed, delay):
    robot = Rig(Simulation(MODELS["rhodon"], OFFICE, seed=3, start="5.0,1.0,1.5708"), "slow")
    drive(robot, Velocity(linear=speed, angular=0.0), 0.3)
    robot.delay = delay
    drive(robot, Velocity(linear=speed, angular=0.0), 8.0)
    assert (robot.why, robot.touches) == ("stop", 0)
    assert 0.07 < robot.world.clearance() < 0.1


def test_robot_stops_when_readings_become_later_than_a_laser_may_be_silent():
    robot = rig("corridor-centre", "slow")
    drive(robot, AHEAD, 1.0)
    robot.delay = 1.0
    drive(robot, AHEAD, 3.0)
    assert robot.stands
    assert robot.why == "blind"


def test_robot_does_not_move_without_a_first_scan():
    robot = rig("corridor-centre", "slow")
    robot.world.faults = Faults(laser="silent")
    drive(robot, AHEAD, 1.0)
    assert robot.why == "blind"
    assert robot.world.distance == 0.0


def test_robot_accelerates_from_rest_after_a_wheel_fault():
    robot = rig("corridor-centre", "slow")
    robot.world.faults = Faults(wheels_stopped=True)
    drive(robot, AHEAD, 2.0)
    robot.world.faults = Faults()
    drive(robot, AHEAD, 0.1)
    assert 0.0 < robot.world.motion.linear <= GIRAFF.limits.linear_acceleration * 0.1 + 1e-9


@pytest.mark.parametrize("level", ["slow", "steer"])
def test_robot_that_turned_away_from_a_wall_does_not_back_into_it(level):
    robot = rig("corridor-centre", level)
    drive(robot, Velocity(linear=0.5, angular=0.0), 4.0)
    # the wall at its side is behind it, out of the laser's sight
    drive(robot, Velocity(linear=0.0, angular=0.7), 3.2)
    drive(robot, Velocity(linear=-0.3, angular=0.0), 8.0)
    assert robot.touches == 0
    assert robot.world.clearance() < 0.25


def test_steering_leads_a_novice_through_a_door():
    found = novice_drive(OFFICE, GIRAFF, crossings(OFFICE)[0], "steer", 4)
    assert found is not None
    seconds, contacts = found
    assert seconds < 30.0
    assert contacts == 0
