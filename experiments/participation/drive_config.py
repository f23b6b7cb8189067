"""What the drive page is told of a study, so that it can guide: the course, and what the
participant may use.

It stands in the page's configuration (sessions.views.page_config) under `study`. What happens in
the task the page hears from the session manager; and where the terms of the session
(sessions/leases/terms.py) say less than this, they win.
"""

from collections.abc import Sequence
from typing import Any

from django.utils.translation import gettext as _

from experiments.definition.conditions import allowed_actions, without_driving
from experiments.definition.course import CourseError
from experiments.definition.feasibility import dock_of
from experiments.definition.schema import Condition, Course, StudyDefinition
from experiments.definition.step import AskingStep, DriveStep, Step
from experiments.models import Drive, Participant
from robots.api.floorplan import FloorPlan
from surveys.documents import spoken


def config(
    participant: Participant,
    choice: Drive | Condition | Sequence[Condition],
    plan: FloorPlan,
    *,
    step_url: str,
) -> dict[str, Any]:
    """Return what the page is told, for `json_script`.

    Args:
        participant: who stands on a practice or a task step.
        choice: the condition, the drive in it, or, before anything is assigned, all conditions that
            it may become: one course, and what any of them allows.
        plan: of the conditions' site.
        step_url: where the study goes on after the drive.

    Raises:
        CourseError: the step is none to drive in, or the conditions have no course, or not the same
            one, on this plan.
    """
    study = participant.study.as_definition()
    conditions = _conditions(study, choice)
    step = study.drive(participant.step)
    if step is None:
        raise CourseError(f"step {participant.step!r} of {study.slug} has no drive")
    return guide(study, step, conditions, plan, language=participant.language, step_url=step_url)


def guide(
    study: StudyDefinition,
    step: DriveStep,
    conditions: Sequence[Condition],
    plan: FloorPlan,
    *,
    language: str,
    step_url: str,
) -> dict[str, Any]:
    """Return what a page is told for conditions that share a course; a practice drive has no
    checkpoints. Metres, radians, minutes.

    Raises:
        CourseError: as `config`.
    """
    course = _course(study, conditions)
    task = None if step.is_practice else study.task
    if not step.is_practice:
        conditions = [_own_part(study, condition) for condition in conditions]
    return {
        "kind": "practice" if step.is_practice else "task",
        "title": spoken(step.title, language),
        "minutes": step.minutes,
        "lastMinutes": 0.0 if task is None else task.last_minutes,
        **ground(None if step.is_practice else course, plan, language),
        **_allowed(conditions),
        "urls": {"step": step_url},
    }


def what_follows(steps: Sequence[Step]) -> str:
    """Return a sentence on what a participant does after a drive; `steps` are those to come."""
    if not steps or steps[0].is_end:
        return _("That was the last part of the study.")
    drives_again = any(isinstance(step, DriveStep) for step in steps)
    if isinstance(steps[0], AskingStep):
        return (
            _("Questions are next, then you drive again.")
            if drives_again
            else _("The last questions are next.")
        )
    if isinstance(steps[0], DriveStep):
        return _("Another drive is next.")
    return _("The study continues with the next step.")


def _conditions(
    study: StudyDefinition, choice: Drive | Condition | Sequence[Condition]
) -> tuple[Condition, ...]:
    if isinstance(choice, Drive):
        condition = study.condition(choice.condition)
        return (condition,) if condition is not None else ()
    return (choice,) if isinstance(choice, Condition) else tuple(choice)


def _own_part(study: StudyDefinition, condition: Condition) -> Condition:
    return without_driving(condition) if study.wizard_of(condition.key) is not None else condition


def _course(study: StudyDefinition, conditions: Sequence[Condition]) -> Course:
    courses = [study.course_of(condition) for condition in conditions]
    if not courses or courses[0] is None or any(course != courses[0] for course in courses):
        keys = ", ".join(condition.key for condition in conditions)
        raise CourseError(
            f"study {study.slug} has no single course for these conditions: {keys or 'none'}"
        )
    return courses[0]


def ground(course: Course | None, plan: FloorPlan, language: str) -> dict[str, Any]:
    """Return what a map draws of a course, none for a drive without one.

    Raises:
        CourseError: the plan has no charging station for it.
    """
    if course is None:
        return {
            "checkpoints": [],
            "dock": None,
            "path": [],
            "doors": [],
            "zones": [],
            "photo": None,
        }
    dock = dock_of(course, plan)
    if dock is None:
        raise CourseError(f"no charging station for {course.robot} on the plan {plan.map_id}")
    return {
        "checkpoints": [
            {
                "number": stop.number,
                "x": stop.x,
                "y": stop.y,
                "radius": stop.radius,
                "title": spoken(stop.title, language),
            }
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


def _allowed(conditions: Sequence[Condition]) -> dict[str, Any]:
    """What is open under any of the conditions; what they fix alike is fixed, else null, and the
    session's terms will tell.
    """
    return {
        "controllers": sorted(
            {controller for condition in conditions for controller in condition.controllers}
        ),
        "ownActions": sorted({action for condition in conditions for action in condition.actions}),
        "actions": sorted(
            {action for condition in conditions for action in allowed_actions(condition)}
        ),
        "assist": _same([condition.assist for condition in conditions]),
        "interface": _same([condition.interface for condition in conditions]),
    }


def _same(values: Sequence[str]) -> str | None:
    return values[0] if len(set(values)) == 1 else None
