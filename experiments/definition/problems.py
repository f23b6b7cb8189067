"""What is wrong with a study that somebody wrote, in sentences that say where. Asks nothing but the
study itself.
"""

import math
from collections.abc import Iterator

from experiments.definition import factors, plan_problems
from experiments.definition import wizard as wizards
from experiments.definition.analyses import EFFECTS, DeclaredAnalysis
from experiments.definition.coding import scheme_problems
from experiments.definition.schema import Condition, Course, Impairment, StudyDefinition
from experiments.definition.step import Step
from experiments.definition.steps import KINDS
from surveys.documents import checked, duplicates, text_problems

MAX_BYTES = 1024 * 1024
MOST_MINUTES = 240.0  # of driving, for one participant
LEAST_CHECKPOINTS = 2
# Beyond these nobody can drive: with more loss the robot brakes between commands, below these rates
# commands or pictures only queue (bit/s).
MOST_LOSS, LEAST_CONTROL_RATE, LEAST_VIDEO_RATE = 0.5, 50e3, 150e3
# a study of that name could not be reached: /studies/link/ leads to personal links
TAKEN_NAMES = frozenset({"link"})


def parse(document: bytes) -> StudyDefinition:
    """Return the study that a JSON document holds.

    Raises:
        BadDefinitionError: with every problem found; JSON or types that are wrong end the search at
            the first.
    """
    return checked(
        document, StudyDefinition, problems, limit=MAX_BYTES, kinds=KINDS, kind_name="kind of step"
    )


def problems(study: StudyDefinition) -> Iterator[str]:
    """Yield what is wrong with a study whose types are right."""
    yield from _of_the_whole(study)
    yield from _of_steps(study)
    for condition in study.conditions:
        yield from (
            f"Condition {condition.key}: {problem}" for problem in _of_condition(study, condition)
        )
    for course in study.courses:
        yield from (
            f"Course of {course.robot} at {course.site}: {problem}"
            for problem in _of_course(study, course)
        )
    yield from _of_allocation(study)
    if study.wizard is not None:
        yield from wizards.problems(
            study.wizard,
            [condition.key for condition in study.conditions],
            study.languages,
            told=study.tells_of_operator,
        )
    yield from (f"Plan: {problem}" for problem in plan_problems.problems(study))


def name_problems(slug: str) -> Iterator[str]:
    """Yield why a study cannot have a name."""
    if slug in TAKEN_NAMES:
        yield (
            f"The name {slug} is reserved for the addresses of personal links: "
            "give the study another one."
        )


def _of_the_whole(study: StudyDefinition) -> Iterator[str]:
    yield from name_problems(study.slug)
    if not study.languages:
        yield "There is no language; add at least one."
    yield from duplicates("language", study.languages)
    yield from text_problems(study, "study", study.languages)
    if "\x00" in study.source + study.licence + study.recruitment + study.compensation:
        yield "A text of the study contains a null character; remove it."
    yield from duplicates("condition", (condition.key for condition in study.conditions))
    yield from duplicates(
        "course", (f"of {course.robot} at {course.site}" for course in study.courses)
    )
    yield from duplicates("step", (step.key for step in study.steps))


def _of_steps(study: StudyDefinition) -> Iterator[str]:
    for kind in KINDS.values():
        yield from kind.problems_among(study.steps)
    yield from _of_repeats(study)
    for step in study.steps:
        yield from (f"Step {step.key}: {problem}" for problem in step.problems())
        yield from (f"Step {step.key}: {problem}" for problem in _of_own_pages(study, step))


def _of_own_pages(study: StudyDefinition, step: Step) -> Iterator[str]:
    for key in sorted(step.named_conditions):
        if study.condition(key) is None:
            yield f"there is no condition {key}."
    if step.named_conditions and study.allocation.design == "within" and not step.repeat:
        yield (
            "it has pages for some conditions, and participants do all of them: it must be"
            " repeated for each condition."
        )


def _of_repeats(study: StudyDefinition) -> Iterator[str]:
    """Who drives several times goes round the repeated steps, so these stand together and the task
    is among them.
    """
    repeated = [index for index, step in enumerate(study.steps) if step.repeat]
    if repeated and repeated != list(range(repeated[0], repeated[-1] + 1)):
        yield "The steps that are repeated must be consecutive."
    task = study.task
    if study.allocation.design == "within" and task is not None and not task.repeat:
        yield "Participants do every condition, so the task must be repeated."
    driving = sum(step.minutes for step in study.drives)
    if task is not None and driving > MOST_MINUTES:
        yield (
            f"One round lasts up to {driving:g} minutes of driving; at most {MOST_MINUTES:g} are"
            " allowed."
        )
    if task is not None and task.last_minutes > task.minutes:
        yield (
            f"The last {task.last_minutes:g} minutes of the task cannot be longer than the task."
        )


def _of_condition(study: StudyDefinition, condition: Condition) -> Iterator[str]:
    sends = {"places", "map", "follow"}.intersection(condition.actions)
    if not condition.controllers and not sends and study.wizard_of(condition.key) is None:
        yield (
            "there is no controller and no action that sends the robot (places, "
            "map or follow): nobody could drive."
        )
    for what, names in (
        ("controller", condition.controllers),
        ("action", condition.actions),
        ("closed door", condition.doors_closed),
    ):
        yield from duplicates(what, names)
    yield from _of_network("towards the robot", condition.network.control, LEAST_CONTROL_RATE)
    yield from _of_network("back from the camera", condition.network.video, LEAST_VIDEO_RATE)
    course = study.course_of(condition)
    if course is None:
        yield f"there is no course for {condition.robot} at {condition.site}."
        return
    task, linear = study.task, condition.speed.linear
    if (
        task is not None
        and linear is not None
        and length_of(course) / linear >= task.minutes * 60.0
    ):
        yield f"at {linear:g} m/s the course takes longer than the task's {task.minutes:g} minutes."


def _of_network(direction: str, impairment: Impairment | None, least_rate: float) -> Iterator[str]:
    if impairment is None:
        return
    if impairment.jitter > impairment.delay:
        yield (
            f"{direction}, the jitter varies the delay both ways, so it cannot be "
            "greater than the delay."
        )
    if impairment.loss > MOST_LOSS:
        yield (
            f"{direction}, more than {MOST_LOSS:.0%} of the packets would be lost: nobody could"
            " drive."
        )
    if impairment.bitrate is not None and impairment.bitrate < least_rate:
        yield f"{direction}, the bit rate is below {least_rate / 1e3:g} kbit/s: nobody could drive."


def length_of(course: Course) -> float:
    """Return the least length of a course in metres: straight from checkpoint to checkpoint and
    back to the station.
    """
    points = [(checkpoint.x, checkpoint.y) for checkpoint in course.checkpoints]
    return (
        sum(
            math.dist(one, other)
            for one, other in zip(points, points[1:] + points[:1], strict=True)
        )
        if points
        else 0.0
    )


def _of_course(study: StudyDefinition, course: Course) -> Iterator[str]:
    numbers = [checkpoint.number for checkpoint in course.checkpoints]
    if len(numbers) < LEAST_CHECKPOINTS:
        yield (
            "there is no checkpoint besides the charging station; add at least one."
            if numbers
            else "there is no checkpoint; add at least one."
        )
    elif numbers != list(range(len(numbers))):
        yield f"the checkpoints are numbered {numbers}, not 0, 1, 2 …"
    if course.photo is not None and course.photo.checkpoint not in numbers[1:]:
        yield f"the photo belongs to checkpoint {course.photo.checkpoint}, which does not exist."
    yield from duplicates("door", course.doors)
    yield from duplicates("zone", (zone.name for zone in course.zones))
    if all(study.course_of(condition) is not course for condition in study.conditions):
        yield "no condition uses it."


def _of_allocation(study: StudyDefinition) -> Iterator[str]:
    if not study.conditions:
        yield "There is no condition; add at least one."
        return
    yield from factors.problems(study)
    yield from _of_analyses(study)
    if study.coding is not None:
        yield from scheme_problems(study.coding.codes)
    if bool(study.refill.outcomes) != bool(study.refill.most):
        yield "The participant replacement (refill) needs both outcomes and a number."
    if {"completed", "timed_out"}.intersection(study.refill.outcomes):
        yield (
            "The participant replacement (refill) cannot include outcomes of the task itself"
            " (completed, timed out)."
        )
    known = {step.questionnaire for step in study.asking}
    if study.analysis.statements not in known:
        yield (
            f"The statements of the analysis, {study.analysis.statements}, must "
            "be among the study's questionnaires."
        )


def _of_analyses(study: StudyDefinition) -> Iterator[str]:
    yield from duplicates("analysis", (one.key for one in study.analyses))
    for one in study.analyses:
        yield from (f"Analysis {one.key}: {told}" for told in _of_analysis(one, study))


def _of_analysis(one: DeclaredAnalysis, study: StudyDefinition) -> Iterator[str]:
    if not one.measures:
        yield "it measures nothing; add at least one measure."
    yield from duplicates("measure", one.measures)
    asked = {step.questionnaire for step in study.asking}
    for measure in one.measures:
        questionnaire, point, _ = measure.partition(".")
        if point and questionnaire not in asked:
            yield f"the study does not ask the questionnaire {questionnaire}."
    known = {condition.key for condition in study.conditions}
    named = [*one.conditions, *(key for it in one.contrasts for key in (*it.first, *it.second))]
    for key in dict.fromkeys(named):
        if key not in known:
            yield f"there is no condition {key}."
    for contrast in one.contrasts:
        if not contrast.first or not contrast.second or set(contrast.first) & set(contrast.second):
            yield "a contrast compares two different sides of at least one condition each."
    yield from _of_mixed_model(one, study)


def _of_mixed_model(one: DeclaredAnalysis, study: StudyDefinition) -> Iterator[str]:
    if one.test != "mixed":
        if one.effects:
            yield "only a mixed model has effects."
        return
    if not one.effects:
        yield "a mixed model needs at least one effect."
    if one.contrasts or one.post_hoc:
        yield "a mixed model has effects, and neither contrasts nor post-hoc tests."
    if study.allocation.design != "within":
        yield "a mixed model needs participants who do several conditions."
    factors = {factor.key for factor in study.factors}
    for effect in one.effects:
        for name in effect.split(":"):
            if name not in factors | EFFECTS:
                yield f"there is no factor {name}."
