"""Resources of this server for studies: its sites, robots, questionnaires and measures; and why a
study cannot run with them.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import astuple
from itertools import takewhile
from typing import Any

import msgspec
from django.utils.translation import get_language, gettext

from experiments.definition.factors import of_condition
from experiments.definition.feasibility import Known, RobotFacts, obstacles
from experiments.definition.plan import AttentionCheck
from experiments.definition.schema import StudyDefinition
from experiments.definition.step import AskingStep, DriveStep
from experiments.definition.steps.instructions import OWN_MEDIA, Instructions
from experiments.models import InstructionMedia
from robots.api import floorplan
from robots.models import FloorPlan, Robot
from sessions.interfaces import INTERFACES
from surveys import questionnaires
from surveys.definition import Definition as QuestionnaireDefinition, language_for
from surveys.documents import Problem, ProblemPlace, gettext_noop as _, spoken, within
from surveys.models import Questionnaire as QuestionnaireRow
from surveys.scoring import scales_of, topic_scales

METRIC_GROUPS = {
    "success": _("Drive: success and time"),
    "motion": _("Drive: path and speed"),
    "safety": _("Drive: collisions and clearance"),
    "commands": _("Drive: commands and input"),
    "network": _("Drive: network and video"),
    "record": _("Drive: quality of the record"),
}


def obstacles_here(definition: StudyDefinition) -> list[Problem]:
    """Return why a study cannot run with the sites, robots and questionnaires of this server."""
    return [
        *obstacles(definition, known_here()),
        *_robots_elsewhere(definition),
        *_unknown_measures(definition),
        *_named_answers(definition),
        *_missing_media(definition),
        *_balance_factors(definition),
    ]


def _missing_media(definition: StudyDefinition) -> Iterator[Problem]:
    for n, step in enumerate(definition.steps):
        pages = step.leaves if isinstance(step, Instructions) else ()
        own = {one.picture for one in pages if (one.picture or "").startswith(OWN_MEDIA)}
        if InstructionMedia.objects.filter(name__in=own).count() < len(own):
            words = _("an own picture or video is not on this site; upload it again.")
            yield from within([Problem(words)], ProblemPlace("steps", n), _("Step"), step.key)


def measures_here(definition: StudyDefinition) -> dict[str, dict[str, str]]:
    """Return titles of measures by group and key: metrics; scores, topics and items of answers."""
    # loads the columns of datasets, which pages about a study without analyses do not need
    from experiments.analysis.metrics.definitions import GROUPS, METRICS  # noqa: PLC0415

    found: dict[str, dict[str, str]] = {gettext(title): {} for title in METRIC_GROUPS.values()}
    for metric in METRICS:
        unit = f" ({metric.unit})" if metric.unit else ""
        group = found[gettext(METRIC_GROUPS[GROUPS[metric.name]])]
        group[metric.name] = metric.name.replace("_", " ").capitalize() + unit
    asked = {(one.questionnaire, one.version): one for one in definition.questionnaire_steps}
    known = {(one.slug, one.version): one for one in _questionnaires(asked)}
    for variable, step in definition.asked.items():
        one = known.get((step.questionnaire, step.version))
        if one is None:
            continue
        language = language_for(one, get_language() or "")
        title = questionnaires.listed_title(one.slug, spoken(one.title, language))
        if "." in variable:
            title = f"{title} – {spoken(step.title, get_language() or '')} ({step.key})"
        overall = gettext("overall score of %(title)s") % {"title": title}
        scales = (*scales_of(one), *topic_scales(one))
        named = {it.key: spoken(it.label, language) or overall for it in scales}
        for item in one.questions():
            if item.item.is_number:
                named.setdefault(item.key, spoken(item.text, language))
        texts = {f"{variable}.{key}": text for key, text in named.items()}
        found.setdefault(title, {}).update(texts)
    return found


def _unknown_measures(definition: StudyDefinition) -> Iterator[Problem]:
    if not definition.analyses:
        return
    from experiments.analysis.metrics.definitions import unfit_for  # noqa: PLC0415

    no_metric = _("there is no metric %(name)s.")
    no_item = _("the questionnaire has no item, topic or score %(name)s.")
    unfit = _("the test does not fit %(name)s; choose one of: %(tests)s.")
    known = {name for group in measures_here(definition).values() for name in group}
    for n, one in enumerate(definition.analyses):
        found = []
        for name in one.measures:
            variable, point, _item = name.rpartition(".")
            if name not in known and (not point or variable in definition.asked):
                found.append(Problem(no_item if point else no_metric, {"name": name}))
            if tests := unfit_for(one.test, name):
                found.append(Problem(unfit, {"name": name, "tests": tests}))
        yield from within(found, ProblemPlace("analyses", n), _("Analysis"), one.key)


def _named_answers(definition: StudyDefinition) -> Iterator[Problem]:
    """Yield checks, screening rules and quotas whose item or answer the questionnaire lacks."""
    checks = definition.plan.attention_checks if definition.plan is not None else ()
    rules: list[Any] = [*checks, *definition.screening, *definition.answer_quotas]
    versions = {(step.questionnaire, step.version) for step in definition.questionnaire_steps}
    for rule in rules:
        is_check = isinstance(rule, AttentionCheck)
        answers = (rule.answer,) if is_check else rule.answers
        name = _("attention check") if is_check else _("rule")
        place = (ProblemPlace("plan"), _("Plan")) if is_check else (ProblemPlace("recruitment"),)
        for asked in _questionnaires(one for one in versions if one[0] == rule.questionnaire):
            found = _of_item(asked, rule.item, answers)
            named = within(found, None, name, f"{rule.questionnaire}.{rule.item}")
            yield from within(named, *place)


def _of_item(
    asked: QuestionnaireDefinition, item: str, answers: Sequence[str]
) -> Iterator[Problem]:
    question = asked.question(item)
    if question is None:
        yield Problem(_("the questionnaire has no such item."))
        return
    options = {str(value) for value, _label in question.labelled_values}
    if question.item.is_free_text:
        yield Problem(_("a free text has no right answer."))
    elif options and not question.item.takes_several and not options.issuperset(answers):
        yield Problem(_("its answers are %(answers)s."), {"answers": ", ".join(sorted(options))})


def _balance_factors(definition: StudyDefinition) -> Iterator[Problem]:
    """Yield the balance factors that have no answer yet when the robot is assigned."""
    before = takewhile(lambda step: not isinstance(step, DriveStep), definition.steps)
    asked = {(one.questionnaire, one.version) for one in before if isinstance(one, AskingStep)}
    for factor in definition.allocation.balance:
        questionnaire, _point, item = factor.item.rpartition(".")
        found = [one for one in _questionnaires(asked) if one.slug == questionnaire]
        consent, words = definition.consent, ""
        if not questionnaire and (consent is None or not consent.minimum_age):
            words = _("the consent does not ask the age: give it a minimum age.")
        elif questionnaire and not found:
            words = _("the questionnaire is not asked before the first drive.")
        elif questionnaire and not any(one.question(item) for one in found):
            words = _("the questionnaire has no such item.")
        if words:
            named = within([Problem(words)], None, _("balance factor"), factor.item)
            yield from within(named, ProblemPlace("rules"))


def shipped_questionnaires() -> dict[tuple[str, int], QuestionnaireDefinition]:
    return {(one.slug, one.version): one for one in questionnaires.shipped().values()}


def _questionnaires(versions: Iterable[tuple[str, int]]) -> Iterator[QuestionnaireDefinition]:
    for slug, version in sorted(versions):
        row = QuestionnaireRow.objects.filter(slug=slug, version=version).first()
        found = row.as_definition() if row is not None else None
        if found := found or shipped_questionnaires().get((slug, version)):
            yield found


def known_here() -> Known:
    """Return what studies can use here; publishing stores shipped questionnaires."""
    asked = frozenset((one.slug, one.version) for one in usable())
    return Known(sites(), robots_here(), asked, frozenset(INTERFACES))


def sites() -> dict[str, floorplan.FloorPlan]:
    """Return the plans of the sites by map id; sites that only have an image have no courses."""
    rows = FloorPlan.objects.exclude(plan={}).values_list("name", "plan")
    return {name: floorplan.decode(msgspec.json.encode(plan)) for name, plan in rows}


def robots_here() -> dict[str, RobotFacts]:
    """Return what all robots of a series can do: a participant may get any of them."""
    found: dict[str, RobotFacts] = {}
    for robot in _known_robots():
        sheet = robot.presence.factsheet or {}
        limits, series = sheet["limits"], sheet["series"]
        facts = RobotFacts(
            frozenset(sheet["capabilities"]),
            min(limits["linear"], robot.max_linear or float("inf")),
            limits.get("commandAge", RobotFacts.command_age),
            limits.get("frameAge", RobotFacts.frame_age),
            min(limits.get("angular", RobotFacts.angular), robot.max_angular or RobotFacts.angular),
        )
        capabilities, *numbers = astuple(found.get(series, facts))
        mine, *own = astuple(facts)
        found[series] = RobotFacts(mine & capabilities, *map(min, own, numbers))
    return found


def _known_robots() -> list[Robot]:
    """Return the robots in use that have published a factsheet."""
    robots = Robot.objects.filter(enabled=True, practice=False).select_related("floor_plan")
    return [robot for robot in robots.defer("floor_plan__image") if robot.presence.factsheet]


def _robots_elsewhere(definition: StudyDefinition) -> Iterator[Problem]:
    placed = (robot for robot in _known_robots() if robot.floor_plan is not None)
    here = {((one.presence.factsheet or {})["series"], one.floor_plan.name) for one in placed}
    series = {name for name, _site in here}
    for n, condition in enumerate(definition.conditions):
        if condition.robot in series and (condition.robot, condition.site) not in here:
            words = _("there is no %(robot)s at the site %(site)s.")
            named = {"robot": condition.robot, "site": condition.site}
            yield from of_condition(n, condition, [Problem(words, named)])


def usable() -> Iterator[QuestionnaireDefinition]:
    """Yield usable questionnaires: complete ones here, and shipped ones that are no templates."""
    rows = list(QuestionnaireRow.objects.order_by("title", "slug", "version"))
    yield from (row.as_definition() for row in rows if questionnaires.is_usable(row))
    taken = {(row.slug, row.version) for row in rows}
    for version, one in shipped_questionnaires().items():
        if not one.template and version not in taken:
            yield one
