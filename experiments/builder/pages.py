"""The pages of the study builder as places in a definition: what each edits, and how it is put
back.
"""

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import msgspec

from experiments.definition.analyses import DeclaredAnalysis
from experiments.definition.coding import Code
from experiments.definition.design import Factor
from experiments.definition.plan import StudyPlan
from experiments.definition.schema import Condition, Course, StudyDefinition
from experiments.definition.steps import KINDS
from experiments.definition.wizard import WizardStage
from robots.api.floorplan import FloorPlan
from robots.api.messages import Point
from surveys.document_forms.parts import Document, in_languages, read_points

# What of the study itself is on which page, and the classes of what stands in lists.
PAGES: Mapping[str, Collection[str]] = {
    "about": (
        *("title", "intro", "source", "licence", "recruitment", "compensation"),
        *("observers_allowed", "languages"),
    ),
    "recruitment": (
        *("recruiting", "turned_away_code", "devices", "browsers"),
        *("screening", "answer_quotas", "appointments"),
    ),
    "rules": ("allocation", "start", "refill", "quality", "analysis"),
    "wizard": ("wizard",),
    "coding": ("coding",),
}
PLAN = "plan"  # the page of an optional part of the study: one without content is none
LISTS = ("steps", "factors", "conditions", "courses", "analyses")
# Lists inside an optional part of the study, on whose page they are shown.
INNER_LISTS: Mapping[str, str] = {"stages": "wizard", "codes": "coding"}
CLASSES: Mapping[str, type[Any]] = {
    "factors": Factor,
    "conditions": Condition,
    "courses": Course,
    "analyses": DeclaredAnalysis,
    "stages": WizardStage,
    "codes": Code,
}
NEW_ZONE = 1.0  # metres: the sides of a zone before it is drawn


@dataclass(frozen=True)
class BuilderPlace:
    """A page: a section of the study, or one part of a list, from 0."""

    section: str
    index: int | None = None

    def part(self, whole: Document) -> Document | None:
        """Return the document that the page edits; None when there is none."""
        if self.section == PLAN:
            return (whole.get(PLAN) or {}) if self.index is None else None
        if self.index is None:
            return whole if self.section in PAGES else None
        parts = parts_in(whole, self.section) if self.section in {*LISTS, *INNER_LISTS} else []
        return parts[self.index] if self.index < len(parts) else None

    def cls(self, part: Document) -> type[Any]:
        """Return the class of what is edited."""
        if self.section == PLAN:
            return StudyPlan
        if self.index is None:
            return StudyDefinition
        return KINDS[part["kind"]] if self.section == "steps" else CLASSES[self.section]

    @property
    def only(self) -> Collection[str]:
        """Return which fields are asked for; none means all."""
        return PAGES.get(self.section, ())

    def put(self, whole: Document, part: Document) -> Document:
        """Return a study with this part of it replaced."""
        if self.section == PLAN:
            said = {key: value for key, value in part.items() if value not in ([], "", None)}
            return {**whole, PLAN: said or None}
        if self.index is None:
            kept = {key: value for key, value in whole.items() if key not in self.only}
            changed = {**kept, **_with_inner_lists(part, whole)}
            return (
                in_languages(StudyDefinition, changed, part["languages"])
                if "languages" in part
                else changed
            )
        parts = list(parts_in(whole, self.section))
        kind = {"kind": parts[self.index]["kind"]} if self.section == "steps" else {}
        parts[self.index] = {
            **kind,
            **(renumber(part) if self.section == "courses" else part),
        }
        return with_parts(whole, self.section, parts)


def parts_in(whole: Document, section: str) -> list[Document]:
    """Return the parts of a list of the study, or of one inside an optional part of it."""
    around = whole if section in LISTS else whole.get(INNER_LISTS[section]) or {}
    found: list[Document] = around.get(section, [])
    return found


def with_parts(whole: Document, section: str, parts: list[Document]) -> Document:
    """Return a study with these parts in a list of it."""
    if section in LISTS:
        return {**whole, section: parts}
    owner = INNER_LISTS[section]
    return {**whole, owner: {**(whole.get(owner) or {}), section: parts}}


def by_factors(whole: Document) -> Document:
    """Return a study whose design is that of its factors, where it has any: it is chosen once."""
    if not whole["factors"]:
        return whole
    is_within = any(factor.get("design") == "within" for factor in whole["factors"])
    design = "within" if is_within else "between"
    return {**whole, "allocation": {**whole.get("allocation", {}), "design": design}}


def _with_inner_lists(part: Document, whole: Document) -> Document:
    """Return what a form said with the lists that have pages of their own."""
    found = {
        owner: {**part[owner], section: parts_in(whole, section)}
        for section, owner in INNER_LISTS.items()
        if part.get(owner) is not None
    }
    return part | found


def renumber(course: Document) -> Document:
    """Return a course whose checkpoints are numbered as they stand, its photo staying with its
    checkpoint.
    """
    checkpoints, photo = course.get("checkpoints", []), course.get("photo")
    places = {checkpoint.get("number"): n for n, checkpoint in enumerate(checkpoints)}
    numbered = {
        **course,
        "checkpoints": [{**checkpoint, "number": n} for n, checkpoint in enumerate(checkpoints)],
    }
    return (
        {**numbered, "photo": {**photo, "checkpoint": places[photo["checkpoint"]]}}
        if photo and photo.get("checkpoint") in places
        else numbered
    )


# --- what is new ----------------------------------------------------------------------------------


@dataclass(frozen=True)
class AtHand:
    """What can be chosen here: the sites' plans by map id, and the series of the robots."""

    sites: Mapping[str, FloorPlan]
    robots: Sequence[str]


def new_step(kind: str, blank: Mapping[str, Any], whole: Document) -> Document:
    """Return a step without words; `blank` is what its kind needs beside them."""
    key = _free(kind, [one["key"] for one in whole["steps"]])
    return {"kind": kind, "key": key, "title": {}, **blank}


def new_condition(whole: Document, at_hand: AtHand) -> Document:
    """Return a condition of the first robot and site."""
    key = _free("condition", [one["key"] for one in whole["conditions"]])
    site, robot = next(iter(at_hand.sites), "site"), next(iter(at_hand.robots), "robot")
    return {
        "key": key,
        "title": {},
        "robot": robot,
        "site": site,
        "controllers": ["keyboard", "mouse", "touch", "stick"],
    }


def new_factor(whole: Document) -> Document:
    """Return a factor of two levels without titles."""
    key = _free("factor", [one["key"] for one in whole["factors"]])
    levels = [{"key": f"{key}_level_{n}", "title": {}} for n in (1, 2)]
    return {"key": key, "title": {}, "levels": levels}


def new_analysis(whole: Document) -> Document:
    """Return an analysis that measures nothing yet."""
    return {"key": _free("analysis", [one["key"] for one in whole["analyses"]]), "title": {}}


def new_stage(whole: Document) -> Document:
    """Return a stage of a script, without steps."""
    return {"key": _free("stage", [one["key"] for one in parts_in(whole, "stages")]), "title": {}}


def new_script_step(stage: Document, kind: str, places: Sequence[str]) -> Document | None:
    """Return a step of a script: a line, or a move of a kind; None for another kind."""
    key = _free(f"{stage['key']}_1", [one["key"] for one in stage.get("steps", ())])
    moves: dict[str, Document] = {
        "place": {"name": next(iter(places), "place")},
        "dock": {},
        "undock": {},
        "tilt": {"angle": 0.0},
        "turn": {},
        "drive": {"linear": 0.2, "seconds": 2.0},
    }
    if kind and kind not in moves:
        return None
    move = {"move": {"kind": kind, **moves[kind]}} if kind else {}
    return {"key": key, "title": {}, **move}


def new_code(whole: Document) -> Document:
    """Return a code for points."""
    code = _free("code", [one["code"] for one in parts_in(whole, "codes")])
    return {"code": code, "name": "", "kind": "point"}


def new_course(whole: Document, at_hand: AtHand) -> Document:
    """Return a course for the first robot and site of the conditions that have none, as the plan
    suggests it.
    """
    wanted = [(one["robot"], one["site"]) for one in whole["conditions"]]
    taken = {(one["robot"], one["site"]) for one in whole["courses"]}
    first = (next(iter(at_hand.robots), "robot"), next(iter(at_hand.sites), "site"))
    robot, site = next((name for name in wanted if name not in taken), first)
    plan = at_hand.sites.get(site)
    course: Document = {"robot": robot, "site": site, "checkpoints": []}
    return {**course, **_suggested(plan, robot)} if plan is not None else course


def _suggested(plan: FloorPlan, robot: str) -> Document:
    """Return what the plan itself knows of a course: its route, or at least the station."""
    route, docks = plan.route_of(robot), [dock for dock in plan.docks if dock.type == robot]
    doors = [door.name for door in plan.doors] if route is not None else []
    named = {"dock": docks[0].name} if len(docks) > 1 else {}
    if route is None:
        stations = [{"number": 0, "x": dock.x, "y": dock.y} for dock in docks[:1]]
        return {**named, "checkpoints": stations}
    points = [
        {"number": one.number, "x": one.x, "y": one.y, "radius": one.radius}
        for one in route.checkpoints
    ]
    return {**named, "checkpoints": points, "path": msgspec.to_builtins(route.path), "doors": doors}


def new_part(key: str, n: int, at: Point) -> Document | None:
    """Return a new part number `n` (from 0) of a list inside a step or a course, placed at a point;
    None for other lists.
    """
    x, y = at
    half = NEW_ZONE / 2.0
    corners = [
        [x - half, y - half],
        [x + half, y - half],
        [x + half, y + half],
        [x - half, y + half],
    ]
    parts: dict[str, Document] = {
        "leaves": {"text": {}},
        "contrasts": {"title": {}, "first": [], "second": []},
        "levels": {"key": f"level_{n + 1}", "title": {}},
        "hypotheses": {"key": f"h{n + 1}"},
        "families": {"key": f"family_{n + 1}"},
        "attention_checks": {"questionnaire": "questionnaire", "item": "item"},
        "speeders": {"questionnaire": "questionnaire", "seconds": 30.0},
        "expected": {"measure": "task_time"},
        "balance": {"item": "age"},
        "screening": {"questionnaire": "questionnaire", "item": "item"},
        "answer_quotas": {"questionnaire": "questionnaire", "item": "item"},
        "modifiers": {"name": f"modifier {n + 1}", "values": []},
        "checkpoints": {"number": n, "x": round(x, 2), "y": round(y, 2)},
        "zones": {
            "name": f"zone_{n + 1}",
            "title": {},
            "polygon": [[round(value, 2) for value in corner] for corner in corners],
        },
    }
    return parts.get(key)


def clicked_point(at: str, default: Point) -> Point:
    """Return the point "x y" that a click on the map stands for; `default` when there was none."""
    points = read_points(at)
    return (
        (points[0][0], points[0][1]) if isinstance(points, list) and len(points) == 1 else default
    )


def middle_of(plan: FloorPlan | None) -> Point:
    """Return the middle of a site's first room, in metres."""
    if plan is None:
        return 0.0, 0.0
    corners = plan.rooms[0].polygon
    return math.fsum(x for x, _ in corners) / len(corners), math.fsum(y for _, y in corners) / len(
        corners
    )


def copied(section: str, part: Document, whole: Document) -> Document:
    """Return a copy of a part of a list, under a key of its own; what is pressed stays with the
    original.
    """
    parts = parts_in(whole, section)
    if section == "courses":
        return part
    if section == "codes":
        return {**part, "code": _free(part["code"], [one["code"] for one in parts]), "key": ""}
    copy = {**part, "key": _free(part["key"], [one["key"] for one in parts])}
    if section == "stages":
        taken = [step["key"] for one in parts for step in one.get("steps", ())]
        copy["steps"] = [
            {**step, "key": _free(step["key"], taken), "shortcut": ""}
            for step in part.get("steps", ())
        ]
    return copy


def _free(key: str, taken: Collection[str]) -> str:
    longest = 36
    return (
        key
        if key not in taken
        else next(
            name for n in range(2, len(taken) + 3) if (name := f"{key[:longest]}_{n}") not in taken
        )
    )
