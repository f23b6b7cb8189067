"""The study's part of the drive page's configuration (sessions.views.page_config, under `study`):
the course, and what the participant may use.

The session manager sends what happens in the task. Where the terms of the session
(sessions/leases/terms.py) allow less than this, the terms apply.
"""

from collections.abc import Iterable, Sequence
from typing import Any

from django.utils.translation import gettext as _

from experiments.definition.conditions import allowed_actions, without_driving
from experiments.definition.course import CourseError
from experiments.definition.feasibility import dock_of
from experiments.definition.schema import Condition, Course, StudyDefinition
from experiments.definition.step import AskingStep, DriveStep, Step
from robots.api.floorplan import FloorPlan
from surveys.documents import spoken

NO_COURSE: dict[str, Any] = {
    "checkpoints": [],
    "dock": None,
    "path": [],
    "doors": [],
    "zones": [],
    "photo": None,
}


def guide(
    study: StudyDefinition,
    step: DriveStep,
    conditions: Sequence[Condition],
    plan: FloorPlan,
    *,
    language: str,
    step_url: str,
) -> dict[str, Any]:
    """Return the configuration of a drive in metres, radians and minutes; a practice drive has no
    checkpoints.

    Before the assignment, `conditions` are all that the participant may get: what any of them
    allows is allowed, and a setting in which they differ is null, until the session's terms decide
    it. `plan` is that of their site, `step_url` where the study continues after the drive. Raises a
    CourseError when the conditions have no course, or not the same one, on this plan.
    """
    course, last_minutes = _course(study, conditions), 0.0
    if step.is_practice:
        course = None
    else:
        last_minutes = study.task.last_minutes if study.task is not None else 0.0
        operated = {one.key for one in conditions if study.wizard_of(one.key) is not None}
        conditions = [without_driving(one) if one.key in operated else one for one in conditions]
    return {
        "kind": "practice" if step.is_practice else "task",
        "title": spoken(step.title, language),
        "minutes": step.minutes,
        "lastMinutes": last_minutes,
        **ground(course, plan, language),
        "controllers": _union(one.controllers for one in conditions),
        "ownActions": _union(one.actions for one in conditions),
        "actions": _union(allowed_actions(one) for one in conditions),
        "assist": _same([one.assist for one in conditions]),
        "interface": _same([one.interface for one in conditions]),
        "urls": {"step": step_url},
    }


def what_follows(steps: Sequence[Step]) -> str:
    """Return a sentence on what a participant does after a drive; `steps` are those to come."""
    if not steps or steps[0].is_end:
        return _("That was the last part of the study.")
    if isinstance(steps[0], AskingStep):
        if any(isinstance(step, DriveStep) for step in steps):
            return _("Questions are next, then you drive again.")
        return _("The last questions are next.")
    if isinstance(steps[0], DriveStep):
        return _("Another drive is next.")
    return _("The study continues with the next step.")


def _course(study: StudyDefinition, conditions: Sequence[Condition]) -> Course:
    courses = [study.course_of(condition) for condition in conditions]
    if not courses or courses[0] is None or any(course != courses[0] for course in courses):
        keys = ", ".join(condition.key for condition in conditions) or "none"
        raise CourseError(f"study {study.slug} has no single course for these conditions: {keys}")
    return courses[0]


def ground(course: Course | None, plan: FloorPlan, language: str) -> dict[str, Any]:
    """Return what a map draws of a course, nothing without one; a CourseError when the plan has no
    charging station for it.
    """
    if course is None:
        return NO_COURSE
    dock = dock_of(course, plan)
    if dock is None:
        raise CourseError(f"no charging station for {course.robot} on the plan {plan.map_id}")
    return {
        "checkpoints": [
            {"number": stop.number, "x": stop.x, "y": stop.y, "radius": stop.radius}
            | {"title": spoken(stop.title, language)}
            for stop in course.checkpoints
        ],
        "dock": {"x": dock.x, "y": dock.y, "theta": dock.theta},
        "path": course.path,
        "doors": course.doors,
        "zones": [
            {"name": zone.name, "title": spoken(zone.title, language), "polygon": zone.polygon}
            for zone in course.zones
        ],
        "photo": {"checkpoint": course.photo.checkpoint} if course.photo is not None else None,
    }


def _union(sets: Iterable[Iterable[str]]) -> list[str]:
    return sorted({name for names in sets for name in names})


def _same(values: Sequence[str]) -> str | None:
    return values[0] if len(set(values)) == 1 else None
