"""Fields of the page that finishes a plan, and the resulting plan."""

import json
import math

import pytest
from django.utils import translation

from robots.api import floorplan
from robots.plans.edits import EditError, checkpoints_of, edited, openings_of, with_new
from robots.world.sites import SHIPPED
from robots.world.tracing.rooms import joined
from tests.support.agents.mapped_building import building

WORDS = {"place": "Place", "dock": "Station", "checkpoint": "Checkpoint", "opening": "Opening"}


def document() -> dict:
    return json.loads(floorplan.encode(building()))


def anywhere(_x: float, _y: float) -> bool:
    return True


def problems(plan: dict) -> tuple[str, ...]:
    try:
        floorplan.decode(json.dumps(plan))
    except floorplan.FloorPlanError as error:
        return error.problems
    return ()


@pytest.fixture
def plan():
    return document()


def test_a_plan_without_edits_is_unchanged(plan):
    assert edited(plan, {}, anywhere) == plan
    for kind, at in (("dock", (1.0, 1.0)), ("place", (2.0, 4.0)), ("checkpoint", (3.0, 1.0))):
        plan = with_new(plan, kind, *at, words=WORDS)
    assert edited(plan, {}, anywhere) == plan
    assert problems(plan) == ()


@pytest.mark.parametrize("site", ["office", "clinic"])
def test_a_shipped_plan_is_unchanged(site):
    plan = json.loads((SHIPPED / site / "plan.json").read_text())
    again = floorplan.decode(json.dumps(edited(plan, {}, anywhere)))
    assert again == floorplan.decode(json.dumps(plan))


def test_a_path_that_was_drawn_for_other_checkpoints_is_left_out():
    plan = json.loads((SHIPPED / "office" / "plan.json").read_text())
    assert plan["routes"][0]["path"]
    moved = edited(plan, {"checkpoints.0.x": "3.0"}, anywhere)
    assert "path" not in moved["routes"][0]
    assert moved["routes"][1] == plan["routes"][1]


def test_values_that_the_page_shows_rounded_keep_their_digits_until_moved():
    plan = document() | {"places": [{"name": "a", "title": "A", "x": 1.2345, "y": 4.5678}]}
    fields = {"places.0.x": "1.23", "places.0.y": "4.57", "places.0.title": "A"}
    assert edited(plan, fields, anywhere)["places"] == plan["places"]


def test_rooms_get_names_and_an_empty_name_changes_nothing():
    plan = edited(document(), {"rooms.0.title": " Hall ", "rooms.1.title": " "}, anywhere)
    assert [room["title"] for room in plan["rooms"]] == ["Hall", "west", "east"]


def test_joining_two_rooms_removes_the_opening_between_them():
    plan = edited(document(), {"rooms.1.join": "hall", "rooms.0.title": "Both"}, anywhere)
    assert [room["title"] for room in plan["rooms"]] == ["Both", "east"]
    polygon = tuple((x, y) for x, y in plan["rooms"][0]["polygon"])
    for inside in ((2.0, 4.0), (8.0, 1.0), (0.3, 2.0)):
        assert floorplan.contains(polygon, *inside)
    assert not floorplan.contains(polygon, 7.0, 4.0)
    assert [o["name"] for o in openings_of(plan)] == ["east"]
    assert set(plan["passages"][0]["connects"]) == {"hall", "east"}
    assert problems(plan) == ()


@pytest.mark.slow
def test_rooms_that_do_not_touch_are_not_joined(plan):
    plan["rooms"].append(
        {"name": "far", "title": "Far", "polygon": [[20, 0], [24, 0], [24, 4], [20, 4]]}
    )
    with pytest.raises(EditError):
        edited(plan, {"rooms.3.join": "hall"}, anywhere)
    with pytest.raises(ValueError, match="do not touch"):
        joined(((0, 0), (2, 0), (2, 2)), ((9, 9), (11, 9), (11, 11)))


@pytest.mark.parametrize("text", ["1,000", "4,1"])
def test_a_comma_is_no_decimal_mark_in_english(text):
    with translation.override("en"), pytest.raises(EditError):
        edited(document(), {"openings.0.y2": text}, anywhere)


def test_an_opening_that_is_moved_connects_the_rooms_beside_it():
    ends = {"x": "4.5", "y": "3.0", "x2": "4.5", "y2": "4,1"}
    fields = {f"openings.0.{name}": text for name, text in ends.items()}
    with translation.override("es"):
        plan = edited(document(), fields, anywhere)
    assert plan["passages"][0]["start"] == [4.5, 3.0]
    assert plan["passages"][0]["end"] == [4.5, 4.1]
    assert set(plan["passages"][0]["connects"]) == {"west", "east"}
    assert problems(plan) == ()


def border_beside_opening() -> dict:
    """A plan whose hall reaches half a metre into a room, as where a map's rooms meet beside the
    narrowest line between them.
    """
    plan = document()
    plan["rooms"][0]["polygon"] = [[0, 0], [9, 0], [9, 2.5], [0, 2.5]]
    plan["rooms"][1]["polygon"] = [[0, 2.5], [4.5, 2.5], [4.5, 6], [0, 6]]
    plan["rooms"][2]["polygon"] = [[4.5, 2.5], [9, 2.5], [9, 6], [4.5, 6]]
    return plan


def test_an_opening_beside_the_border_of_its_rooms_still_connects_them():
    plan = border_beside_opening()
    shown = {"openings.0.x": "1.00", "openings.0.y": "2.00"}
    assert edited(plan, shown, anywhere) == plan
    moved = edited(plan, {"openings.0.x": "0.9"}, anywhere)
    assert set(moved["passages"][0]["connects"]) == {"hall", "west"}
    assert problems(moved) == ()


def test_an_opening_to_a_removed_room_leads_nowhere():
    plan = edited(document(), {"rooms.1.remove": "on"}, anywhere)
    assert any("nowhere" in problem for problem in problems(plan))


def test_an_opening_that_leads_nowhere_is_a_problem_and_is_not_lost():
    fields = {f"openings.0.{key}": "50" for key in ("x", "y", "x2")} | {"openings.0.y2": "51"}
    plan = edited(document(), fields, anywhere)
    assert len(plan["passages"]) == 2
    assert any("nowhere" in problem for problem in problems(plan))
    plan = with_new(document(), "opening", 2.0, 4.0, WORDS)
    again = edited(plan, {}, anywhere)
    assert len(again["passages"]) == 3
    assert any("connects a room with itself" in problem for problem in problems(again))


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_door_opens_to_the_side_that_is_free(side):
    def is_free(_x: float, y: float) -> bool:
        return (y - 2.0) * side > 0.0

    plan = edited(document(), {"openings.0.kind": "door"}, is_free)
    door = floorplan.decode(json.dumps(plan)).doors[0]
    assert door.swing == pytest.approx(side * math.pi / 2.0, abs=1e-5)
    assert len(plan["passages"]) == 1
    kept = edited(plan, {}, lambda *_at: True)
    assert kept["doors"] == plan["doors"]
    back = edited(plan, {"openings.0.kind": "opening"}, is_free)
    assert "doors" not in back
    assert len(back["passages"]) == 2
    assert problems(back) == ()


def test_docks_are_for_different_robots_and_a_robot_is_changed_with_its_station():
    plan = with_new(document(), "dock", 1.0, 4.0, WORDS)
    plan = with_new(plan, "dock", 3.0, 4.0, WORDS)
    assert [dock["type"] for dock in plan["docks"]] == ["giraff", "rhodon"]
    fields = {"docks.0.type": "rhodon", "docks.0.heading": "90", "docks.0.x": "1.5"}
    dock = edited(plan, fields, anywhere)["docks"][0]
    assert dock["station"] == plan["docks"][1]["station"]
    assert dock["theta"] == pytest.approx(math.pi / 2.0, abs=1e-4)
    assert dock["x"] == 1.5


def test_checkpoints_start_at_the_dock_and_are_renumbered():
    plan = with_new(document(), "dock", 1.0, 4.0, WORDS)
    for x in (2.0, 3.0, 4.0):
        plan = with_new(plan, "checkpoint", x, 1.0, WORDS)
    assert [c["number"] for c in checkpoints_of(plan)] == [1, 2, 3]
    plan = edited(plan, {"checkpoints.1.remove": "on", "docks.0.y": "4.5"}, anywhere)
    route = [(c["number"], c["x"], c["y"]) for c in plan["routes"][0]["checkpoints"]]
    assert route == [(0, 1.0, 4.5), (1, 2.0, 1.0), (2, 4.0, 1.0)]
    assert problems(plan) == ()
    plan = edited(plan, {f"checkpoints.{n}.remove": "on" for n in range(2)}, anywhere)
    assert "routes" not in plan


def test_removed_parts_disappear_and_names_stay_unique(plan):
    for _ in range(3):
        plan = with_new(plan, "place", 2.0, 4.0, WORDS)
    plan = edited(plan, {"places.0.remove": "on"}, anywhere)
    plan = with_new(plan, "place", 2.0, 4.0, WORDS)
    assert len({place["name"] for place in plan["places"]}) == 3
