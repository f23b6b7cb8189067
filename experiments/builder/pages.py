"""The pages of the study builder: what of a definition each edits, and what buttons add to it."""

from collections.abc import Collection, Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass
from statistics import fmean
from typing import Any

import msgspec

from experiments.builder.arrangement import free_key
from experiments.builder.design import StudyDesign, design_of, new_factor, new_level, with_design
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
from surveys.document_forms.parts import Document, in_languages, read_points

# The fields of the study itself, by page.
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
PLAN = "plan"  # edits the plan; an empty one is removed
DESIGN = "design"  # edits a design.StudyDesign
LISTS = ("steps", "factors", "conditions", "courses", "analyses")
# Lists inside an optional part of the study, shown on its page.
INNER_LISTS: Mapping[str, str] = {"stages": "wizard", "codes": "coding"}
CLASSES: Mapping[str, type[Any]] = {
    "factors": Factor,
    "conditions": Condition,
    "courses": Course,
    "analyses": DeclaredAnalysis,
    "stages": WizardStage,
    "codes": Code,
}
KEPT = ("kind", "levels")  # fields of steps and conditions without an input
CONTROLLERS = ("keyboard", "mouse", "touch", "stick")  # of a new condition
NEW_ZONE = 1.0  # sides of a new zone in metres
# New parts: the field that names them, its value, and the other fields that they need. In sum
# coding the main effect of a factor does not depend on the levels of the others.
NEW: Mapping[str, tuple[str, str, Document]] = {
    "conditions": ("key", "condition", {"title": {}, "controllers": CONTROLLERS}),
    "analyses": ("key", "analysis", {"title": {}, "coding": "sum"}),
    "stages": ("key", "stage", {"title": {}}),
    "codes": ("code", "code", {"name": "", "kind": "point"}),
}


@dataclass(frozen=True)
class BuilderPlace:
    """A page: a section of the study, or one part of a list, from 0."""

    section: str
    index: int | None = None

    def part(self, whole: Document) -> Document | None:
        """Return the document that the page edits; None for no such page."""
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
        if self.section == DESIGN:
            return with_design(whole, part)
        if self.section == PLAN:
            filled = {key: value for key, value in part.items() if value not in ([], "", None)}
            return {**whole, PLAN: filled or None}
        if self.index is None:
            kept = {key: value for key, value in whole.items() if key not in self.only}
            for section, owner in INNER_LISTS.items():
                if part.get(owner) is not None:
                    part = part | {owner: {**part[owner], section: parts_in(whole, section)}}
            changed = kept | part
            languages = part.get("languages")
            return in_languages(StudyDefinition, changed, languages) if languages else changed
        parts = list(parts_in(whole, self.section))
        kept = {key: parts[self.index][key] for key in KEPT if key in parts[self.index]}
        parts[self.index] = {**kept, **(renumber(part) if self.section == "courses" else part)}
        return with_parts(whole, self.section, parts)


def parts_in(whole: Document, section: str) -> list[Document]:
    around = whole if section in LISTS else whole.get(INNER_LISTS[section]) or {}
    found: list[Document] = around.get(section, [])
    return found


def with_parts(whole: Document, section: str, parts: list[Document]) -> Document:
    if section in LISTS:
        return {**whole, section: parts}
    owner = INNER_LISTS[section]
    return {**whole, owner: {**(whole.get(owner) or {}), section: parts}}


def renumber(course: Document) -> Document:
    """Return a course with its checkpoints numbered in order; its photo keeps its checkpoint."""
    checkpoints, photo = course.get("checkpoints", []), course.get("photo")
    places = {checkpoint.get("number"): n for n, checkpoint in enumerate(checkpoints)}
    numbered = [{**checkpoint, "number": n} for n, checkpoint in enumerate(checkpoints)]
    if photo and photo.get("checkpoint") in places:
        course = {**course, "photo": {**photo, "checkpoint": places[photo["checkpoint"]]}}
    return {**course, "checkpoints": numbered}


@dataclass(frozen=True)
class AtHand:
    """Resources that conditions can use on this server: the sites' plans by map id, and the series
    of the robots.
    """

    sites: Mapping[str, FloorPlan]
    robots: Sequence[str]

    @property
    def first(self) -> tuple[str, str]:
        return next(iter(self.robots), "robot"), next(iter(self.sites), "site")


def new_step(kind: str, blank: Mapping[str, Any], whole: Document) -> Document:
    """Return a step of a kind without texts; questionnaires repeat if the task does."""
    key = free_key(kind, _taken(whole, "steps"))
    is_repeated = any(one.get("repeat") and one["kind"] == "task" for one in whole["steps"])
    asks = issubclass(KINDS[kind], AskingStep) and KINDS[kind].may_repeat
    repeat = {"repeat": True} if is_repeated and asks else {}
    return {"kind": kind, "key": key, "title": {}, **blank, **repeat}


def landing(whole: Document, step: Document) -> int | None:
    """Return the last index at which a new step adds no problem of its kind; None without one."""

    def count(documents: list[Document]) -> int:
        steps = [msgspec.convert(one, KINDS[one["kind"]]) for one in documents]
        return sum(1 for kind in KINDS.values() for _problem in kind.problems_among(steps))

    steps = whole["steps"]
    counts = {n: count([*steps[:n], step, *steps[n:]]) for n in range(len(steps), -1, -1)}
    best = min(counts, key=lambda n: counts[n])
    return best if counts[best] <= count(steps) else None


def new_in(section: str, whole: Document, **more: Any) -> Document:
    """Return a new part of a list (`NEW`) under a name that is free there."""
    name, value, fields = NEW[section]
    return {name: free_key(value, _taken(whole, section)), **deepcopy(fields), **more}


def new_condition(whole: Document, at_hand: AtHand) -> Document:
    robot, site = at_hand.first
    return new_in("conditions", whole, robot=robot, site=site)


def _taken(whole: Document, section: str) -> list[str]:
    name = NEW[section][0] if section in NEW else "key"
    return [one[name] for one in parts_in(whole, section)]


def new_script_step(stage: Document, kind: str, places: Sequence[str]) -> Document | None:
    """Return a step of a script: with a line, or a move of a kind; None for an unknown kind."""
    key = free_key(f"{stage['key']}_1", [one["key"] for one in stage.get("steps", ())])
    moves: dict[str, Document] = {"dock": {}, "undock": {}, "turn": {}, "tilt": {"angle": 0.0}}
    moves["place"] = {"name": next(iter(places), "place")}
    moves["drive"] = {"linear": 0.2, "seconds": 2.0}
    if kind and kind not in moves:
        return None
    move = {"move": {"kind": kind, **moves[kind]}} if kind else {}
    return {"key": key, "title": {}, **move}


def new_course(whole: Document, at_hand: AtHand) -> Document:
    """Return a course for the first robot and site of conditions without one."""
    wanted = [(one["robot"], one["site"]) for one in whole["conditions"]]
    taken = {(one["robot"], one["site"]) for one in whole["courses"]}
    robot, site = next((one for one in wanted if one not in taken), at_hand.first)
    return _suggested(robot, site, at_hand)


def with_courses(whole: Document, at_hand: AtHand) -> Document:
    """Return a study with a course for each robot and site of its conditions."""
    courses = whole.get("courses", [])
    taken = {(one["robot"], one["site"]) for one in courses}
    wanted = dict.fromkeys((one["robot"], one["site"]) for one in whole["conditions"])
    new = [one for one in wanted if one[1] in at_hand.sites and one not in taken]
    return {**whole, "courses": [*courses, *(_suggested(*one, at_hand) for one in new)]}


def _suggested(robot: str, site: str, at_hand: AtHand) -> Document:
    """Return a course with the route that a plan suggests, or at least its station."""
    course: Document = {"robot": robot, "site": site, "checkpoints": []}
    plan = at_hand.sites.get(site)
    if plan is None:
        return course
    docks = [dock for dock in plan.docks if dock.type == robot]
    if len(docks) > 1:
        course["dock"] = docks[0].name
    if (route := plan.route_of(robot)) is None:
        stations = [{"number": 0, "x": dock.x, "y": dock.y} for dock in docks[:1]]
        return course | {"checkpoints": stations}
    fields, doors = ("number", "x", "y", "radius"), [door.name for door in plan.doors]
    points = [{name: getattr(one, name) for name in fields} for one in route.checkpoints]
    return course | {"checkpoints": points, "path": msgspec.to_builtins(route.path), "doors": doors}


def new_part(
    name: str, others: list[Document], kind: str, languages: Collection[str], at: Point
) -> Document | None:
    """Return a new part of a list ("factors.0.levels") at a point; None for other lists."""
    key, n = name.rpartition(".")[2], len(others)
    if key == "factors":
        return new_factor(others, kind if kind in SETTINGS else "", languages)
    if key == "levels":
        return new_level(others)
    x, y = at
    half = NEW_ZONE / 2.0
    offsets = ((-half, -half), (half, -half), (half, half), (-half, half))
    corners = [[round(x + dx, 2), round(y + dy, 2)] for dx, dy in offsets]
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
        "zones": {"name": f"zone_{n + 1}", "title": {}, "polygon": corners},
    }
    return parts.get(key)


def clicked_point(at: str, default: Point) -> Point:
    """Return the point "x y" of a click on the map; `default` without one."""
    match read_points(at):
        case [[float(x), float(y)]]:
            return x, y
    return default


def middle_of(plan: FloorPlan | None) -> Point:
    if plan is None:
        return 0.0, 0.0
    xs, ys = zip(*plan.rooms[0].polygon, strict=True)
    return fmean(xs), fmean(ys)


def copied(section: str, part: Document, whole: Document) -> Document:
    """Return a copy of a part of a list under a free name, without the keys to press."""
    if section == "courses":
        return part
    if section == "codes":
        return {**part, "code": free_key(part["code"], _taken(whole, section)), "key": ""}
    copy = {**part, "key": free_key(part["key"], _taken(whole, section))}
    if section == "stages":
        stages = parts_in(whole, section)
        taken = [step["key"] for one in stages for step in one.get("steps", ())]
        copy["steps"] = [
            {**step, "key": free_key(step["key"], taken), "shortcut": ""}
            for step in part.get("steps", ())
        ]
    return copy
