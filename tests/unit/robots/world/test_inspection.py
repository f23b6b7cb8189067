"""Sites in which something is wrong, drawn small."""

import dataclasses
import re
from typing import Any

import msgspec
import numpy as np
import pytest

from robots.api.floorplan import (
    FloorPlan,
    Furniture,
    Room,
    Route,
    Wall,
    decode,
    encode,
)
from robots.api.geometry import MapTransform, Pose2D
from robots.world.grid import OCCUPIED, OccupancyGrid
from robots.world.inspection import inspect_site
from robots.world.render_plan import rasterise
from robots.world.sites import load_site


# Two rooms of 4 m x 4 m side by side, a door in the wall between them, a dock in the left one.
def room(name: str, left: float, right: float) -> dict[str, Any]:
    corners = [[left, 0.0], [right, 0.0], [right, 4.0], [left, 4.0]]
    return {"name": name, "title": name.title(), "polygon": corners}


def wall(thickness: float, *ends: float) -> dict[str, Any]:
    return {"start": ends[:2], "end": ends[2:], "thickness": thickness}


DOOR = {"name": "door", "title": "Door", "start": [4.05, 1.5], "end": [4.05, 2.5]}
DOOR |= {"swing": -1.57, "thickness": 0.1, "connects": ["left", "right"]}
DOCK = {"name": "dock", "title": "Dock", "type": "giraff", "station": {"distance": 0.38}}
PARTS = {
    "mapId": "two-rooms",
    "title": "Two rooms",
    "rooms": [room("left", 0.0, 4.0), room("right", 4.1, 8.1)],
    "walls": [
        wall(0.2, -0.1, -0.1, 8.2, -0.1),
        wall(0.2, 8.2, -0.1, 8.2, 4.1),
        wall(0.2, 8.2, 4.1, -0.1, 4.1),
        wall(0.2, -0.1, 4.1, -0.1, -0.1),
        wall(0.1, 4.05, 0.0, 4.05, 1.5),
        wall(0.1, 4.05, 2.5, 4.05, 4.0),
    ],
    "doors": [DOOR],
    "docks": [DOCK | {"x": 0.5, "y": 2.0, "theta": 3.14159}],
    "places": [{"name": "desk", "title": "Desk", "x": 6.5, "y": 2.0}],
}
PLAN = msgspec.convert(PARTS, FloorPlan)


def furniture(x: float, y: float, width: float = 0.6, depth: float = 0.6) -> Furniture:
    return Furniture(name="crate", kind="box", x=x, y=y, width=width, depth=depth, height=0.6)


def changed(**parts: Any) -> FloorPlan:
    plan = msgspec.structs.replace(PLAN, **parts)
    assert decode(encode(plan)) == plan, "the plan's own checks find no problem"
    return plan


def only(plan: FloorPlan, grid: OccupancyGrid | None = None) -> str:
    found = inspect_site(plan, grid or rasterise(plan))
    assert len(found) == 1, found
    return found[0]


def test_good_site_has_no_errors() -> None:
    assert inspect_site(PLAN, rasterise(PLAN)) == ()


def test_a_map_from_a_robot_with_gaps_and_specks_is_good_enough() -> None:
    grid = rasterise(PLAN)
    rng = np.random.default_rng(1)
    image = np.where(rng.random(grid.image.shape) < 0.15, 205, grid.image).astype(np.uint8)
    image[grid.free()] = 254
    origin = grid.transform.origin
    moved = MapTransform(0.05, Pose2D(origin.x + 0.04, origin.y - 0.03, 0.0), image.shape[0])
    assert inspect_site(PLAN, OccupancyGrid(image, moved)) == ()


def test_a_map_without_free_floor_is_found() -> None:
    grid = rasterise(PLAN)
    full = dataclasses.replace(grid, image=np.full_like(grid.image, OCCUPIED))
    assert "no free cell" in only(PLAN, full)


@pytest.mark.parametrize(
    ("resolution", "shift", "words"),
    [
        (0.025, 0.0, r"rooms reach from \(0, 0\) to \(8.1, 4\) m, but the map only covers"),
        (0.1, 0.0, "do not show the same place"),
        (0.06, 0.0, "do not show the same place"),
        (0.05, -1.0, "the map only covers"),
        (0.05, 100.0, "the map only covers"),
    ],
)
def test_a_map_of_another_scale_or_place_than_the_plan_is_found(
    resolution: float, shift: float, words: str
) -> None:
    grid = rasterise(PLAN)
    origin = Pose2D(grid.transform.origin.x + shift, grid.transform.origin.y, 0.0)
    transform = MapTransform(resolution, origin, grid.image.shape[0])
    assert re.search(words, only(PLAN, dataclasses.replace(grid, transform=transform)))


def test_a_map_that_is_a_tenth_too_large_is_found() -> None:
    office = load_site("office")
    wrong = MapTransform(0.055, office.grid.transform.origin, office.grid.image.shape[0])
    found = only(office.plan, dataclasses.replace(office.grid, transform=wrong))
    assert "differ in scale: they fit better at 0.0495 m per pixel than at 0.055" in found


def test_a_turned_map_that_fits_is_accepted() -> None:
    grid = rasterise(PLAN)
    height, width = grid.image.shape
    corner = grid.transform.to_world(width, height)
    turned = np.ascontiguousarray(np.rot90(grid.image, -1))  # its lower right corner is lower left
    transform = MapTransform(0.05, Pose2D(*corner, np.pi / 2), width)
    assert inspect_site(PLAN, OccupancyGrid(turned, transform)) == ()


def test_a_place_in_furniture_or_too_near_to_it_is_found() -> None:
    within = changed(furniture=(furniture(6.5, 2.0),))
    assert only(within) == "place 'desk' is in a wall or in furniture on the map"
    assert only(within, rasterise(PLAN)) == "place 'desk' is in a wall or in furniture in the plan"
    assert "place 'desk' is too close" in only(changed(furniture=(furniture(6.5, 2.45),)))


def test_a_place_behind_furniture_that_fills_the_room_cannot_be_reached() -> None:
    plan = changed(furniture=(furniture(5.5, 2.0, 0.3, 4.0),))
    assert only(plan) == "place 'desk' cannot be reached on the map"


def test_a_door_that_is_walled_up_on_the_map_is_found() -> None:
    wall = Wall(start=(4.05, 1.4), end=(4.05, 2.6), thickness=0.1)
    walled = rasterise(msgspec.structs.replace(PLAN, walls=(*PLAN.walls, wall)))
    found = inspect_site(PLAN, walled)
    assert "'door' is blocked or too narrow for a robot on the map" in found


def test_a_dock_that_is_not_free_or_cannot_be_reached_is_found() -> None:
    blocked = only(changed(furniture=(furniture(1.3, 2.0, 0.3),)))
    assert "dock 'dock' is not free on the map: there is an obstacle at" in blocked
    pen = (furniture(1.9, 2.0, 0.1, 4.0),)
    assert only(changed(furniture=pen)) == "dock 'dock' cannot be reached on the map"


def test_a_checkpoint_that_cannot_be_reached_is_found() -> None:
    first = {"number": 0, "x": 0.5, "y": 2.0}
    second = {"number": 1, "x": 7.9, "y": 2.0, "radius": 0.1}
    route = {"type": "giraff", "checkpoints": [first, second]}
    found = only(changed(routes=(msgspec.convert(route, Route),)))
    assert found.startswith("checkpoint 1 of 'giraff' is too close to a wall")


def test_a_site_where_no_robot_fits_is_found() -> None:
    grid = rasterise(PLAN)
    image = grid.image.copy()
    image[::8] = OCCUPIED  # a bar every 40 cm
    found = only(changed(docks=(), places=()), dataclasses.replace(grid, image=image))
    assert found == "there is not enough room for a robot anywhere on the map"


@pytest.mark.slow
def test_a_plan_as_large_as_a_district_takes_no_more_memory_than_a_large_map() -> None:
    far = 5000.0
    square = ((0.0, 0.0), (far, 0.0), (far, far), (0.0, far))
    room = Room(name="field", title="Field", polygon=square)
    sides = tuple(
        Wall(start=a, end=b, thickness=20.0)
        for a, b in zip(square, (*square[1:], square[0]), strict=True)
    )
    plan = FloorPlan(map_id="field", title="Field", rooms=(room,), walls=sides)
    assert inspect_site(plan, rasterise(plan, 10.0)) == ()
