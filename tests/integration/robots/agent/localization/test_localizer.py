"""The localizer on simulated drives: accuracy, detection of a lost pose, and faults."""

import dataclasses
import math

import msgspec
import numpy as np
import pytest

from robots.agent.localization.localizer import Localizer
from robots.api.geometry import MapTransform, Pose2D, wrap_angle
from robots.simulator.physics.simulation import Simulation
from robots.simulator.wire import Faults
from robots.world.grid import MapError
from robots.world.render_plan import rasterise
from robots.world.robot_models import GIRAFF, RHODON
from robots.world.sensing import LaserScan
from robots.world.sites import load_site
from tests.support.agents.drawn_map import beams_from, drawn_map, standing
from tests.support.agents.wanderer import TICK, Wanderer, Ways

OFFICE = load_site("office")
WAYS = Ways(OFFICE.grid)
EVERY = round(0.1 / TICK)


class Drive:
    """A robot that wanders about the office, and its localizer."""

    def __init__(self, seed, model=GIRAFF, people=0, start="lab-centre", grid=OFFICE.grid):
        self.simulation = Simulation(model, OFFICE.plan, seed=seed, start=start, people=people)
        self.wanderer = Wanderer(self.simulation, WAYS, np.random.default_rng([seed, 1]))
        self.localizer = Localizer(grid, np.random.default_rng([seed, 2]))
        self.world_from_map = Pose2D(0.0, 0.0, 0.0)

    def placed(self):
        """Give the localizer the true pose."""
        self.localizer.set_pose(self.world_from_map.compose(self.simulation.pose), 0.1, 0.1)
        return self

    def go(self, seconds, *, drive=True, docked=False):
        """Return the estimates of so many seconds, at 10 Hz, with their errors: metres, radians."""
        found = []
        for _ in range(round(seconds * 10)):
            for _ in range(EVERY):
                self.wanderer.step() if drive else self.simulation.step(TICK)
            estimate = self.localizer.update(
                self.simulation.time,
                self.simulation.odometry,
                self.simulation.beams(),
                docked=docked,
            )
            truth = self.world_from_map.compose(self.simulation.pose)
            turned = abs(wrap_angle(estimate.pose.theta - truth.theta))
            found.append((estimate, truth.distance(estimate.pose), turned))
        return found


def worst(found):
    return max(away for _, away, _ in found), max(turned for *_, turned in found)


@pytest.mark.parametrize(("model", "seed"), [(GIRAFF, 1), (RHODON, 2)])
def test_given_pose_is_tracked_among_people(model, seed):
    drive = Drive(seed, model, people=3).placed()
    drive.go(2.0)
    found = drive.go(25.0)
    assert all(estimate.localized for estimate, *_ in found)
    away, turned = worst(found)
    assert away < 0.2
    assert turned < math.radians(5.0)
    assert np.median([away for _, away, _ in found]) < 0.07


def test_robot_without_a_pose_localizes_itself():
    drive = Drive(3)
    first = drive.localizer.update(0.0, drive.simulation.odometry, drive.simulation.beams())
    assert not first.localized
    assert first.score == 0.0
    assert first.covariance[0] > 100.0
    estimate, away, turned = drive.go(12.0)[-1]
    assert estimate.localized
    assert away < 0.1
    assert turned < math.radians(3.0)


@pytest.mark.parametrize("seed", [4, 5])
def test_robot_carried_away_localizes_itself_and_never_at_a_wrong_pose(seed):
    drive = Drive(seed).placed()
    drive.go(3.0)
    drive.wanderer.carry_away()
    found = drive.go(20.0)
    assert not all(estimate.localized for estimate, *_ in found[:50])
    assert not any(estimate.localized and away > 0.5 for estimate, away, _ in found[50:])
    assert found[-1][0].localized
    assert found[-1][1] < 0.1


def test_wrong_pose_is_rejected():
    drive = Drive(7)
    drive.localizer.set_pose(Pose2D(9.0, 1.0, 0.0), 0.2)
    found = drive.go(15.0)
    assert not any(estimate.localized and away > 0.5 for estimate, away, _ in found)
    assert found[-1][0].localized


def test_forgotten_pose_is_searched_again():
    drive = Drive(8).placed()
    assert drive.go(3.0)[-1][0].localized
    drive.localizer.forget()
    assert not drive.go(0.1)[0][0].localized
    assert drive.go(12.0)[-1][0].localized


def test_same_seed_gives_the_same_estimates():
    once, twice = (Drive(9, people=2).placed().go(3.0) for _ in range(2))
    assert [estimate for estimate, *_ in once] == [estimate for estimate, *_ in twice]


def test_pose_at_rest_does_not_drift_and_its_covariance_is_bounded_below():
    drive = Drive(10).placed()
    found = drive.go(30.0, drive=False)
    away, _ = worst(found[20:])
    assert away < 0.05
    assert found[-1][0].localized
    assert found[-1][0].covariance[0] >= 0.02**2


def test_robot_that_is_carried_away_at_rest_is_not_localized_at_a_wrong_pose():
    drive = Drive(11).placed()
    drive.go(3.0, drive=False)
    drive.simulation.carry_to(Pose2D(9.0, 1.0, 0.5))
    found = drive.go(10.0, drive=False)
    assert not all(estimate.localized for estimate, *_ in found)
    assert not any(estimate.localized and away > 0.5 for estimate, away, _ in found[50:])


@pytest.mark.parametrize("fault", ["silent", "nan"])
def test_confidence_decreases_with_distance_without_a_laser_and_returns_with_it(fault):
    drive = Drive(12).placed()
    before = drive.go(3.0)[-1][0]
    drive.simulation.faults = Faults(laser=fault)
    blind = [estimate for estimate, *_ in drive.go(25.0)]
    assert blind[-1].score < 0.5 < before.score
    assert not blind[-1].localized
    assert blind[-1].covariance[0] > 4 * before.covariance[0]
    drive.simulation.faults = Faults()
    estimate, away, _ = drive.go(15.0)[-1]
    assert estimate.localized
    assert away < 0.1


def test_robot_at_rest_stays_localized_without_a_laser():
    drive = Drive(13).placed()
    drive.go(3.0)
    while drive.simulation.motion.linear or drive.simulation.motion.angular:
        drive.simulation.step(TICK)
    drive.go(0.5, drive=False)
    drive.simulation.faults = Faults(laser="silent")
    assert drive.go(20.0, drive=False)[-1][0].localized


def test_reset_odometry_does_not_move_the_pose():
    drive = Drive(14).placed()
    drive.go(4.0)
    drive.simulation.odometry = Pose2D(0.0, 0.0, 0.0)
    found = drive.go(10.0)
    assert worst(found)[0] < 0.3
    assert found[-1][0].localized
    assert drive.localizer.track.jumps == 1


def test_odometry_that_is_not_a_number_is_ignored():
    drive = Drive(15).placed()
    drive.go(2.0)
    estimate = drive.localizer.update(
        drive.simulation.time, Pose2D(math.nan, 0.0, math.nan), drive.simulation.beams()
    )
    assert drive.simulation.pose.distance(estimate.pose) < 0.2


def test_late_scan_is_matched_at_its_own_time():
    drive = Drive(16).placed()
    drive.go(3.0)
    simulation = drive.simulation
    errors = []
    for _ in range(60):
        old = simulation.beams()
        for _ in range(10):  # 0.2 s, in which it turns by eight degrees
            simulation.command(0.0, 0.7)
            simulation.step(TICK)
            estimate = drive.localizer.update(simulation.time, simulation.odometry, None)
        estimate = drive.localizer.update(simulation.time, simulation.odometry, old)
        errors.append(abs(wrap_angle(estimate.pose.theta - simulation.pose.theta)))
    assert max(errors) < math.radians(3.0)


def test_people_around_a_robot_at_rest_do_not_move_its_pose():
    drive = Drive(17).placed()
    drive.go(3.0, drive=False)
    truth = drive.simulation.beams()
    assert truth is not None
    for number in range(100):
        hidden = truth.ranges.copy()
        hidden[: len(hidden) * 2 // 3] = np.minimum(hidden[: len(hidden) * 2 // 3], 0.6)
        beams = dataclasses.replace(truth, stamp=truth.stamp + 0.1 * number, ranges=hidden)
        estimate = drive.localizer.update(beams.stamp, drive.simulation.odometry, beams)
    assert drive.simulation.pose.distance(estimate.pose) < 0.1


def mirrored(beams, share):
    """Return a scan whose middle beams are twice as long, as behind glass or by a mirror."""
    ranges = beams.ranges.copy()
    middle, half = len(ranges) // 2, int(len(ranges) * share / 2)
    ranges[middle - half : middle + half] *= 2.0
    return dataclasses.replace(beams, ranges=ranges)


def test_mirror_or_glass_in_front_of_the_robot_does_not_move_its_pose():
    drive = Drive(18).placed()
    drive.go(2.0)
    for _ in range(100):
        for _ in range(EVERY):
            drive.wanderer.step()
        beams = drive.simulation.beams()
        assert beams is not None
        estimate = drive.localizer.update(
            drive.simulation.time, drive.simulation.odometry, mirrored(beams, 0.15)
        )
        assert drive.simulation.pose.distance(estimate.pose) < 0.15
    assert estimate.localized


def test_robot_with_a_covered_laser_is_not_localized():
    localizer = Localizer(OFFICE.grid, np.random.default_rng(19))
    for number in range(30):
        estimate = localizer.update(
            0.1 * number,
            Pose2D(0.0, 0.0, 0.0),
            LaserScan(0.1 * number, -2.0, 0.02, 10.0, np.full(200, 0.05)),
        )
    assert not estimate.localized
    assert estimate.score == 0.0


SQUARE = "\n".join(["#" * 20] + ["#" + "." * 18 + "#"] * 18 + ["#" * 20])


def test_open_door_that_hides_half_the_view_causes_no_wrong_pose():
    """From there more beams would end at walls, but others would pass through walls."""
    drive = Drive(1, start="10.85,2.65,1.68")
    assert drive.simulation.doors["lounge-door"] == "open"
    for second in range(14):
        turn = 0.0 if second < 3 else -0.45 if 7 <= second < 11 else 0.45
        for _ in range(10):
            drive.simulation.command(0.0, turn)
            [(estimate, away, turned)] = drive.go(0.1, drive=False)
            assert not (estimate.localized and away > 0.3)
    assert estimate.localized
    assert away < 0.1
    assert turned < math.radians(3.0)


def test_robot_in_a_symmetric_room_is_not_localized():
    localizer = Localizer(drawn_map(SQUARE, scale=4), np.random.default_rng(20))
    sides, odometry = standing(SQUARE, 0.2), Pose2D(0.0, 0.0, 0.0)
    start = Pose2D(1.0, 1.4, 0.3)
    for number in range(80):
        odometry = odometry.compose(Pose2D(0.02, 0.0, 0.05))
        estimate = localizer.update(
            0.1 * number, odometry, beams_from(sides, start.compose(odometry), stamp=0.1 * number)
        )
        assert not estimate.localized


def test_rotated_map_gives_poses_in_the_world_frame():
    askew = Pose2D(4.0, -3.0, 0.6)
    transform = MapTransform(
        OFFICE.grid.transform.resolution,
        askew.compose(OFFICE.grid.transform.origin),
        OFFICE.grid.transform.height,
    )
    drive = Drive(21, grid=dataclasses.replace(OFFICE.grid, transform=transform))
    drive.world_from_map = askew
    away, turned = worst(drive.placed().go(10.0)[20:])
    assert away < 0.2
    assert turned < math.radians(5.0)


def test_covariance_is_in_the_world_frame():
    corridor = "#" * 150 + ("\n" + "." * 150) * 8 + "\n" + "#" * 150
    askew = Pose2D(0.0, 0.0, math.pi / 2.0)
    localizer = Localizer(drawn_map(corridor, scale=4, origin=askew), np.random.default_rng(22))
    sides, start = standing(corridor, 0.2, askew), askew.compose(Pose2D(15.0, 1.0, 0.0))
    localizer.set_pose(start, 0.4, 0.05)
    for number in range(40):
        odometry = Pose2D(0.02 * number, 0.0, 0.0)
        seen = beams_from(sides, start.compose(odometry), stamp=0.1 * number, reach=6.0)
        estimate = localizer.update(0.1 * number, odometry, seen)
    along, across = estimate.covariance[3], estimate.covariance[0]
    assert along > 10 * across


@pytest.mark.parametrize("picture", ["####\n####", "    \n   #"])
def test_map_without_free_space_is_refused_with_the_reason(picture):
    with pytest.raises(MapError, match="no free space"):
        Localizer(drawn_map(picture), np.random.default_rng(1))


def test_each_update_runs_one_slice_of_a_search(monkeypatch):
    drive = Drive(23)
    slices = []
    ahead = drive.localizer._search_on
    monkeypatch.setattr(
        drive.localizer, "_search_on", lambda: slices.append(drive.localizer._searching) or ahead()
    )
    for number in range(1, 6):
        drive.go(0.1)
        assert len(slices) == number
    assert len({id(search) for search in slices}) == 1


def test_docked_robot_does_not_confuse_its_station_with_the_wall_behind_it():
    bare = rasterise(msgspec.structs.replace(OFFICE.plan, docks=()))
    found = Drive(1, RHODON, start="dock", grid=bare).placed().go(10.0, drive=False, docked=True)
    assert all(estimate.localized for estimate, *_ in found)
    assert worst(found)[0] < 0.05


def test_wrong_docked_pose_is_corrected():
    drive = Drive(1, RHODON)
    dock = OFFICE.plan.dock_of("rhodon")
    assert dock is not None
    drive.localizer.set_pose(Pose2D(dock.x, dock.y, dock.theta), 0.05, 0.07)
    estimate, away, _ = drive.go(20.0, drive=False, docked=True)[-1]
    assert estimate.localized
    assert away < 0.1
