"""The localizer on simulated drives: what it must find, notice and survive."""

import dataclasses
import math

import msgspec
import numpy as np
import pytest

from robots.agent.localization.localizer import Localizer
from robots.agent.simulator.physics.simulation import Simulation
from robots.agent.simulator.wire import Faults
from robots.api.geometry import MapTransform, Pose2D, wrap_angle
from robots.world.grid import MapError, OccupancyGrid
from robots.world.render_plan import rasterise
from robots.world.robot_models import GIRAFF, RHODON, RobotModel
from robots.world.sensing import Estimate, LaserScan
from robots.world.sites import load_site
from tests.support.agents.drawn_map import beams_from, drawn_map, standing
from tests.support.agents.wanderer import TICK, Wanderer, Ways

OFFICE = load_site("office")
WAYS = Ways(OFFICE.grid)
EVERY = round(0.1 / TICK)


class Drive:
    """A robot that wanders about the office, and what it believes."""

    def __init__(
        self,
        seed: int,
        model: RobotModel = GIRAFF,
        people: int = 0,
        start: str = "lab-centre",
        grid: OccupancyGrid = OFFICE.grid,
    ) -> None:
        self.simulation = Simulation(model, OFFICE.plan, seed=seed, start=start, people=people)
        self.wanderer = Wanderer(self.simulation, WAYS, np.random.default_rng([seed, 1]))
        self.localizer = Localizer(grid, np.random.default_rng([seed, 2]))
        self.world_from_map = Pose2D(0.0, 0.0, 0.0)

    def told(self) -> "Drive":
        self.localizer.set_pose(self.world_from_map.compose(self.simulation.pose), 0.1, 0.1)
        return self

    def go(
        self, seconds: float, *, drive: bool = True, docked: bool = False
    ) -> list[tuple[Estimate, float, float]]:
        """Return the estimates of so many seconds, at 10 Hz, and their errors in metres and
        radians.
        """
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
            found.append(
                (
                    estimate,
                    truth.distance(estimate.pose),
                    abs(wrap_angle(estimate.pose.theta - truth.theta)),
                )
            )
        return found


def worst(found: list[tuple[Estimate, float, float]]) -> tuple[float, float]:
    return max(away for _, away, _ in found), max(turned for *_, turned in found)


@pytest.mark.parametrize(("model", "seed"), [(GIRAFF, 1), (RHODON, 2)])
def test_a_robot_that_was_told_where_it_is_keeps_to_it_among_people(
    model: RobotModel, seed: int
) -> None:
    drive = Drive(seed, model, people=3).told()
    drive.go(2.0)
    found = drive.go(25.0)
    assert all(estimate.localized for estimate, *_ in found)
    away, turned = worst(found)
    assert away < 0.2
    assert turned < math.radians(5.0)
    assert np.median([away for _, away, _ in found]) < 0.07


def test_a_robot_that_was_told_nothing_finds_itself() -> None:
    drive = Drive(3)
    first = drive.localizer.update(0.0, drive.simulation.odometry, drive.simulation.beams())
    assert not first.localized
    assert first.score == 0.0
    assert first.covariance[0] > 100.0
    estimate, away, turned = drive.go(12.0)[-1]
    assert estimate.localized
    assert away < 0.1
    assert turned < math.radians(3.0)


def test_a_robot_that_was_carried_away_notices_and_finds_itself_again() -> None:
    drive = Drive(4).told()
    drive.go(3.0)
    drive.wanderer.carry_away()
    found = drive.go(20.0)
    assert not all(estimate.localized for estimate, *_ in found[:50])
    assert found[-1][0].localized
    assert found[-1][1] < 0.1


def test_until_it_is_sure_again_a_robot_that_was_carried_away_says_that_it_is_lost() -> None:
    drive = Drive(5).told()
    drive.go(3.0)
    drive.wanderer.carry_away()
    later = drive.go(20.0)[50:]
    assert not any(estimate.localized and away > 0.5 for estimate, away, _ in later)


def test_a_pose_that_was_set_by_hand_some_way_off_is_put_right() -> None:
    drive = Drive(6)
    truth = drive.simulation.pose
    drive.localizer.set_pose(Pose2D(truth.x + 0.4, truth.y - 0.3, truth.theta + 0.25))
    estimate, away, _ = drive.go(5.0)[-1]
    assert estimate.localized
    assert away < 0.1


def test_a_pose_that_was_set_wrongly_is_not_believed() -> None:
    drive = Drive(7)
    drive.localizer.set_pose(Pose2D(9.0, 1.0, 0.0), 0.2)
    found = drive.go(15.0)
    assert not any(estimate.localized and away > 0.5 for estimate, away, _ in found)
    assert found[-1][0].localized


def test_forgetting_begins_anew() -> None:
    drive = Drive(8).told()
    assert drive.go(3.0)[-1][0].localized
    drive.localizer.forget()
    assert not drive.go(0.1)[0][0].localized
    assert drive.go(12.0)[-1][0].localized


def test_the_same_seed_gives_the_same_estimates() -> None:
    once, twice = (Drive(9, people=2).told().go(3.0) for _ in range(2))
    assert [estimate for estimate, *_ in once] == [estimate for estimate, *_ in twice]


def test_a_robot_that_stands_stays_where_it_is_and_gets_no_surer_than_it_can_be() -> None:
    drive = Drive(10).told()
    found = drive.go(30.0, drive=False)
    away, _ = worst(found[20:])
    assert away < 0.05
    assert found[-1][0].localized
    assert found[-1][0].covariance[0] >= 0.02**2


def test_a_robot_that_is_carried_away_while_it_stands_notices() -> None:
    drive = Drive(11).told()
    drive.go(3.0, drive=False)
    drive.simulation.carry_to(Pose2D(9.0, 1.0, 0.5))
    found = drive.go(10.0, drive=False)
    assert not all(estimate.localized for estimate, *_ in found)
    assert not any(estimate.localized and away > 0.5 for estimate, away, _ in found[50:])


@pytest.mark.parametrize("fault", ["silent", "nan"])
def test_without_a_laser_trust_fades_with_the_way_and_comes_back_with_it(fault: str) -> None:
    drive = Drive(12).told()
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


def test_a_silent_laser_does_not_make_a_standing_robot_lost() -> None:
    drive = Drive(13).told()
    drive.go(3.0)
    while drive.simulation.motion.linear or drive.simulation.motion.angular:
        drive.simulation.step(TICK)
    drive.go(0.5, drive=False)
    drive.simulation.faults = Faults(laser="silent")
    assert drive.go(20.0, drive=False)[-1][0].localized


def test_an_odometry_that_starts_again_at_zero_moves_nobody() -> None:
    drive = Drive(14).told()
    drive.go(4.0)
    drive.simulation.odometry = Pose2D(0.0, 0.0, 0.0)
    found = drive.go(10.0)
    assert worst(found)[0] < 0.3
    assert found[-1][0].localized
    assert drive.localizer.track.jumps == 1


def test_an_odometry_that_is_no_number_is_left_out() -> None:
    drive = Drive(15).told()
    drive.go(2.0)
    estimate = drive.localizer.update(
        drive.simulation.time, Pose2D(math.nan, 0.0, math.nan), drive.simulation.beams()
    )
    assert drive.simulation.pose.distance(estimate.pose) < 0.2


def test_a_sweep_of_an_earlier_moment_counts_for_that_moment() -> None:
    drive = Drive(16).told()
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


def test_people_all_around_a_standing_robot_do_not_move_it() -> None:
    drive = Drive(17).told()
    drive.go(3.0, drive=False)
    truth = drive.simulation.beams()
    assert truth is not None
    for number in range(100):
        hidden = truth.ranges.copy()
        hidden[: len(hidden) * 2 // 3] = np.minimum(hidden[: len(hidden) * 2 // 3], 0.6)
        beams = dataclasses.replace(truth, stamp=truth.stamp + 0.1 * number, ranges=hidden)
        estimate = drive.localizer.update(beams.stamp, drive.simulation.odometry, beams)
    assert drive.simulation.pose.distance(estimate.pose) < 0.1


def mirrored(beams: LaserScan, share: float) -> LaserScan:
    """Return a sweep in which the middle beams went through glass, or came back from a mirror:
    twice as far.
    """
    ranges = beams.ranges.copy()
    middle, half = len(ranges) // 2, int(len(ranges) * share / 2)
    ranges[middle - half : middle + half] *= 2.0
    return dataclasses.replace(beams, ranges=ranges)


def test_a_mirror_or_a_pane_of_glass_before_the_robot_does_not_move_it() -> None:
    drive = Drive(18).told()
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


def test_a_robot_whose_laser_is_covered_says_that_it_does_not_know() -> None:
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


def test_beside_a_leaf_that_hides_half_the_view_no_corner_across_the_building_is_believed() -> None:
    """There more of the beams end at walls than here, but some go through walls as well."""
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


def test_in_a_room_that_looks_the_same_from_four_sides_nobody_is_sure() -> None:
    localizer = Localizer(drawn_map(SQUARE, scale=4), np.random.default_rng(20))
    sides, odometry = standing(SQUARE, 0.2), Pose2D(0.0, 0.0, 0.0)
    start = Pose2D(1.0, 1.4, 0.3)
    for number in range(80):
        odometry = odometry.compose(Pose2D(0.02, 0.0, 0.05))
        estimate = localizer.update(
            0.1 * number, odometry, beams_from(sides, start.compose(odometry), stamp=0.1 * number)
        )
        assert not estimate.localized


def test_a_map_that_hangs_askew_gives_poses_of_the_world() -> None:
    askew = Pose2D(4.0, -3.0, 0.6)
    transform = MapTransform(
        OFFICE.grid.transform.resolution,
        askew.compose(OFFICE.grid.transform.origin),
        OFFICE.grid.transform.height,
    )
    drive = Drive(21, grid=dataclasses.replace(OFFICE.grid, transform=transform))
    drive.world_from_map = askew
    away, turned = worst(drive.told().go(10.0)[20:])
    assert away < 0.2
    assert turned < math.radians(5.0)


def test_the_covariance_is_turned_into_the_world() -> None:
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
def test_a_map_without_free_space_is_refused_with_the_reason(picture: str) -> None:
    with pytest.raises(MapError, match="no free space"):
        Localizer(drawn_map(picture), np.random.default_rng(1))


def test_no_update_does_more_than_a_slice_of_a_search(monkeypatch: pytest.MonkeyPatch) -> None:
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


def test_a_docked_robot_does_not_take_its_station_for_the_wall_behind() -> None:
    bare = rasterise(msgspec.structs.replace(OFFICE.plan, docks=()))
    found = Drive(1, RHODON, start="dock", grid=bare).told().go(10.0, drive=False, docked=True)
    assert all(estimate.localized for estimate, *_ in found)
    assert worst(found)[0] < 0.05


def test_a_robot_that_charges_elsewhere_than_it_was_told_finds_itself() -> None:
    drive = Drive(1, RHODON)
    dock = OFFICE.plan.dock_of("rhodon")
    assert dock is not None
    drive.localizer.set_pose(Pose2D(dock.x, dock.y, dock.theta), 0.05, 0.07)
    estimate, away, _ = drive.go(20.0, drive=False, docked=True)[-1]
    assert estimate.localized
    assert away < 0.1
