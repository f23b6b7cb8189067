"""Paths on a map drawn as text."""

import math

import numpy as np
import pytest
from hypothesis import example, given, strategies as st

from robots.agent.navigation.planning.costmap import CostMap, NoWayError
from robots.agent.navigation.planning.path import PlannedPath, resampled
from robots.agent.navigation.planning.planner import Planner
from robots.api.geometry import MapTransform, Pose2D
from robots.world.grid import FREE, OCCUPIED, UNKNOWN, OccupancyGrid
from robots.world.sensing import CENTRE
from tests.support.examples import examples

SQUARE = np.array([[0.2, -0.2], [0.2, 0.2], [-0.2, 0.2], [-0.2, -0.2]])
TILE = 4  # cells of 5 cm for each character: 20 cm
TILES = {"#": OCCUPIED, ".": FREE, "?": UNKNOWN}

ROOMS = """
####################
#.......#..........#
#.......#..........#
#.......#..........#
#.......#..........#
#.......#..........#
#..................#
#..................#
#..................#
#..................#
####################
"""


def drawn(picture: str, origin: Pose2D = CENTRE) -> OccupancyGrid:
    rows = [[TILES[tile] for tile in line] for line in picture.split()]
    image = np.kron(np.array(rows, dtype=np.uint8), np.ones((TILE, TILE), dtype=np.uint8))
    return OccupancyGrid(image, MapTransform(0.05, origin, image.shape[0]))


def planner(picture: str = ROOMS, origin: Pose2D = CENTRE) -> Planner:
    return Planner(CostMap(drawn(picture, origin), SQUARE))


def path_between(
    made: Planner, start: tuple[float, float], goal: tuple[float, float]
) -> PlannedPath:
    found = made.plan(start, goal, made.costmap.clearance)
    assert found is not None
    return found


def clearance(made: Planner, path: PlannedPath) -> np.ndarray:
    """Return (n,) the clearance in metres of a path's points."""
    return made.costmap.sample(made.costmap.clearance, path.points)


def test_a_path_leads_round_a_wall_and_keeps_the_robot_clear_of_it() -> None:
    made = planner()
    found = path_between(made, (0.8, 1.7), (2.6, 1.7))
    assert found.points[0] == pytest.approx((0.8, 1.7))
    assert found.end == pytest.approx((2.6, 1.7))
    assert (clearance(made, found) >= made.costmap.least - 0.05).all()
    assert 2.2 < found.length < 3.6


def test_a_blocked_gap_leaves_no_path_or_a_detour() -> None:
    made = planner()
    live = np.zeros(made.costmap.shape, dtype=np.bool_)
    rows, columns, _ = made.costmap.cells(np.array([[1.7, y] for y in np.arange(0.2, 1.0, 0.05)]))
    live[rows, columns] = True
    assert made.plan((0.8, 1.7), (2.6, 1.7), made.costmap.clearance_with(live)) is None
    one = np.zeros(made.costmap.shape, dtype=np.bool_)
    one[made.costmap.cells(np.array([[2.7, 1.0]]))[:2]] = True
    detour = made.plan((2.3, 0.5), (3.1, 1.5), made.costmap.clearance_with(one))
    assert detour is not None
    assert np.hypot(*(detour.points - (2.7, 1.0)).T).min() > made.costmap.inscribed


def test_unknown_cells_are_not_free() -> None:
    made = planner("######\n#????#\n#?..?#\n#....#\n#....#\n#....#\n######".replace("\n", " "))
    with pytest.raises(NoWayError):
        planner("?????\n?????\n?????")
    assert float(made.costmap.sample(made.costmap.clearance, np.array([[0.3, 1.1]]))[0]) == 0.0


@pytest.mark.parametrize(
    ("goal", "reason"),
    [
        ((9.0, 1.0), "outside: "),
        ((math.nan, 1.0), "no_goal"),
        ((1.7, 1.6), None),
        ((2.6, 1.6), None),
    ],
)
def test_a_goal_in_the_edge_of_a_wall_is_moved_and_one_off_the_map_refused(
    goal: tuple[float, float], reason: str | None
) -> None:
    made = planner()
    if reason:
        with pytest.raises(NoWayError, match=reason):
            made.goal(*goal)
    else:
        assert math.dist(made.goal(*goal), goal) <= 0.5


def test_a_goal_deep_in_a_wall_is_refused() -> None:
    picture = "####################\n" * 6 + "#..................#\n" * 5 + "####################"
    with pytest.raises(NoWayError, match="in_wall: "):
        planner(picture).goal(2.0, 1.9)


def test_a_turned_map_gives_the_same_path_in_its_own_frame() -> None:
    frame = Pose2D(3.0, -1.0, 0.7)
    ends = (0.8, 1.7), (2.6, 1.7)
    straight = path_between(planner(), *ends)
    turned = path_between(planner(ROOMS, frame), *(frame.apply(*end) for end in ends))
    assert turned.length == pytest.approx(straight.length, rel=0.02)


def test_a_finer_map_is_coarsened_and_its_origin_stays() -> None:
    coarse = drawn(ROOMS)
    image = np.kron(coarse.image, np.ones((2, 2), dtype=np.uint8))[1:, :-1]
    fine = CostMap(
        OccupancyGrid(image, MapTransform(0.025, coarse.transform.origin, image.shape[0])), SQUARE
    )
    assert fine.transform.resolution == pytest.approx(0.05)
    whole = CostMap(coarse, SQUARE)
    points = np.array([[0.8, 0.8], [2.5, 1.2], [1.5, 0.5]])
    assert fine.sample(fine.clearance, points) == pytest.approx(
        whole.sample(whole.clearance, points), abs=0.051
    )


@examples(25, thorough=250)
# the last leg before a wall touches it, whichever single cell is blocked
@example((1.0, 0.5), (3.59375, 1.78125))
@given(
    st.tuples(st.floats(0.3, 3.7), st.floats(0.3, 1.9)),
    st.tuples(st.floats(0.3, 3.7), st.floats(0.3, 1.9)),
)
def test_every_path_joins_start_and_goal_without_touching(
    start: tuple[float, float], goal: tuple[float, float]
) -> None:
    made = planner()
    begin, end = made.goal(*start), made.goal(*goal)
    found = path_between(made, begin, end)
    assert (found.points[0], found.points[-1]) == (pytest.approx(begin), pytest.approx(end))
    assert clearance(made, found).min() > made.costmap.inscribed - 0.05
    assert float(np.hypot(*np.diff(found.points, axis=0).T).max(initial=0.0)) < 0.11


def test_a_line_is_resampled_with_its_ends_and_corners_kept_near() -> None:
    line = resampled(np.array([[0.0, 0.0], [0.0, 0.0], [1.0, 0.0], [1.0, 1.0]]), 0.1)
    assert len(line) == 21
    assert line[10] == pytest.approx((1.0, 0.0))
    path = PlannedPath(line)
    assert path.at(1.5) == pytest.approx((1.0, 0.5))
    assert path.sharpest_bend(0.0, 0.7) == pytest.approx(0.0, abs=1e-9)
    assert path.sharpest_bend(0.5, 1.5) > 5.0
    assert path.nearest(1.2, 0.5, 0.0, 2.0) == pytest.approx(1.5)
