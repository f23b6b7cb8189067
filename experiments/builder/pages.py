"""The pages of the study builder as places in a definition: what each edits, and how it is put
back.
"""

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import msgspec

from experiments.builder.design import (
    StudyDesign,
    design_of,
    free_key,
    new_factor,
    new_level,
    with_design,
)
from experiments.builder.labels import GUIDE
from experiments.definition.analyses import DeclaredAnalysis
from experiments.definition.coding import Code
from experiments.definition.design import Factor
from experiments.definition.factors import SETTINGS
from experiments.definition.plan import StudyPlan
from experiments.definition.schema import Condition, Course, StudyDefinition
from experiments.definition.step import AskingStep
from experiments.definition.steps import KINDS
from experiments.definition.wizard import WizardStage
from robots.api.floorplan import FloorPlan
from robots.api.messages import Point
from surveys.document_forms.part_form import number
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
    "rules": ("start", "refill", "quality", "analysis"),
    "wizard": ("wizard",),
    "coding": ("coding",),
}
PLAN = "plan"  # the page of an optional part of the study: one without content is none
DESIGN = "design"  # factors, what conditions share, and assignment (experiments/builder/design.py)
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
KEPT = ("kind", "levels")  # what no form of a step or of a condition changes
NEW_ZONE = 1.0  # metres: the sides of a zone before it is drawn


@dataclass(frozen=True)
class BuilderPlace:
    """A page: a section of the study, or one part of a list, from 0."""

    section: str
    index: int | None = None

    def part(self, whole: Document) -> Document | None:
        """Return the document that the page edits; None when there is none."""
        if self.section in {PLAN, DESIGN} and self.index is None:
            return (whole.get(PLAN) or {}) if self.section == PLAN else design_of(whole)
        if self.index is None:
            return whole if self.section in PAGES else None
        parts = parts_in(whole, self.section) if self.section in {*LISTS, *INNER_LISTS} else []
        return parts[self.index] if self.index < len(parts) else None

    def cls(self, part: Document) -> type[Any]:
        if self.section in {PLAN, DESIGN}:
            return StudyPlan if self.section == PLAN else StudyDesign
        if self.index is None:
            return StudyDefinition
        return KINDS[part["kind"]] if self.section == "steps" else CLASSES[self.section]

    @property
    def only(self) -> Collection[str]:
        return PAGES.get(self.section, ())

    def put(self, whole: Document, part: Document) -> Document:
        """Return a study with this part of it replaced."""
        if self.section == DESIGN:
            return with_design(whole, part)
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
        kept = {key: parts[self.index][key] for key in KEPT if key in parts[self.index]}
        parts[self.index] = {**kept, **(renumber(part) if self.section == "courses" else part)}
        return with_parts(whole, self.section, parts)


def parts_in(whole: Document, section: str) -> list[Document]:
    """Return the parts of a list of the study, or of one inside an optional part of it."""
    around = whole if section in LISTS else whole.get(INNER_LISTS[section]) or {}
    found: list[Document] = around.get(section, [])
    return found


def with_parts(whole: Document, section: str, parts: list[Document]) -> Document:
    if section in LISTS:
        return {**whole, section: parts}
    owner = INNER_LISTS[section]
    return {**whole, owner: {**(whole.get(owner) or {}), section: parts}}


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
    """Return a step without words; `blank` is what its kind needs beside them. A questionnaire in a
    study whose task is repeated is repeated with it.
    """
    key = free_key(kind, [one["key"] for one in whole["steps"]])
    is_repeated = any(one.get("repeat") and one["kind"] == "task" for one in whole["steps"])
    asks = issubclass(KINDS[kind], AskingStep) and KINDS[kind].may_repeat
    repeat = {"repeat": True} if is_repeated and asks else {}
    return {"kind": kind, "key": key, "title": {}, **blank, **repeat}


def landing(whole: Document, step: Document) -> int | None:
    """Return where a new step belongs: as late as its kind and the others allow. None for one of
    which there are enough.
    """

    def wrong(documents: list[Document]) -> int:
        steps = [msgspec.convert(one, KINDS[one["kind"]]) for one in documents]
        return sum(1 for kind in KINDS.values() for _problem in kind.problems_among(steps))

    steps = whole["steps"]
    counts = {n: wrong([*steps[:n], step, *steps[n:]]) for n in range(len(steps), -1, -1)}
    best = min(counts, key=lambda n: counts[n])
    return best if counts[best] <= wrong(steps) else None


def new_condition(whole: Document, at_hand: AtHand) -> Document:
    """Return a condition of the first robot and site."""
    key = free_key("condition", [one["key"] for one in whole["conditions"]])
    site, robot = next(iter(at_hand.sites), "site"), next(iter(at_hand.robots), "robot")
    return {
        "key": key,
        "title": {},
        "robot": robot,
        "site": site,
        "controllers": ["keyboard", "mouse", "touch", "stick"],
    }


def new_analysis(whole: Document) -> Document:
    """Return an analysis that measures nothing yet. Its coefficients are main effects: in sum
    coding, that of a factor does not depend on the levels of the others.
    """
    key = free_key("analysis", [one["key"] for one in whole["analyses"]])
    return {"key": key, "title": {}, "coding": "sum"}


def new_stage(whole: Document) -> Document:
    return {
        "key": free_key("stage", [one["key"] for one in parts_in(whole, "stages")]),
        "title": {},
    }


def new_script_step(stage: Document, kind: str, places: Sequence[str]) -> Document | None:
    """Return a step of a script: a line, or a move of a kind; None for another kind."""
    key = free_key(f"{stage['key']}_1", [one["key"] for one in stage.get("steps", ())])
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
    code = free_key("code", [one["code"] for one in parts_in(whole, "codes")])
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


def with_courses(whole: Document, at_hand: AtHand) -> Document:
    """Return a study with a course for each robot and site of its conditions, as the plans of the
    sites suggest them.
    """
    known = [one for one in whole["conditions"] if one["site"] in at_hand.sites]
    courses = whole.get("courses", [])
    while {(one["robot"], one["site"]) for one in known} - {
        (one["robot"], one["site"]) for one in courses
    }:
        new = new_course({**whole, "conditions": known, "courses": courses}, at_hand)
        courses = [*courses, new]
    return {**whole, "courses": courses}


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


def new_part(
    name: str, others: list[Document], kind: str, languages: Collection[str], at: Point
) -> Document | None:
    """Return a new part of a list of that name ("factors.0.levels") beside the others, of a kind
    where there are several, and placed at a point; None for other lists.
    """
    key, n = name.rpartition(".")[2], len(others)
    if key == "factors":
        return new_factor(others, kind if kind in SETTINGS else "", languages)
    if key == "levels":
        return new_level(others)
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


def list_in(part: Document, name: str) -> list[Document] | None:
    """Return the list with a name in a part, made where there is none; None for what is no list of
    parts.
    """
    *way, key = name.split(".")
    here: Any = part
    for step in way:
        if isinstance(here, list):
            here = dict(enumerate(here)).get(number(step))
        else:
            here = here.get(step) if isinstance(here, dict) else None
    is_list = isinstance(here, dict) and key in GUIDE.items
    found = here.setdefault(key, []) if is_list else None
    return found if isinstance(found, list) else None


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
        return {**part, "code": free_key(part["code"], [one["code"] for one in parts]), "key": ""}
    copy = {**part, "key": free_key(part["key"], [one["key"] for one in parts])}
    if section == "stages":
        taken = [step["key"] for one in parts for step in one.get("steps", ())]
        copy["steps"] = [
            {**step, "key": free_key(step["key"], taken), "shortcut": ""}
            for step in part.get("steps", ())
        ]
    return copy
