"""The page of a course: the ground that it draws, and the problems of what is on it."""

from dataclasses import replace

import msgspec

from experiments import publishing
from experiments.definition.problems import problems
from experiments.definition.schema import StudyDefinition
from robots.floorplans import plan_content
from robots.models import FloorPlan
from surveys.document_forms.parts import Document
from surveys.document_forms.problem_text import sentences
from surveys.documents import ProblemPlace


def drawn_course(course: Document) -> Document:
    """Return what a page needs to draw the ground of a course; no plan when there
    is no such site.
    """
    plan = FloorPlan.objects.filter(name=course.get("site", "")).first()
    return {
        "plan": plan_content(plan) if plan is not None else None,
        "robot": course.get("robot", ""),
    }


def course_check(study: StudyDefinition, n: int) -> Document:
    """Return what is wrong with the course with a number, or with its conditions because of it: as
    sentences, and the numbers of the checkpoints that they are about.
    """
    course = study.courses[n]
    mine = (one for one in problems(study) if one.place == ProblemPlace("courses", n))
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
    # Texts that are missing stand above the form; the course itself need not be named on its page.
    found = [one for one in (*mine, *publishing.obstacles_here(alone)) if not one.language]
    numbers = {one.path[1] for one in found if one.path[:1] == ("checkpoints",)}
    found = [
        replace(one, names=one.names[1:]) if one.place.section == "courses" else one
        for one in found
    ]
    return {"problems": sentences(found), "checkpoints": sorted(numbers)}
