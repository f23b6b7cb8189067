"""Applies the fields of the page that finishes a floor plan. Pure.

A field is named after its part: `rooms.0.title`, `docks.1.heading`. What the page does not show
(walls, furniture, floors) stays. The result may still be invalid: `robots.api.floorplan` and the
inspection of the site find problems.
"""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any

from django.utils.formats import sanitize_separators

from robots.api.floorplan import contains
from robots.world.robot_models import MODELS
from robots.world.tracing.docks import station_of
from robots.world.tracing.rooms import joined

Document = dict[str, Any]
IsFree = Callable[[float, float], bool]

# Distances (m) from an opening, to both sides, at which its rooms are searched: rooms of a map meet
# at up to 0.4 m from the narrowest line between them.
BESIDE = (0.3, 0.6, 0.15, 0.9)
NOWHERE = "nowhere"
NEW_OPENING = 0.9  # metres wide, before its ends are moved
RADIUS = 0.6  # metres about a checkpoint
LONGEST_TITLE = 80


class EditError(ValueError):
    """A field with an invalid value: `field` is its name, `text` the value."""

    def __init__(self, field: str, text: str) -> None:
        super().__init__(f"{field}: {text!r}")
        self.field, self.text = field, text


def openings_of(plan: Document) -> list[Document]:
    """Return the openings of a plan, doors first, each with its `kind`."""
    doors = [{**door, "kind": "door"} for door in plan.get("doors", ())]
    return doors + [{**passage, "kind": "opening"} for passage in plan.get("passages", ())]


def checkpoints_of(plan: Document) -> list[Document]:
    """Return the checkpoints of all routes without the docks, each with its robot's `type`."""
    return [
        {**checkpoint, "type": route["type"]}
        for route in plan.get("routes", ())
        for checkpoint in route["checkpoints"]
        if checkpoint["number"] > 0
    ]


def edited(plan: Document, fields: Mapping[str, str], is_free: IsFree) -> Document:
    """Return the plan with the fields applied; `is_free` tells where doors can swing to.

    Raises:
        EditError: a field is no number, or two rooms to be joined do not touch.
    """
    rooms, names = _rooms(plan, fields)
    openings = _openings(plan, fields, (rooms, names), is_free)
    docks = _docks(plan, fields)
    result = {
        **plan,
        "rooms": rooms,
        "doors": [_without(o, "kind") for o in openings if o["kind"] == "door"],
        "passages": [
            _without(o, "kind", "swing", "leaf", "state", "colour")
            for o in openings
            if o["kind"] == "opening"
        ],
        "docks": docks,
        "places": [place for _, place in _moved("places", plan.get("places", ()), fields)],
        "routes": _routes(plan, fields, docks),
    }
    return {key: value for key, value in result.items() if value != []}


def with_new(plan: Document, kind: str, x: float, y: float, words: Mapping[str, str]) -> Document:
    """Return a plan with one more `opening`, `dock`, `place` or `checkpoint` at a point; `words`
    are their titles.

    Raises:
        EditError: there is no such kind.
    """
    x, y = round(x, 3), round(y, 3)
    if kind == "place":
        found = plan.get("places", [])
        number = len(found) + 1
        new = {"name": _key("place", found), "title": f"{words[kind]} {number}", "x": x, "y": y}
        return {**plan, "places": [*found, new]}
    if kind == "opening":
        found = plan.get("passages", [])
        taken = [*found, *plan.get("doors", ())]
        new = {
            "name": _key("opening", taken),
            "title": f"{words[kind]} {len(taken) + 1}",
            "start": [x - NEW_OPENING / 2.0, y],
            "end": [x + NEW_OPENING / 2.0, y],
            "connects": _beside(plan.get("rooms", []), (x - 0.45, y), (x + 0.45, y)),
        }
        return {**plan, "passages": [*found, new]}
    series = _wanted_series(plan)
    if kind == "dock":
        new = {
            "name": _key(f"{series}-dock", plan.get("docks", [])),
            "title": f"{words[kind]} ({MODELS[series].title})",
            "type": series,
            "x": x,
            "y": y,
            "theta": 0.0,
            "station": _station(series),
        }
        return {**plan, "docks": [*plan.get("docks", []), new]}
    if kind == "checkpoint":
        return _with_checkpoint(plan, x, y)
    raise EditError("kind", kind)


# --- the parts ------------------------------------------------------------------------------------


def _rooms(plan: Document, fields: Mapping[str, str]) -> tuple[list[Document], dict[str, str]]:
    """Return the rooms with their new titles, some of them joined, and the new name of each."""
    kept: dict[str, Document] = {}
    names: dict[str, str] = {}
    for number, room in enumerate(plan.get("rooms", ())):
        prefix = f"rooms.{number}"
        if not fields.get(f"{prefix}.remove"):
            kept[room["name"]] = {**room, "title": _title(fields, prefix, room["title"])}
            names[room["name"]] = room["name"]
    for number, room in enumerate(plan.get("rooms", ())):
        into = names.get(fields.get(f"rooms.{number}.join", ""))
        mine = names.get(room["name"])
        if into is None or mine is None or into == mine:
            continue
        target, other = kept[into], kept.pop(mine)
        corners = [tuple(map(tuple, part["polygon"])) for part in (target, other)]
        try:
            kept[into] = {**target, "polygon": [list(p) for p in joined(corners[0], corners[1])]}
        except ValueError as error:
            raise EditError(f"rooms.{number}.join", target["title"]) from error
        names = {old: into if new == mine else new for old, new in names.items()}
    return list(kept.values()), names


def _openings(
    plan: Document,
    fields: Mapping[str, str],
    rooms: tuple[list[Document], dict[str, str]],
    is_free: IsFree,
) -> list[Document]:
    found = []
    names = {room["name"] for room in rooms[0]}
    for number, opening in enumerate(openings_of(plan)):
        prefix = f"openings.{number}"
        was = [rooms[1].get(name, name) for name in opening["connects"]]
        were_joined = was[0] == was[1] and opening["connects"][0] != opening["connects"][1]
        if fields.get(f"{prefix}.remove") or were_joined:
            continue
        start = _point(fields, prefix, ("x", "y"), opening["start"])
        end = _point(fields, prefix, ("x2", "y2"), opening["end"])
        kind = fields.get(f"{prefix}.kind", opening["kind"])
        has_moved = [start, end] != [opening["start"], opening["end"]]
        stays = not has_moved and names.issuperset(was)
        beside = was if stays else _beside(rooms[0], start, end)
        moved = {
            **opening,
            "kind": "door" if kind == "door" else "opening",
            "title": _title(fields, prefix, opening["title"]),
            "start": start,
            "end": end,
            "connects": was if set(was) == set(beside) else beside,
        }
        if moved["kind"] == "door" and ("swing" not in opening or has_moved):
            moved["swing"] = _swing(start, end, is_free)
        found.append(moved)
    return found


def _beside(rooms: list[Document], start: Any, end: Any) -> list[str]:
    """Return the names of the rooms on both sides of an opening, different ones if possible;
    `NOWHERE` where there is no room.
    """
    x, y = (start[0] + end[0]) / 2.0, (start[1] + end[1]) / 2.0
    length = math.dist(start, end) or 1.0
    across = (-(end[1] - start[1]) / length, (end[0] - start[0]) / length)
    sides = []
    for side in (1.0, -1.0):
        spots = [(x + side * far * across[0], y + side * far * across[1]) for far in BESIDE]
        found = [r["name"] for spot in spots for r in rooms if contains(_corners(r), *spot)]
        sides.append(found or [NOWHERE])
    pairs = [[first, second] for first in sides[0] for second in sides[1]]
    return next((pair for pair in pairs if pair[0] != pair[1]), pairs[0])


def _corners(room: Document) -> tuple[tuple[float, float], ...]:
    return tuple((corner[0], corner[1]) for corner in room["polygon"])


def _swing(start: list[float], end: list[float], is_free: IsFree) -> float:
    """Return the angle by which a door opens: a quarter turn to the side with more free space."""
    width = math.dist(start, end)
    closed = math.atan2(end[1] - start[1], end[0] - start[0])

    def room(swing: float) -> int:
        steps = [width * n / 10.0 for n in range(2, 11)]
        turn = closed + swing
        at = [(start[0] + s * math.cos(turn), start[1] + s * math.sin(turn)) for s in steps]
        return sum(is_free(x, y) for x, y in at)

    quarter = round(math.pi / 2.0, 6)
    return max((quarter, -quarter), key=room)


def _moved(
    kind: str, parts: Iterable[Document], fields: Mapping[str, str]
) -> Iterator[tuple[str, Document]]:
    """Yield each part that is not removed, with the prefix of its fields, and its new position and
    title.
    """
    for number, part in enumerate(parts):
        prefix = f"{kind}.{number}"
        if not fields.get(f"{prefix}.remove"):
            x, y = _point(fields, prefix, ("x", "y"), [part["x"], part["y"]])
            title = _title(fields, prefix, part.get("title", ""))
            yield prefix, {**part, "x": x, "y": y} | ({"title": title} if title else {})


def _docks(plan: Document, fields: Mapping[str, str]) -> list[Document]:
    found = []
    for prefix, dock in _moved("docks", plan.get("docks", ()), fields):
        series = fields.get(f"{prefix}.type", dock["type"])
        degrees = _number(fields, f"{prefix}.heading", math.degrees(dock["theta"]))
        # an unchanged heading keeps all digits; the page shows fewer
        same = abs(degrees - round(math.degrees(dock["theta"]), 1)) < 0.05
        turned = dock if same else {**dock, "theta": round(math.radians(degrees), 4)}
        if series != dock["type"] and series in MODELS:
            turned = {**turned, "type": series, "station": _station(series)}
        found.append(turned)
    return found


def _routes(plan: Document, fields: Mapping[str, str], docks: list[Document]) -> list[Document]:
    """Return a route for each series of robots with checkpoints, numbered from its dock."""
    moved: dict[str, list[Document]] = {}
    for prefix, checkpoint in _moved("checkpoints", checkpoints_of(plan), fields):
        series = fields.get(f"{prefix}.type", checkpoint["type"])
        moved.setdefault(series, []).append(_without(checkpoint, "type"))
    routes = {route["type"]: route for route in plan.get("routes", ())}
    return [
        _route(routes.get(series, {"type": series, "checkpoints": []}), checkpoints, docks)
        for series, checkpoints in moved.items()
    ]


def _route(old: Document, checkpoints: list[Document], docks: list[Document]) -> Document:
    """Return a route from the robot's dock through checkpoints; a path for other checkpoints is
    dropped.
    """
    dock = next((dock for dock in docks if dock["type"] == old["type"]), None)
    whole = checkpoints
    if dock is not None:
        first = next(iter(old["checkpoints"]), {"title": dock["title"]})
        whole = [{**first, "x": dock["x"], "y": dock["y"]}, *checkpoints]
    numbered = [{**part, "number": number} for number, part in enumerate(whole)]
    kept = old if numbered == old["checkpoints"] else _without(old, "path")
    return {**kept, "checkpoints": numbered}


def _with_checkpoint(plan: Document, x: float, y: float) -> Document:
    """Add a checkpoint to the last route, or start a route for the first dock."""
    routes = list(plan.get("routes", ()))
    new = {"x": x, "y": y, "radius": RADIUS}
    if routes:
        last = routes[-1]
        numbered = {**new, "number": len(last["checkpoints"])}
        routes[-1] = {**last, "checkpoints": [*last["checkpoints"], numbered]}
        return {**plan, "routes": routes}
    docks = plan.get("docks") or [{"type": next(iter(MODELS)), "x": x, "y": y, "title": ""}]
    first = {"number": 0, "x": docks[0]["x"], "y": docks[0]["y"], "title": docks[0]["title"]}
    return {
        **plan,
        "routes": [{"type": docks[0]["type"], "checkpoints": [first, {**new, "number": 1}]}],
    }


# --- fields ---------------------------------------------------------------------------------------


def _title(fields: Mapping[str, str], prefix: str, old: str) -> str:
    return fields.get(f"{prefix}.title", old).strip()[:LONGEST_TITLE] or old


def _number(fields: Mapping[str, str], name: str, old: float) -> float:
    text = fields.get(name)
    if text is None:
        return old
    try:
        value = float(sanitize_separators(text))
    except ValueError as error:
        raise EditError(name, text) from error
    if not math.isfinite(value) or abs(value) > 1e5:
        raise EditError(name, text)
    return value


def _point(
    fields: Mapping[str, str], prefix: str, keys: tuple[str, str], old: list[float]
) -> list[float]:
    """Return a point; one that was not moved keeps all digits; the page shows fewer."""
    new = [_number(fields, f"{prefix}.{key}", was) for key, was in zip(keys, old, strict=True)]
    moved = any(abs(a - b) > 0.006 for a, b in zip(new, old, strict=True))
    return [round(value, 3) for value in new] if moved else list(old)


def _wanted_series(plan: Document) -> str:
    """Return the first series of robots without a dock, or the first of all."""
    taken = {dock["type"] for dock in plan.get("docks", ())}
    return next((series for series in MODELS if series not in taken), next(iter(MODELS)))


def _station(series: str) -> Document:
    station = station_of(MODELS[series])
    return {name: getattr(station, name) for name in ("distance", "width", "depth", "height")}


def _key(beginning: str, taken: list[Document]) -> str:
    names, number = {part["name"] for part in taken}, len(taken) + 1
    while f"{beginning}-{number}" in names:
        number += 1
    return f"{beginning}-{number}"


def _without(part: Document, *keys: str) -> Document:
    return {key: value for key, value in part.items() if key not in keys}
