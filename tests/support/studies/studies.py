"""A small study in a small site: two rooms with a door and an archway, a dock, two checkpoints and
a mirror.
"""

import msgspec

from experiments.definition.schema import StudyDefinition
from robots.api import floorplan
from robots.api.floorplan import FloorPlan

# Two rooms side by side, 4 m x 4 m each; above y = 2.4 an archway, below y = 1.6 a door between
# them.
PLAN = {
    "mapId": "cabin",
    "title": "Cabin",
    "rooms": [
        {"name": "west", "title": "West", "polygon": [[0, 0], [4, 0], [4, 4], [0, 4]]},
        {"name": "east", "title": "East", "polygon": [[4.2, 0], [8, 0], [8, 4], [4.2, 4]]},
    ],
    "walls": [
        {"start": [-0.1, -0.1], "end": [8.1, -0.1], "thickness": 0.2},
        {"start": [8.1, -0.1], "end": [8.1, 4.1], "thickness": 0.2},
        {"start": [8.1, 4.1], "end": [-0.1, 4.1], "thickness": 0.2},
        {"start": [-0.1, 4.1], "end": [-0.1, -0.1], "thickness": 0.2},
        {"start": [4.1, 0], "end": [4.1, 0.4], "thickness": 0.2},
        {"start": [4.1, 1.4], "end": [4.1, 2.6], "thickness": 0.2},
        {"start": [4.1, 3.6], "end": [4.1, 4.0], "thickness": 0.2},
    ],
    "doors": [
        {
            "name": "door",
            "title": "Door",
            "start": [4.1, 0.4],
            "end": [4.1, 1.4],
            "swing": 1.57,
            "thickness": 0.2,
            "connects": ["west", "east"],
        },
    ],
    "passages": [
        {
            "name": "archway",
            "title": "Archway",
            "start": [4.1, 2.6],
            "end": [4.1, 3.6],
            "thickness": 0.2,
            "connects": ["west", "east"],
        },
    ],
    "mirrors": [{"name": "mirror", "title": "Mirror", "start": [8, 1.2], "end": [8, 2.8]}],
    "docks": [
        {
            "name": "home",
            "title": "Home",
            "type": "giraff",
            "x": 0.5,
            "y": 2,
            "theta": 3.14159,
            "station": {"distance": 0.38},
        }
    ],
}

STUDY = {
    "format": 1,
    "slug": "cabin-study",
    "version": 1,
    "title": {"en": "Cabin"},
    "languages": ["en"],
    "steps": [
        {"kind": "task", "key": "task", "title": {"en": "Task"}, "minutes": 5},
        {
            "kind": "questionnaire",
            "key": "experience",
            "title": {"en": "Experience"},
            "questionnaire": "experience",
        },
    ],
    "conditions": [
        {
            "key": "all_open",
            "title": {"en": "Open"},
            "robot": "giraff",
            "site": "cabin",
            "controllers": ["keyboard"],
        },
        {
            "key": "shut",
            "title": {"en": "Shut"},
            "robot": "giraff",
            "site": "cabin",
            "controllers": ["keyboard"],
            "doors_closed": ["door"],
        },
    ],
    "courses": [
        {
            "robot": "giraff",
            "site": "cabin",
            "checkpoints": [
                {"number": 0, "x": 0.5, "y": 2},
                {"number": 1, "x": 3, "y": 1, "radius": 0.6},
                {"number": 2, "x": 7, "y": 2, "radius": 0.6},
            ],
            "doors": ["door"],
            "photo": {"checkpoint": 2, "mirror": "mirror"},
        }
    ],
}

PRACTICE = {"kind": "practice", "key": "try", "title": {"en": "Try"}, "minutes": 2}


def cabin() -> FloorPlan:
    """The site."""
    return floorplan.decode(msgspec.json.encode(PLAN))


def small_study(**changes: object) -> StudyDefinition:
    """The study, with fields of its JSON replaced."""
    return msgspec.convert({**STUDY, **changes}, StudyDefinition)
