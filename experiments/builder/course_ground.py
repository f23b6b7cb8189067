"""The page of a course: the ground that it draws, and the problems of what is on it."""

import re
from collections.abc import Iterable

import msgspec

from experiments import publishing
from experiments.definition.problems import problems
from experiments.definition.schema import Course, StudyDefinition
from robots.floorplans import plan_content
from robots.models import FloorPlan
from surveys.document_forms.parts import Document

WRONG_PLACE = re.compile(r"checkpoint (\d+) (?:cannot be reached|is not in a room|is not at)")


def drawn_course(course: Document) -> Document:
    """Return what a page needs to draw the ground of a course; no plan when there
    is no such site.
    """
    plan = FloorPlan.objects.filter(name=course.get("site", "")).first()
    return {
        "plan": plan_content(plan) if plan is not None else None,
        "robot": course.get("robot", ""),
    }


def problems_of_course(study: StudyDefinition, course: Course) -> list[str]:
    """Return what is wrong with one course of a study, or with its conditions because of it."""
    mine = f"Course of {course.robot} at {course.site}: "
    wrong = [text for text in problems(study) if text.startswith(mine)]
    driven = tuple(
        one for one in study.conditions if (one.robot, one.site) == (course.robot, course.site)
    )
    # Its conditions come first: what a checkpoint is not reached from is told for each of them.
    alone = msgspec.structs.replace(
        study,
        courses=(course,),
        conditions=driven,
        steps=tuple(step for step in study.steps if step is study.task),
    )
    return [text.removeprefix(mine) for text in (*wrong, *publishing.obstacles_here(alone))]


def wrong_checkpoints(texts: Iterable[str]) -> list[int]:
    """Return the numbers of the checkpoints that problems of a course speak of, in order."""
    return sorted({int(n) for text in texts for n in WRONG_PLACE.findall(text)})
