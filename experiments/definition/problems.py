"""The problems of a definition in itself, and where each is corrected."""

import math
from collections.abc import Iterable, Iterator
from dataclasses import replace
from itertools import combinations

from experiments.definition import factors, plan_problems, wizard as wizards
from experiments.definition.analyses import AGE, EFFECTS, FAMILIES, DeclaredAnalysis
from experiments.definition.coding import scheme_problems
from experiments.definition.recruitment.piping import piping_problems
from experiments.definition.recruitment.recruiting import recruiting_problems, screening_problems
from experiments.definition.schema import Condition, Course, Impairment, StudyDefinition
from experiments.definition.step import AskingStep, Step
from experiments.definition.steps import KINDS
from surveys.documents import (
    Problem,
    ProblemPlace,
    checked,
    duplicates,
    gettext_noop as _,
    text_problems,
    within,
)

MAX_BYTES = 1024 * 1024
MOST_MINUTES = 240.0  # of driving, for one participant
LEAST_CHECKPOINTS = 2
# Limits of driving: with more loss the robot brakes between commands, below these rates (bit/s)
# commands or frames queue.
MOST_LOSS, LEAST_CONTROL_RATE, LEAST_VIDEO_RATE = 0.5, 50e3, 150e3
# Addresses below /studies/ that a study of this name would hide.
TAKEN_NAMES = frozenset({"link", "invitation", "media"})


def parse(document: bytes) -> StudyDefinition:
    """Return the study in a JSON document. BadDefinitionError: its problems; of types the first."""
    kind = _("kind of step")
    return checked(
        document, StudyDefinition, problems, limit=MAX_BYTES, kinds=KINDS, kind_name=kind
    )


def problems(study: StudyDefinition) -> Iterator[Problem]:
    yield from _of_the_whole(study)
    yield from within(_of_all_steps(study), ProblemPlace("steps"))
    for n, step in enumerate(study.steps):
        found = (*step.problems(), *_of_own_pages(study, step))
        yield from within(found, ProblemPlace("steps", n), _("Step"), step.key)
    for n, condition in enumerate(study.conditions):
        yield from factors.of_condition(n, condition, _of_condition(study, condition))
    for n, course in enumerate(study.courses):
        yield from of_course(n, course, _of_course(study, course))
    yield from _of_assignment_and_analysis(study)
    if study.wizard is not None:
        keys = [condition.key for condition in study.conditions]
        is_debriefed = study.tells_of_operator
        yield from wizards.problems(study.wizard, keys, study.languages, is_debriefed=is_debriefed)
    yield from within(plan_problems.problems(study), ProblemPlace("plan"), _("Plan"))
    place = ProblemPlace("recruitment")
    asked = {step.questionnaire for step in study.questionnaire_steps}
    if study.recruiting is not None:
        yield from within(recruiting_problems(study.recruiting), place)
    rules = (study.screening, study.answer_quotas)
    yield from within(screening_problems(*rules, asked, study.screening_steps), place)
    yield from within(piping_problems(study.steps), place)


def of_course(n: int, course: Course, found: Iterable[Problem]) -> Iterator[Problem]:
    name = (_("Course of"), course.robot, _("at"), course.site)
    return within(found, ProblemPlace("courses", n), *name)


def name_problems(slug: str) -> Iterator[Problem]:
    if slug in TAKEN_NAMES:
        words = _(
            "The name %(name)s is reserved for other addresses of the site: give the study another "
            "one."
        )
        yield Problem(words, {"name": slug})


def _of_the_whole(study: StudyDefinition) -> Iterator[Problem]:
    about = ProblemPlace("about")
    yield from name_problems(study.slug)
    if not study.languages:
        yield Problem(_("There is no language; add at least one."), place=about)
    yield from within(duplicates(_("Language"), study.languages), about)
    if "\x00" in study.source + study.licence + study.recruitment + study.compensation:
        yield Problem(_("A text of the study contains a null character; remove it."), place=about)
    for one in text_problems(study, "study", study.languages):
        match one.path:
            case ("wizard", "stages", int(n), *path):
                place = ProblemPlace("stages", n)
            case (str(section), int(n), *path):
                place = ProblemPlace(section, n)
            case path:
                place = about
        yield replace(one, place=place, path=tuple(path))
    keys = (condition.key for condition in study.conditions)
    yield from within(duplicates(_("Condition"), keys), ProblemPlace("conditions"))
    names = (f"{course.robot}, {course.site}" for course in study.courses)
    yield from within(duplicates(_("Course"), names), ProblemPlace("courses"))


def _of_own_pages(study: StudyDefinition, step: Step) -> Iterator[Problem]:
    for key in sorted(step.named_conditions):
        if study.condition(key) is None:
            yield Problem(_("there is no condition %(key)s."), {"key": key})
    if step.named_conditions and study.allocation.design == "within" and not step.repeat:
        words = _(
            "it has pages for some conditions, and participants do all of them: it must be "
            "repeated for each condition."
        )
        yield Problem(words)


def _of_all_steps(study: StudyDefinition) -> Iterator[Problem]:
    """A round of a participant is the repeated steps: they are consecutive, with the task."""
    yield from duplicates(_("Step"), (step.key for step in study.steps))
    for kind in KINDS.values():
        yield from kind.problems_among(study.steps)
    repeated = [index for index, step in enumerate(study.steps) if step.repeat]
    if repeated and repeated != list(range(repeated[0], repeated[-1] + 1)):
        yield Problem(_("The steps that are repeated must be consecutive."))
    task = study.task
    if study.allocation.design == "within" and task is not None and not task.repeat:
        yield Problem(_("Participants do every condition, so the task must be repeated."))
    driving = sum(step.minutes for step in study.drives)
    if task is not None and driving > MOST_MINUTES:
        words = _("One round lasts up to %(n)g minutes of driving; at most %(most)g are allowed.")
        yield Problem(words, {"n": driving, "most": MOST_MINUTES})
    if task is not None and task.last_minutes > task.minutes:
        words = _("The last %(n)g minutes of the task cannot be longer than the task.")
        yield Problem(words, {"n": task.last_minutes})


def doubts(study: StudyDefinition) -> Iterator[Problem]:
    """Yield settings that are allowed but probably a mistake; the publisher confirms them."""
    yield from _unasked_sharing(study)
    task = study.task
    if task is None or not factors.participants_do_several(study):
        return
    task_index = study.steps.index(task)
    for n, step in enumerate(study.steps):
        is_once = isinstance(step, AskingStep) and step.may_repeat and not step.repeat
        if n > task_index and is_once:
            words = _(
                "participants do several conditions but answer this questionnaire only once, so "
                "its answers belong to no condition. Tick “Once for each condition”, unless it is "
                "about the whole study."
            )
            yield from within([Problem(words)], ProblemPlace("steps", n), _("Step"), step.key)


def _unasked_sharing(study: StudyDefinition) -> Iterator[Problem]:
    consent = study.consent
    if consent is not None and not any(consent.sharing.values()):
        words = _(
            "it does not ask whether data may be published (“Agreement to publishing”), and you "
            "cannot ask later. A public dataset would have everybody who takes part: publish none "
            "unless the text and the ethics approval allow it."
        )
        place = ProblemPlace("steps", study.steps.index(consent))
        yield from within([Problem(words)], place, _("Step"), consent.key)


def _of_condition(study: StudyDefinition, condition: Condition) -> Iterator[Problem]:
    sends = {"places", "map", "follow"}.intersection(condition.actions)
    if not condition.controllers and not sends and study.wizard_of(condition.key) is None:
        words = _(
            "there is no controller and no action that sends the robot (places, map or "
            "follow): nobody could drive."
        )
        yield Problem(words)
    yield from duplicates(_("Controller"), condition.controllers)
    yield from duplicates(_("Action"), condition.actions)
    yield from duplicates(_("Closed door"), condition.doors_closed)
    found = _of_network(condition.network.control, LEAST_CONTROL_RATE)
    yield from within(found, None, _("towards the robot"))
    found = _of_network(condition.network.video, LEAST_VIDEO_RATE)
    yield from within(found, None, _("back from the camera"))
    course, task, linear = study.course_of(condition), study.task, condition.speed.linear
    if course is None:
        words = _("there is no course for %(robot)s at %(site)s.")
        yield Problem(words, {"robot": condition.robot, "site": condition.site})
    elif task is not None and linear and length_of(course) / linear >= task.minutes * 60.0:
        words = _("at %(speed)g m/s the course takes longer than the task's %(n)g minutes.")
        yield Problem(words, {"speed": linear, "n": task.minutes})


def _of_network(impairment: Impairment | None, least_rate: float) -> Iterator[Problem]:
    if impairment is None:
        return
    if impairment.jitter > impairment.delay:
        words = _("the jitter varies the delay both ways, so it cannot be greater than the delay.")
        yield Problem(words)
    if impairment.loss > MOST_LOSS:
        words = _("more than %(n)s of the packets would be lost: nobody could drive.")
        yield Problem(words, {"n": f"{MOST_LOSS:.0%}"})
    if impairment.bitrate is not None and impairment.bitrate < least_rate:
        words = _("the bit rate is below %(n)g kbit/s: nobody could drive.")
        yield Problem(words, {"n": least_rate / 1e3})


def length_of(course: Course) -> float:
    """Return the least length of a course in metres: straight between checkpoints, and back."""
    points = [(checkpoint.x, checkpoint.y) for checkpoint in course.checkpoints]
    return sum(map(math.dist, points, points[1:] + points[:1]))


def _of_course(study: StudyDefinition, course: Course) -> Iterator[Problem]:
    numbers = [checkpoint.number for checkpoint in course.checkpoints]
    if not numbers:
        yield Problem(_("there is no checkpoint; add at least one."))
    elif len(numbers) < LEAST_CHECKPOINTS:
        yield Problem(_("there is no checkpoint besides the charging station; add at least one."))
    elif numbers != list(range(len(numbers))):
        words = _("the checkpoints are numbered %(numbers)s, not 0, 1, 2 …")
        yield Problem(words, {"numbers": numbers})
    if course.photo is not None and course.photo.checkpoint not in numbers[1:]:
        words = _("the photo belongs to checkpoint %(n)d, which does not exist.")
        yield Problem(words, {"n": course.photo.checkpoint})
    yield from duplicates(_("Door"), course.doors)
    yield from duplicates(_("Zone"), (zone.name for zone in course.zones))
    if all(study.course_of(condition) is not course for condition in study.conditions):
        yield Problem(_("no condition uses it."))


def _of_assignment_and_analysis(study: StudyDefinition) -> Iterator[Problem]:
    if not study.conditions:
        words = _("There is no condition; add at least one.")
        yield Problem(words, place=ProblemPlace("conditions"))
        return
    yield from factors.problems(study)
    keys = (one.key for one in study.analyses)
    yield from within(duplicates(_("Analysis"), keys), ProblemPlace("analyses"))
    for n, one in enumerate(study.analyses):
        found = _of_analysis(one, study)
        yield from within(found, ProblemPlace("analyses", n), _("Analysis"), one.key)
    if study.coding is not None:
        yield from scheme_problems(study.coding.codes)
    yield from within(_of_rules(study), ProblemPlace("rules"))


def _of_rules(study: StudyDefinition) -> Iterator[Problem]:
    if bool(study.refill.outcomes) != bool(study.refill.most):
        yield Problem(_("The participant replacement (refill) needs both outcomes and a number."))
    if {"completed", "timed_out"}.intersection(study.refill.outcomes):
        words = _(
            "The participant replacement (refill) cannot include outcomes of the task itself "
            "(completed, timed out)."
        )
        yield Problem(words)
    if study.analysis.statements not in {step.questionnaire for step in study.questionnaire_steps}:
        words = _(
            "“Questionnaire in the tables” is %(name)s, which this study does not ask. Choose one "
            "of its questionnaires."
        )
        yield Problem(words, {"name": study.analysis.statements})


def _of_analysis(one: DeclaredAnalysis, study: StudyDefinition) -> Iterator[Problem]:
    if not one.measures:
        yield Problem(_("it measures nothing; add at least one measure."))
    yield from duplicates(_("Measure"), one.measures)
    for variable in dict.fromkeys(it.rpartition(".")[0] for it in one.measures if "." in it):
        several = [name for name in study.asked if name.startswith(f"{variable}.")]
        if several:
            words = _(
                "several steps ask the questionnaire %(name)s; name the step in its measures, as"
                " in %(example)s.overall."
            )
            yield Problem(words, {"name": variable, "example": several[-1]})
        elif variable not in study.asked:
            words = _("the study does not ask the questionnaire %(name)s.")
            yield Problem(words, {"name": variable})
        elif not study.asked[variable].repeat and _compares_within(one, study):
            words = _(
                "%(name)s is asked only once, so it cannot be compared between conditions that "
                "each participant does: repeat its step."
            )
            yield Problem(words, {"name": variable})
    known = {condition.key for condition in study.conditions}
    named = [*one.conditions, *(key for it in one.contrasts for key in (*it.first, *it.second))]
    for key in dict.fromkeys(named):
        if key not in known:
            yield Problem(_("there is no condition %(key)s."), {"key": key})
    for contrast in one.contrasts:
        if not contrast.first or not contrast.second or set(contrast.first) & set(contrast.second):
            words = _("a contrast compares two different sides of at least one condition each.")
            yield Problem(words)
    yield from _of_model(one, study)


def _compares_within(one: DeclaredAnalysis, study: StudyDefinition) -> bool:
    """Tell whether an analysis compares conditions that one participant does."""
    if one.is_model:
        apart = {factor.key for factor in study.factors if factor.design == "between"}
        names = {name for effect in one.effects for name in effect.split(":")}
        return factors.participants_do_several(study) and not names <= apart
    alone = [(key,) for key in one.conditions or (it.key for it in study.conditions)]
    sides = [(it.first, it.second) for it in one.contrasts] or [*combinations(alone, 2)]
    return any(
        set(keys).intersection(first) and set(keys).intersection(second)
        for keys in factors.conditions_together(study)
        for first, second in sides
    )


def _of_model(one: DeclaredAnalysis, study: StudyDefinition) -> Iterator[Problem]:
    if one.effects and one.test not in {"mixed", *FAMILIES}:
        yield Problem(_("tests of means and ranks have contrasts, and no effects."))
    if not one.effects:
        if one.test == "mixed":
            yield Problem(_("a mixed model needs at least one effect."))
        if one.covariates:
            yield Problem(_("only a model with effects has covariates."))
        return
    if one.contrasts or one.post_hoc:
        yield Problem(_("a model has effects, and neither contrasts nor post-hoc tests."))
    yield from duplicates(_("Covariate"), one.covariates)
    about_person = {name for name, step in study.asked.items() if step.is_about_person}
    for covariate in one.covariates:
        if covariate != AGE and covariate.rpartition(".")[0] not in about_person:
            words = _(
                "the covariate %(name)s is neither age nor an item of a questionnaire about the"
                " person, such as %(example)s."
            )
            asked = min(about_person, default="ict")
            yield Problem(words, {"name": covariate, "example": f"{asked}.games"})
    known = EFFECTS.union(factor.key for factor in study.factors)
    for name in (name for effect in one.effects for name in effect.split(":")):
        if name not in known:
            yield Problem(_("there is no factor %(key)s."), {"key": name})
