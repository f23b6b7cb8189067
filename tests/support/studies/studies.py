"""A small study in a small site: two rooms with a door and an archway, a dock, two checkpoints and
a mirror.
"""

import msgspec

from experiments.definition.schema import StudyDefinition
from robots.api import floorplan
from robots.api.floorplan import FloorPlan


def _named(name: str, start: list[float], end: list[float], **more: object) -> dict[str, object]:
    return {"name": name, "title": name.title(), "start": start, "end": end, **more}


BETWEEN = {"thickness": 0.2, "connects": ["west", "east"]}
WALLS = [
    ([-0.1, -0.1], [8.1, -0.1]),
    ([8.1, -0.1], [8.1, 4.1]),
    ([8.1, 4.1], [-0.1, 4.1]),
    ([-0.1, 4.1], [-0.1, -0.1]),
    ([4.1, 0], [4.1, 0.4]),
    ([4.1, 1.4], [4.1, 2.6]),
    ([4.1, 3.6], [4.1, 4.0]),
]
DOCK = {"name": "home", "title": "Home", "type": "giraff", "x": 0.5, "y": 2, "theta": 3.14159}
# Two rooms side by side, 4 m x 4 m each; above y = 2.4 an archway, below y = 1.6 a door between
# them.
PLAN = {
    "mapId": "cabin",
    "title": "Cabin",
    "rooms": [
        {"name": "west", "title": "West", "polygon": [[0, 0], [4, 0], [4, 4], [0, 4]]},
        {"name": "east", "title": "East", "polygon": [[4.2, 0], [8, 0], [8, 4], [4.2, 4]]},
    ],
    "walls": [{"start": start, "end": end, "thickness": 0.2} for start, end in WALLS],
    "doors": [_named("door", [4.1, 0.4], [4.1, 1.4], swing=1.57, **BETWEEN)],
    "passages": [_named("archway", [4.1, 2.6], [4.1, 3.6], **BETWEEN)],
    "mirrors": [_named("mirror", [8, 1.2], [8, 2.8])],
    "docks": [{**DOCK, "station": {"distance": 0.38}}],
}


def _titled(key: str, title: str, **more: object) -> dict[str, object]:
    return {"key": key, "title": {"en": title}, **more}


PLACE = {"robot": "giraff", "site": "cabin"}
CHECKPOINTS = [
    {"number": 0, "x": 0.5, "y": 2},
    {"number": 1, "x": 3, "y": 1, "radius": 0.6},
    {"number": 2, "x": 7, "y": 2, "radius": 0.6},
]
PHOTO = {"checkpoint": 2, "mirror": "mirror"}
STUDY = {
    "format": 1,
    "slug": "cabin-study",
    "version": 1,
    "title": {"en": "Cabin"},
    "languages": ["en"],
    "steps": [
        _titled("task", "Task", kind="task", minutes=5),
        _titled("experience", "Experience", kind="questionnaire", questionnaire="experience"),
    ],
    "conditions": [
        _titled("all_open", "Open", **PLACE, controllers=["keyboard"]),
        _titled("shut", "Shut", **PLACE, controllers=["keyboard"], doors_closed=["door"]),
    ],
    "courses": [{**PLACE, "checkpoints": CHECKPOINTS, "doors": ["door"], "photo": PHOTO}],
}

PRACTICE = _titled("try", "Try", kind="practice", minutes=2)


def cabin() -> FloorPlan:
    """The site."""
    return floorplan.decode(msgspec.json.encode(PLAN))


def small_study(**changes: object) -> StudyDefinition:
    """The study, with fields of its JSON replaced."""
    return msgspec.convert({**STUDY, **changes}, StudyDefinition)
