"""Studies in the database: stored as drafts, published, closed.

A draft may be incomplete: only its types must be right. A published study has no problems, is
feasible with the sites, robots and questionnaires of this server, and never changes again.
"""

import datetime
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import astuple
from itertools import takewhile
from typing import Any

import msgspec
from django.contrib.admin.models import CHANGE, LogEntry
from django.db import IntegrityError, transaction
from django.db.models import Max, Model, QuerySet
from django.utils.translation import get_language, gettext

from accounts import audit
from experiments.definition.factors import of_condition
from experiments.definition.feasibility import Known, RobotFacts, obstacles
from experiments.definition.plan import AttentionCheck
from experiments.definition.problems import doubts, name_problems, problems
from experiments.definition.schema import StudyDefinition, as_stored, digest
from experiments.definition.step import AskingStep, DriveStep
from experiments.definition.steps.consent import SHARING, TEMPLATE
from experiments.definition.steps.instructions import OWN_MEDIA, Instructions
from experiments.models import InstructionMedia, PersonalLink, Rehearsal, StudyMember
from experiments.models import Study as Row
from robots.api import floorplan
from robots.models import FloorPlan, Robot
from sessions.interfaces import INTERFACES
from surveys import questionnaires
from surveys.definition import Definition as QuestionnaireDefinition
from surveys.definition import language_for
from surveys.documents import (
    BadDefinitionError,
    ChangedMeanwhileError,
    Problem,
    ProblemPlace,
    spoken,
    text_in,
    within,
)
from surveys.documents import gettext_noop as _
from surveys.models import Questionnaire as QuestionnaireRow
from surveys.scoring import scales_of, topic_scales

LEAST_REASON = 10  # characters: "later" is no reason
# The steps of an empty study: kind, key, English title, and the fields that its kind needs.
USUAL_STEPS: tuple[tuple[str, str, str, dict[str, Any]], ...] = (
    ("consent", "consent", "Consent", {}),
    ("form", "about_you", "About you", {"questionnaire": "ict", "version": 2}),
    ("instructions", "instructions", "How it works", {"leaves": []}),
    ("task", "task", "Task", {}),
    ("questionnaire", "experience", "Your experience", {"questionnaire": "experience"}),
    ("debrief", "thanks", "Thanks", {"text": {}}),
)


class NotPublishableError(ValueError):
    def __init__(self, reasons: Iterable[Problem]) -> None:
        self.reasons = list(reasons)
        super().__init__("; ".join(map(str, self.reasons)))


# --- into the database ----------------------------------------------------------------------------


def store(definition: StudyDefinition, now: datetime.datetime) -> Row:
    """Store a study as a draft, in place of a draft of the same version, or return the row that
    has the same definition already.

    Raises:
        BadDefinitionError: it has problems, or its version was published with other content.
    """
    if found := list(problems(definition)):
        raise BadDefinitionError(found)
    return _put(definition, now)


def _put(definition: StudyDefinition, now: datetime.datetime) -> Row:
    fields = _fields(definition)
    former = Row.objects.filter(slug=definition.slug).order_by("-version").first()
    key = (former.code_key or former.secret) if former is not None else ""
    named = {"slug": definition.slug, "version": definition.version}
    try:
        with transaction.atomic():
            return Row.objects.create(created_at=now, code_key=key, **named, **fields)
    except IntegrityError:
        rows = Row.objects.filter(**named)
        rows.filter(status=Row.Status.DRAFT).exclude(sha256=fields["sha256"]).update(**fields)
        row = rows.get()
    if row.sha256 != fields["sha256"]:
        words = _("Version %(n)d of %(name)s is published and cannot change: make a new version.")
        values = {"n": definition.version, "name": definition.slug}
        raise BadDefinitionError([Problem(words, values)])
    return row


def _fields(definition: StudyDefinition) -> dict[str, Any]:
    title = text_in(definition.title, ("en", *definition.title)) or definition.slug
    return {"title": title[:200], "definition": as_stored(definition), "sha256": digest(definition)}


def _draft(row: Row) -> "QuerySet[Row]":
    """Return the row of a draft; none once it has been changed or published since it was read."""
    return Row.objects.filter(pk=row.pk, status=Row.Status.DRAFT, sha256=row.sha256)


def save_draft(row: Row, definition: StudyDefinition) -> Row:
    """Store a changed draft, complete or not; name and version stay.

    Raises:
        ChangedMeanwhileError: the study was changed or published since the row was read.
    """
    named = msgspec.structs.replace(definition, slug=row.slug, version=row.version)
    if not _draft(row).update(**_fields(named)):
        raise ChangedMeanwhileError(f"{row.slug} {row.version} has since been changed or published")
    return Row.objects.get(pk=row.pk)


def begin_empty(slug: str, title: str, languages: Sequence[str], now: datetime.datetime) -> Row:
    """Create a draft with the usual steps, without conditions and courses.

    Raises:
        BadDefinitionError: the name is taken or reserved, or it or a language is malformed.
    """
    _check_name(slug)
    languages = tuple(dict.fromkeys(languages))
    steps = [
        {"kind": kind, "key": key, "title": dict.fromkeys(languages, words), **more}
        for kind, key, words, more in USUAL_STEPS
    ]
    steps[0] |= {
        "text": {name: TEMPLATE.get(name, TEMPLATE["en"]) for name in languages},
        "sharing": {name: SHARING.get(name, SHARING["en"]) for name in languages},
    }
    study = {"format": 1, "slug": slug, "version": 1, "title": dict.fromkeys(languages, title)}
    parts = {"languages": languages, "steps": steps, "conditions": [], "courses": []}
    try:
        definition = msgspec.convert(study | parts, StudyDefinition)
    except msgspec.ValidationError as error:
        raise BadDefinitionError([f"{error}."]) from error
    return _put(definition, now)


def new_version(row: Row, now: datetime.datetime) -> Row:
    """Return a draft copy with the next version number and the same settings of recruitment."""
    newest = Row.objects.filter(slug=row.slug).aggregate(newest=Max("version"))["newest"]
    made = _put(msgspec.structs.replace(row.as_definition(), version=newest + 1), now)
    kept = ("entry", "opening_hours", "time_zone", "exclusive", "publication")
    Row.objects.filter(pk=made.pk).update(**{name: getattr(row, name) for name in kept})
    return Row.objects.get(pk=made.pk)


def copy(row: Row, slug: str, title: str, now: datetime.datetime) -> Row:
    """Return a draft of a new study with the same definition: its first version, without
    participants and researchers.

    Raises:
        BadDefinitionError: the name is taken or reserved.
    """
    definition = row.as_definition()
    titles = dict.fromkeys(definition.languages, title)
    _check_name(slug)
    return _put(msgspec.structs.replace(definition, slug=slug, version=1, title=titles), now)


def _check_name(slug: str) -> None:
    taken = list(name_problems(slug))
    if Row.objects.filter(slug=slug).exists():
        taken.append(Problem(_("There is a study %(name)s already."), {"name": slug}))
    if taken:
        raise BadDefinitionError(taken)


def own(row: Row, user: Any) -> None:
    """Make a user the owner of a study that has none."""
    if not StudyMember.objects.filter(slug=row.slug, role=StudyMember.Role.OWNER).exists():
        StudyMember.objects.update_or_create(
            slug=row.slug, user=user, defaults={"role": StudyMember.Role.OWNER}
        )


# --- problems here --------------------------------------------------------------------------------


def problems_of(row: Row) -> list[Problem]:
    """Return why a study cannot be published here. Placeholders in the consent count only here, so
    that a rehearsal can run with them.
    """
    definition = row.as_definition()
    found = list(problems(definition))
    if (consent := definition.consent) is not None:
        place = ProblemPlace("steps", definition.steps.index(consent))
        found += within(consent.unfilled(), place, _("Step"), consent.key)
    found += obstacles_here(definition)
    return [one for n, one in enumerate(found) if one not in found[:n]]


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
    """Return titles of what a study can measure, by group and key: metrics of drives, and the
    scores, topics and items of each questionnaire.
    """
    # loads the columns of datasets, which pages about a study without analyses do not need
    from experiments.analysis.metrics.definitions import METRICS  # noqa: PLC0415

    found = {gettext("Metrics of a drive"): {one.name: _metric_name(one) for one in METRICS}}
    asked = {(step.questionnaire, step.version) for step in definition.asking}
    for one in _questionnaires(asked):
        language = language_for(one, get_language() or "")
        title = questionnaires.listed_title(one.slug, spoken(one.title, language))
        overall = gettext("overall score of %(title)s") % {"title": title}
        scales = (*scales_of(one), *topic_scales(one))
        named = {it.key: spoken(it.label, language) or overall for it in scales}
        for item in one.questions():
            if item.item.is_number:
                named.setdefault(item.key, spoken(item.text, language))
        texts = {f"{one.slug}.{key}": text for key, text in named.items()}
        found.setdefault(title, {}).update(texts)
    return found


def _metric_name(metric: Any) -> str:
    words = metric.name.replace("_", " ").capitalize()
    return f"{words} ({metric.unit})" if metric.unit else words


def _unknown_measures(definition: StudyDefinition) -> Iterator[Problem]:
    if not definition.analyses:
        return
    from experiments.analysis.metrics.definitions import unfit_for  # noqa: PLC0415

    no_metric = _("there is no metric %(name)s.")
    no_item = _("the questionnaire has no item, topic or score %(name)s.")
    unfit = _("the test does not fit %(name)s; choose one of: %(tests)s.")
    known = {name for group in measures_here(definition).values() for name in group}
    asked = {step.questionnaire for step in definition.asking}
    for n, one in enumerate(definition.analyses):
        found = [
            Problem(no_item if "." in name else no_metric, {"name": name})
            for name in one.measures
            if name not in known and ("." not in name or name.partition(".")[0] in asked)
        ]
        found += [
            Problem(unfit, {"name": name, "tests": tests})
            for name in one.measures
            if (tests := unfit_for(one.test, name))
        ]
        yield from within(found, ProblemPlace("analyses", n), _("Analysis"), one.key)


def _named_answers(definition: StudyDefinition) -> Iterator[Problem]:
    """Yield the attention checks, screening rules and quotas that name an item or an answer that
    the questionnaire does not have, or the answer to a free text.
    """
    checks = definition.plan.attention_checks if definition.plan is not None else ()
    rules: list[Any] = [*checks, *definition.screening, *definition.answer_quotas]
    versions = {(step.questionnaire, step.version) for step in definition.asking}
    for rule in rules:
        is_check = isinstance(rule, AttentionCheck)
        answers = (rule.answer,) if is_check else rule.answers
        name = _("attention check") if is_check else _("rule")
        for asked in _questionnaires(one for one in versions if one[0] == rule.questionnaire):
            found = _of_item(asked, rule.item, answers)
            named = within(found, None, name, f"{rule.questionnaire}.{rule.item}")
            if is_check:
                yield from within(named, ProblemPlace("plan"), _("Plan"))
            else:
                yield from within(named, ProblemPlace("recruitment"))


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
    return Known(
        sites=sites(),
        robots=robots_here(),
        questionnaires=frozenset((one.slug, one.version) for one in usable()),
        interfaces=frozenset(INTERFACES),
    )


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
    here = {
        ((robot.presence.factsheet or {})["series"], robot.floor_plan.name)
        for robot in _known_robots()
        if robot.floor_plan is not None
    }
    series = {name for name, _site in here}
    for n, condition in enumerate(definition.conditions):
        if condition.robot in series and (condition.robot, condition.site) not in here:
            words = _("there is no %(robot)s at the site %(site)s.")
            named = {"robot": condition.robot, "site": condition.site}
            yield from of_condition(n, condition, [Problem(words, named)])


def usable() -> Iterator[QuestionnaireDefinition]:
    """Yield the questionnaires that can be asked: complete ones in the database, and those that
    come with the site, without templates.
    """
    rows = list(QuestionnaireRow.objects.order_by("title", "slug", "version"))
    yield from (row.as_definition() for row in rows if questionnaires.is_usable(row))
    taken = {(row.slug, row.version) for row in rows}
    for version, one in shipped_questionnaires().items():
        if not one.template and version not in taken:
            yield one


# --- publishing -----------------------------------------------------------------------------------


def passed_rehearsal(row: Row) -> Rehearsal | None:
    """Return the newest rehearsal of exactly this definition that passed."""
    passed = Rehearsal.objects.filter(study=row, sha256=row.sha256, passed=True)
    return passed.exclude(finished_at=None).order_by("-finished_at").first()


def publish(
    row: Row, user: Any, reason: str, now: datetime.datetime, *, is_confirmed: bool = False
) -> Row:
    """Open a draft to participants, freeze its definition, and close the former version.

    `user` is None for a command. A `reason` is needed without a rehearsal that passed.
    `is_confirmed`: the publisher has confirmed the doubts.

    Raises:
        NotPublishableError: with every reason.
    """
    rehearsal, reason, definition = passed_rehearsal(row), reason.strip(), row.as_definition()
    is_draft, unsure = row.status == Row.Status.DRAFT, list(doubts(definition))
    wrong = problems_of(row) if is_draft else [Problem(_("Only a draft can be published."))]
    if rehearsal is None and len(reason) < LEAST_REASON:
        words = _(
            "No rehearsal of this definition has passed: say in at least %(n)d characters why it "
            "is published without one."
        )
        wrong.append(Problem(words, {"n": LEAST_REASON}))
    if wrong := wrong + ([] if is_confirmed else unsure):
        raise NotPublishableError(wrong)
    shipped = shipped_questionnaires()
    for step in definition.asking:
        rows = QuestionnaireRow.objects.filter(slug=step.questionnaire, version=step.version)
        used = rows.first() or questionnaires.store(shipped[step.questionnaire, step.version], now)
        questionnaires.freeze(used, now)
    published = {
        **_fields(definition),
        "status": Row.Status.PUBLISHED,
        "published_at": now,
        "published_by": user,
        "unrehearsed_reason": "" if rehearsal is not None else reason,
    }
    if not _draft(row).update(**published):
        words = _("The study has since been changed or published. Reload the page.")
        raise NotPublishableError([Problem(words)])
    others = Row.objects.filter(slug=row.slug, status=Row.Status.PUBLISHED).exclude(pk=row.pk)
    others.update(status=Row.Status.CLOSED, closed_at=now)
    detail = f"version {row.version}{', unrehearsed' if rehearsal is None else ''}"
    audit.note("study_published", actor=user, study=row.slug, detail=detail, at=now)
    unrehearsed = f"Published without a rehearsal: {reason}"
    log(row, user, unrehearsed if rehearsal is None else "Published.")
    for one in unsure:
        log(row, user, f"Confirmed: {one}")
    return Row.objects.get(pk=row.pk)


def log(row: Model, user: Any, text: str) -> None:
    if user is not None:
        LogEntry.objects.log_actions(user.pk, [row], CHANGE, text, single_object=True)


def close(row: Row, now: datetime.datetime) -> Row:
    """Accept no new participants; those who take part may finish.

    Raises:
        NotPublishableError: it is not published.
    """
    rows = Row.objects.filter(pk=row.pk, status=Row.Status.PUBLISHED)
    if not rows.update(status=Row.Status.CLOSED, closed_at=now):
        raise NotPublishableError([Problem(_("Only a published study can be closed."))])
    return Row.objects.get(pk=row.pk)


def reopen(row: Row) -> Row:
    """Accept participants again.

    Raises:
        NotPublishableError: it is not closed, or a newer version is published.
    """
    newer = Row.objects.filter(slug=row.slug, version__gt=row.version)
    if newer.exclude(status=Row.Status.DRAFT).exists():
        words = _("A newer version of this study has been published; this one stays closed.")
        raise NotPublishableError([Problem(words)])
    rows = Row.objects.filter(pk=row.pk, status=Row.Status.CLOSED)
    if not rows.update(status=Row.Status.PUBLISHED, closed_at=None):
        raise NotPublishableError([Problem(_("Only a closed study can be opened again."))])
    return Row.objects.get(pk=row.pk)


def may_delete(row: Row) -> bool:
    used = row.participants.exists() or PersonalLink.objects.filter(study=row).exists()
    return row.status == Row.Status.DRAFT and not used
