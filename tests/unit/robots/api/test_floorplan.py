"""Each mistake in a hand-made plan is reported in one sentence."""

import json
from typing import Any

import pytest
from hypothesis import given, strategies as st

from robots.api import floorplan
from robots.api.floorplan import FloorPlanError


def named(name: str, **fields: Any) -> dict[str, Any]:
    return {"name": name, "title": name.title(), **fields}


def hut() -> dict[str, Any]:
    """Return the smallest useful plan: two rooms of 3 x 3 m with a door between them."""
    return {
        "mapId": "hut",
        "title": "Hut",
        "rooms": [
            named("west", polygon=[[0, 0], [3, 0], [3, 3], [0, 3]]),
            named("east", polygon=[[3, 0], [6, 0], [6, 3], [3, 3]]),
        ],
        "walls": [
            {"start": [0, 0], "end": [6, 0]},
            {"start": [6, 0], "end": [6, 3]},
            {"start": [6, 3], "end": [0, 3]},
            {"start": [0, 3], "end": [0, 0]},
            {"start": [3, 0], "end": [3, 1]},
            {"start": [3, 2], "end": [3, 3]},
        ],
        "doors": [named("door", start=[3, 1], end=[3, 2], swing=1.57, connects=["west", "east"])],
        "docks": [named("dock", type="giraff", x=1, y=1, theta=0, station={"distance": 0.4})],
        "routes": [
            {
                "type": "giraff",
                "checkpoints": [{"number": 0, "x": 1, "y": 1}, {"number": 1, "x": 5, "y": 1}],
            }
        ],
    }


def refused(plan: dict[str, Any]) -> str:
    with pytest.raises(FloorPlanError) as caught:
        floorplan.decode(json.dumps(plan))
    assert caught.value.problems
    return str(caught.value)


@pytest.fixture
def plan() -> dict[str, Any]:
    return hut()


def test_a_plan_survives_json() -> None:
    plan = floorplan.decode(json.dumps(hut()))
    assert floorplan.decode(floorplan.encode(plan)) == plan


def test_a_plan_finds_its_rooms_docks_and_routes() -> None:
    plan = floorplan.decode(json.dumps(hut()))
    assert plan.room_at(1.0, 1.0) == plan.rooms[0]
    assert plan.room_at(9.0, 1.0) is None
    assert plan.dock_of("giraff") == plan.docks[0]
    assert plan.dock_of("rhodon") is None
    assert plan.route_of("giraff") == plan.routes[0]


@pytest.mark.parametrize(
    ("path", "value", "words"),
    [
        (("doors", 0, "connects"), ["west", "attic"], "unknown room 'attic'"),
        (("doors", 0, "connects"), ["west", "west"], "connects a room with itself"),
        (("doors", 0, "end"), [3, 1.2], "narrower than 0.5 m"),
        (("doors", 0, "height"), 9.0, "the ceiling is at 2.6 m"),
        (("rooms", 1, "name"), "west", "called 'west'"),
        (("rooms", 0, "polygon"), [[0, 0], [1, 0], [2, 0]], "has no area"),
        (("walls", 2, "end"), [6, 3], "wall 2 has no length"),
        (("docks", 0, "x"), -4.0, "dock 'dock' at (-4, 1) is not in a room"),
        (("docks", 0, "type"), "rhodon", "no dock for 'giraff'"),
        (("routes", 0, "checkpoints", 1, "number"), 5, "numbered [0, 5]"),
        (("routes", 0, "checkpoints", 1, "x"), 50, "checkpoint 1 of 'giraff'"),
    ],
)
def test_a_plan_that_cannot_be_a_place_is_refused_with_a_sentence(
    path: tuple[Any, ...], value: Any, words: str, plan: dict[str, Any]
) -> None:
    target: Any = plan
    for step in path[:-1]:
        target = target[step]
    target[path[-1]] = value
    assert words in refused(plan)


def test_a_misspelled_or_invalid_field_is_named_with_its_path() -> None:
    plan = hut()
    plan["walls"][1]["thikness"] = 0.2
    assert "thikness" in refused(plan)
    plan = hut()
    plan["docks"][0]["theta"] = "north"
    assert "$.docks[0].theta" in refused(plan)


def test_a_decoration_hangs_on_a_wall(plan: dict[str, Any]) -> None:
    plan["decorations"] = [{"kind": "clock", "x": 1.5, "y": 0.075, "width": 0.3, "height": 0.3}]
    assert floorplan.decode(json.dumps(plan)).decorations
    plan["decorations"][0]["y"] = 1.0
    assert "clock at (1.5, 1) does not hang on a wall" in refused(plan)


def test_a_mirror_without_a_surface_is_refused(plan: dict[str, Any]) -> None:
    plan["mirrors"] = [named("m", start=[0.075, 1], end=[0.075, 2], bottom=1.0, top=0.5)]
    assert "mirror 'm' has no surface" in refused(plan)


def test_all_problems_are_reported_at_once(plan: dict[str, Any]) -> None:
    plan["docks"][0]["x"] = -4.0
    plan["doors"][0]["connects"] = ["west", "attic"]
    with pytest.raises(FloorPlanError) as caught:
        floorplan.decode(json.dumps(plan))
    assert len(caught.value.problems) == 2


@given(st.binary(max_size=200))
def test_invalid_bytes_are_refused(data: bytes) -> None:
    with pytest.raises(FloorPlanError):
        floorplan.decode(data)


@given(
    st.recursive(
        st.none()
        | st.booleans()
        | st.floats(allow_nan=False, allow_infinity=False)
        | st.text(max_size=5),
        lambda x: st.lists(x, max_size=3),
    )
)
def test_a_list_of_docks_with_anything_but_docks_is_refused(value: Any) -> None:
    refused(hut() | {"docks": value})


def test_a_concave_floor_contains_its_arms_and_not_the_notch() -> None:
    corner = ((0.0, 0.0), (2.0, 0.0), (2.0, 1.0), (1.0, 1.0), (1.0, 2.0), (0.0, 2.0))
    assert floorplan.contains(corner, 0.5, 1.5)
    assert not floorplan.contains(corner, 1.5, 1.5)


# --- titles in other languages --------------------------------------------------------------------


SPANISH = {"Hut": "Cabaña", "West": "Oeste", "Door": "Puerta"}


def spoken() -> dict[str, Any]:
    return {**hut(), "translations": {"es": SPANISH}}


@pytest.mark.parametrize("language", ["es", "es-mx", "ES"])
def test_titles_with_a_translation_are_translated(language):
    plan = floorplan.in_language(spoken(), language)
    assert plan["title"] == "Cabaña"
    assert [room["title"] for room in plan["rooms"]] == ["Oeste", "East"]
    assert plan["doors"][0]["title"] == "Puerta"
    assert [room["name"] for room in plan["rooms"]] == ["west", "east"]
    assert "translations" not in plan


@pytest.mark.parametrize("language", ["en", "fr", ""])
def test_without_a_translation_a_plan_is_unchanged(language):
    assert floorplan.in_language(spoken(), language) == hut()
    assert floorplan.in_language(hut(), language) == hut()
    assert floorplan.in_language({}, language) == {}


def test_a_translation_of_an_unknown_title_is_named():
    plan = {**hut(), "translations": {"es": {"Wset": "Oeste"}}}
    with pytest.raises(FloorPlanError) as caught:
        floorplan.decode(json.dumps(plan))
    assert caught.value.problems == ("the translation to 'es' of 'Wset' belongs to no title",)


def test_a_plan_with_translations_can_be_a_key_of_caches():
    one, other = (floorplan.decode(json.dumps(spoken())) for _ in range(2))
    assert {one: "found"}[other] == "found"
    assert one != floorplan.decode(json.dumps(hut()))
    assert floorplan.decode(floorplan.encode(one)) == one
