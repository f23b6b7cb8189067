"""Plans that are proposed for maps of a building that is known."""

import dataclasses
import functools
import math

import numpy as np
import pytest

from robots.api import floorplan
from robots.api.floorplan import FloorPlan, contains
from robots.api.geometry import MapTransform, Pose2D
from robots.world.grid import FREE, OCCUPIED, UNKNOWN, OccupancyGrid
from robots.world.inspection import inspect_site
from robots.world.solids import furniture_solid, inside
from robots.world.tracing.docks import propose_docks
from robots.world.tracing.layers import Layers
from robots.world.tracing.proposal import Titles, propose_plan
from robots.world.tracing.structure import TracingError, structure_of
from robots.world.tracing.walls import Segment
from tests.support.agents.mapped_building import building, mapped
from tests.support.examples import repetitions

SEVEN = math.radians(7.0)
NEAR = 0.1  # metres that a traced wall may be off


def proposed(plan: FloorPlan, seed: int = 0, **how: bool) -> tuple[FloorPlan, OccupancyGrid]:
    grid = mapped(plan, np.random.default_rng(seed), **how)
    return propose_plan(grid, "traced", "Traced"), grid


@functools.cache
def furnished(door: float, turned: float, seed: int) -> tuple[FloorPlan, FloorPlan, OccupancyGrid]:
    """Return the building, the plan that is proposed of its map, and the map."""
    truth = building(door, furnished=True, turned=turned)
    return truth, *proposed(truth, seed, window=True)


def segments(plan: FloorPlan) -> list[Segment]:
    return [Segment(wall.start, wall.end, wall.thickness) for wall in plan.walls]


def along(segment: Segment) -> np.ndarray:
    return np.linspace(segment.start, segment.end, max(2, int(segment.length / 0.1)))


def centres(grid: OccupancyGrid, mask: np.ndarray) -> np.ndarray:
    """Return the centres (n, 2) of a mask's cells in the world."""
    return np.array(
        [grid.transform.to_world(c + 0.5, r + 0.5) for r, c in np.argwhere(mask).tolist()]
    )


def turn(a: float, b: float) -> float:
    return abs((a - b + math.pi / 2.0) % math.pi - math.pi / 2.0)


@pytest.mark.parametrize("turned", [0.0, SEVEN, math.radians(33.0)])
@pytest.mark.parametrize("door", [0.8, 1.0, 1.2])
@pytest.mark.parametrize("seed", range(1, repetitions(2, thorough=11)))
class TestBuilding:
    """With gaps, speckles, an unknown surrounding, and furniture."""

    def test_walls_are_straight_and_where_they_are(self, turned, door, seed):
        truth, plan, _ = furnished(door, turned, seed)
        found = segments(plan)
        for wall in segments(truth):
            points = along(wall)
            nearest = np.min([other.distances(points) for other in found], axis=0)
            # a wall's ends lie in its neighbours
            assert (nearest <= NEAR).mean() >= 0.9, wall
        for wall in found:
            near = [t for t in segments(truth) if t.distances(along(wall)).max() <= 0.2]
            assert near, f"{wall} is no wall"
            assert min(turn(wall.direction, t.direction) for t in near) <= math.radians(1.5)

    def test_each_room_is_one_room(self, turned, door, seed):
        truth, plan, grid = furnished(door, turned, seed)
        assert len(plan.rooms) == 3
        points = centres(grid, grid.free())[::7].tolist()
        for room in truth.rooms:
            mine = [p for p in points if contains(room.polygon, *p)]
            shares = [np.mean([contains(r.polygon, *p) for p in mine]) for r in plan.rooms]
            assert max(shares) >= 0.9, room.name

    def test_each_doorway_is_found_with_its_width(self, turned, door, seed):
        truth, plan, _ = furnished(door, turned, seed)
        assert len(plan.passages) == 2
        for doorway in truth.passages:
            middle = np.mean([doorway.start, doorway.end], axis=0)
            best = min(
                plan.passages,
                key=lambda p: math.dist(np.mean([p.start, p.end], axis=0), middle),
            )
            assert math.dist(np.mean([best.start, best.end], axis=0), middle) <= 0.25
            assert math.dist(best.start, best.end) == pytest.approx(door, abs=0.2)

    def test_the_plan_is_usable_without_edits(self, turned, door, seed):
        _, plan, grid = furnished(door, turned, seed)
        assert floorplan.decode(floorplan.encode(plan)) == plan
        assert inspect_site(plan, grid) == ()
        assert {dock.type for dock in plan.docks} == {"giraff", "rhodon"}
        assert len(plan.places) == 3


def test_free_standing_furniture_is_an_obstacle_and_no_wall():
    truth = building(furnished=True)
    plan, grid = proposed(truth, noise=False)
    for piece in truth.furniture[:2]:
        outline = furniture_solid(piece).outline
        for wall in segments(plan):
            x, y = along(wall).T
            assert not inside(outline, x, y).any()
        points = centres(grid, grid.occupied())
        mine = points[inside(outline, *points.T)]
        covered = np.zeros(len(mine), dtype=np.bool_)
        for obstacle in plan.furniture:
            covered |= inside(furniture_solid(obstacle).outline, *mine.T)
        assert len(mine) > 20
        assert covered.mean() >= 0.95
    assert any(piece.shape == "cylinder" for piece in plan.furniture)


@pytest.mark.parametrize("thick", range(6))
def test_a_station_is_at_a_wall_that_the_map_has_where_the_plan_has_it(thick):
    truth = building()
    layers = Layers.of(mapped(truth, np.random.default_rng(0), noise=False))
    origin = layers.world_from_map
    in_map = origin.inverse().apply
    walls = [Segment(in_map(*w.start), in_map(*w.end), w.thickness) for w in truth.walls]
    walls[thick] = dataclasses.replace(walls[thick], thickness=0.6)
    docks = propose_docks(structure_of(layers), walls, "Station")
    assert len(docks) == 2
    for dock in docks:
        back = Pose2D(dock.x, dock.y, dock.theta).apply(
            dock.station.distance + dock.station.depth, 0.0
        )
        assert walls[thick].distances(np.array([origin.inverse().apply(*back)])) > 0.5


def test_a_robot_that_is_free_on_the_map_touches_no_obstacle():
    plan, grid = proposed(building(furnished=True), seed=4)
    points = centres(grid, grid.free())
    covered = np.zeros(len(points), dtype=np.bool_)
    for obstacle in plan.furniture:
        covered |= inside(furniture_solid(obstacle).outline, *points.T)
    assert covered.mean() <= 0.005


def test_unknown_is_no_wall():
    """A hall of which one end was never seen: floor that ends in the unknown has no wall there."""
    plan = building()
    grid = mapped(plan, np.random.default_rng(0), noise=False)
    image = grid.image.copy()
    _, left = grid.transform.to_cell(8.0, 1.0)
    image[:, left:] = UNKNOWN
    traced = propose_plan(dataclasses.replace(grid, image=image), "traced", "Traced")
    assert max(x for wall in traced.walls for x, _ in (wall.start, wall.end)) <= 8.05
    for wall in segments(traced):
        is_upright = turn(wall.direction, math.pi / 2.0) < 0.2
        assert not (is_upright and wall.middle[0] > 7.0)


def test_rays_through_a_window_are_no_floor():
    plan, _ = proposed(building(), window=True)
    assert max(y for room in plan.rooms for _, y in room.polygon) <= 6.2


@pytest.mark.slow
def test_a_turned_origin_turns_the_plan():
    grid = mapped(building(), np.random.default_rng(3))
    world = Pose2D(3.0, -2.0, math.radians(50.0))
    transform = dataclasses.replace(grid.transform, origin=world.compose(grid.transform.origin))
    turned = dataclasses.replace(grid, transform=transform)
    straight, other = (propose_plan(each, "traced", "Traced") for each in (grid, turned))
    assert len(straight.walls) == len(other.walls)
    for wall, same in zip(straight.walls, other.walls, strict=True):
        assert same.start == pytest.approx(world.apply(*wall.start), abs=0.01)
        assert same.end == pytest.approx(world.apply(*wall.end), abs=0.01)
    for dock, same_dock in zip(straight.docks, other.docks, strict=True):
        assert (same_dock.x, same_dock.y) == pytest.approx(world.apply(dock.x, dock.y), abs=0.01)
        assert same_dock.theta == pytest.approx(
            Pose2D(0.0, 0.0, dock.theta).compose(Pose2D(0.0, 0.0, world.theta)).theta, abs=1e-3
        )
    assert inspect_site(other, turned) == ()


@pytest.mark.slow
def test_a_fine_map_gives_the_same_plan_as_a_coarse_one():
    fine = mapped(building(), np.random.default_rng(0), resolution=0.0125, noise=False)
    plan = propose_plan(fine, "traced", "Traced")
    assert (len(plan.rooms), len(plan.passages)) == (3, 2)
    for wall in segments(building()):
        nearest = np.min([other.distances(along(wall)) for other in segments(plan)], axis=0)
        assert (nearest <= NEAR).mean() >= 0.9


def test_the_same_map_gives_the_same_plan():
    grid = mapped(building(furnished=True), np.random.default_rng(5))
    assert propose_plan(grid, "a", "A") == propose_plan(grid, "a", "A")


def test_rooms_are_named_in_the_language_of_the_person():
    grid = mapped(building(), np.random.default_rng(0))
    plan = propose_plan(grid, "a", "A", Titles(room="Sala", corridor="Pasillo", opening="Paso"))
    assert sorted(room.title for room in plan.rooms) == ["Pasillo 1", "Sala 1", "Sala 2"]
    assert [passage.title for passage in plan.passages] == ["Paso 1", "Paso 2"]


def drawn(image: np.ndarray) -> OccupancyGrid:
    return OccupancyGrid(
        image.astype(np.uint8), MapTransform(0.05, Pose2D(0.0, 0.0, 0.0), image.shape[0])
    )


def test_a_map_without_floor_is_refused():
    with pytest.raises(TracingError, match="no free floor"):
        propose_plan(drawn(np.full((100, 100), UNKNOWN)), "a", "A")


def test_a_map_with_grey_walls_is_refused_with_a_remedy():
    image = np.full((100, 100), 150)
    image[10:90, 10:90] = FREE
    with pytest.raises(TracingError, match="lower threshold"):
        propose_plan(drawn(image), "a", "A")
    walls = dataclasses.replace(drawn(image), occupied_thresh=0.4)
    assert len(propose_plan(walls, "a", "A").walls) >= 4


def test_a_map_of_one_cell_or_without_any_is_refused():
    for image in (np.full((1, 1), FREE), np.full((3, 3), OCCUPIED)):
        with pytest.raises(TracingError):
            propose_plan(drawn(image), "a", "A")
