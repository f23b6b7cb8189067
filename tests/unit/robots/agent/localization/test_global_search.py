"""A pose on the whole map from one scan."""

import math

import numpy as np
import pytest

from robots.agent.localization.field import field_of
from robots.agent.localization.global_search import Found, GlobalSearch, Searching
from robots.agent.localization.particle_filter import wrapped
from robots.agent.localization.sensor_model import SensorModel, Sweep, sweep_of
from robots.api.geometry import Pose2D
from tests.support.agents.drawn_map import beams_from, drawn_map, standing

FLAT = """
#################################
#..........#....................#
#..........#....................#
#...............................#
#...............................#
#..........#....................#
#..........#.......###..........#
#####..#########################
#..........#...........#........#
#..........#...........#........#
#...#......#....................#
#......................#........#
#................##....#........#
#################################
"""
SQUARE = "\n".join(["#" * 16] + ["#" + "." * 14 + "#"] * 14 + ["#" * 16])
REACH = 8.0


def search(picture: str, settings: Searching | None = None) -> GlobalSearch:
    return GlobalSearch(
        field_of(drawn_map(picture, scale=4)), SensorModel(), settings or Searching()
    )


def seen(picture: str, pose: Pose2D) -> Sweep:
    return sweep_of(beams_from(standing(picture, 0.2), pose, reach=REACH), 0.1)


def finish(whole: GlobalSearch, sweep: Sweep) -> tuple[Found, int]:
    slices = 0
    running = whole.begin(sweep)
    while True:
        try:
            next(running)
        except StopIteration as end:
            return end.value, slices
        slices += 1


def in_world(whole: GlobalSearch, poses: np.ndarray) -> list[Pose2D]:
    return [whole.field.world_from_field.compose(Pose2D(*pose)) for pose in poses.tolist()]


@pytest.mark.parametrize(
    "pose",
    [Pose2D(1.0, 1.7, 0.3), Pose2D(4.5, 1.9, -2.0), Pose2D(5.2, 0.6, 1.2), Pose2D(1.6, 1.0, 0.0)],
)
def test_one_scan_in_a_flat_of_many_corners_finds_the_pose(pose: Pose2D) -> None:
    whole = search(FLAT)
    found, _ = finish(whole, seen(FLAT, pose))
    best = in_world(whole, found.poses)[0]
    assert best.distance(pose) < 0.05
    assert abs(wrapped(np.array([best.theta - pose.theta]))[0]) < math.radians(2.0)
    assert found.merit[0] > 0.85


def test_a_square_room_has_four_candidates() -> None:
    whole, pose = search(SQUARE), Pose2D(1.0, 1.3, 0.4)
    found, _ = finish(whole, seen(SQUARE, pose))
    for quarter in range(4):
        turn = Pose2D(1.6, 1.6, quarter * math.pi / 2.0).compose(Pose2D(-1.6, -1.6, 0.0))
        twin = turn.compose(pose)
        assert min(other.distance(twin) for other in in_world(whole, found.poses)) < 0.1


def test_the_work_is_done_in_slices_of_the_given_size() -> None:
    few, many = (search(FLAT, Searching(slice=size)) for size in (400_000, 20_000))
    sweep = seen(FLAT, Pose2D(1.0, 1.7, 0.3))
    found_in_few, slices = finish(few, sweep)
    found_in_many, more = finish(many, sweep)
    assert more > 3 * slices
    assert found_in_many.poses == pytest.approx(found_in_few.poses)


def test_no_beams_find_nothing() -> None:
    empty = Sweep(np.zeros((0, 2)), 0.0, 0.0, np.zeros(0), np.zeros(0), REACH)
    assert len(finish(search(FLAT), empty)[0].poses) == 0


def test_a_map_with_little_free_space_has_places_for_a_search() -> None:
    picture = "###\n#.#\n###"
    whole = GlobalSearch(field_of(drawn_map(picture, scale=2)), SensorModel(), Searching())
    assert len(whole.places) > 0
