"""Studies in the database: taken from definitions, changed while they are drafts, published once
nothing stands in the way, closed.

A draft may be half done: it is stored as long as its types are right, and what is wrong with it is
told until it is mended. What is published has no problems, is feasible with the sites, robots and
questionnaires at hand, and never changes again.
"""

import datetime
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import astuple
from itertools import takewhile
from typing import Any

import msgspec
from django.contrib.admin.models import CHANGE, LogEntry
from django.db import IntegrityError, transaction
from django.db.models import Max, Model
from django.utils.translation import get_language, gettext

from accounts import audit
from experiments.definition.factors import of_condition
from experiments.definition.feasibility import Known, RobotFacts, obstacles
from experiments.definition.plan import AttentionCheck
from experiments.definition.problems import doubts, name_problems, problems
from experiments.definition.reachability import unreachable
from experiments.definition.recruitment.recruiting import AnswerQuota, AnswerRule
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
    within,
)
from surveys.documents import gettext_noop as _
from surveys.models import Questionnaire as QuestionnaireRow
from surveys.scoring import scales_of, topic_scales

LEAST_REASON = 10  # characters: "later" is none
_NO_METRIC = _("there is no metric %(name)s.")
_NO_ITEM = _("the questionnaire has no item, topic or score %(name)s.")


class NotPublishableError(ValueError):
    def __init__(self, reasons: Iterable[Problem]) -> None:
        self.reasons = list(reasons)
        super().__init__("; ".join(map(str, self.reasons)))


# --- into the database ----------------------------------------------------------------------------


def store(definition: StudyDefinition, now: datetime.datetime) -> Row:
    """Put a study into the database as a draft, in place of a draft of the same version, or return
    the row that holds the same already.

    Raises:
        BadDefinitionError: when it is wrong, or its version was published with other content.
    """
    if found := list(problems(definition)):
        raise BadDefinitionError(found)
    return _put(definition, now)


def _put(definition: StudyDefinition, now: datetime.datetime) -> Row:
    fields = _fields(definition)
    former = Row.objects.filter(slug=definition.slug).order_by("-version").first()
    key = (former.code_key or former.secret) if former is not None else ""
    try:
        with transaction.atomic():
            return Row.objects.create(
                slug=definition.slug,
                version=definition.version,
                created_at=now,
                code_key=key,
                **fields,
            )
    except IntegrityError:
        return _replace(definition, fields)


def _replace(definition: StudyDefinition, fields: dict[str, Any]) -> Row:
    rows = Row.objects.filter(slug=definition.slug, version=definition.version)
    rows.filter(status=Row.Status.DRAFT).exclude(sha256=fields["sha256"]).update(**fields)
    row = rows.get()
    if row.sha256 != fields["sha256"]:
        words = _("Version %(n)d of %(name)s is published and cannot change: make a new version.")
        values = {"n": definition.version, "name": definition.slug}
        raise BadDefinitionError([Problem(words, values)])
    return row


def _fields(definition: StudyDefinition) -> dict[str, Any]:
    title = next(
        (text for text in (definition.title.get("en", ""), *definition.title.values()) if text),
        definition.slug,
    )
    return {
        "title": title[:200],
        "definition": as_stored(definition),
        "sha256": digest(definition),
    }


def save_draft(row: Row, definition: StudyDefinition) -> Row:
    """Keep a draft as it stands now, right or half done; name and version stay.

    Raises:
        ChangedMeanwhileError: the row is no draft any more, or holds something else than when it
            was read.
    """
    named = msgspec.structs.replace(definition, slug=row.slug, version=row.version)
    rows = Row.objects.filter(pk=row.pk, status=Row.Status.DRAFT, sha256=row.sha256)
    if not rows.update(**_fields(named)):
        raise ChangedMeanwhileError(f"{row.slug} {row.version} has since been changed or published")
    return Row.objects.get(pk=row.pk)


def begin_empty(slug: str, title: str, languages: Sequence[str], now: datetime.datetime) -> Row:
    """Make a draft with the usual steps, and nothing to drive yet.

    Raises:
        BadDefinitionError: there is a study of that name, or name or languages cannot be.
    """
    _check_name(slug)
    try:
        definition = msgspec.convert(
            _usual(slug, title, tuple(dict.fromkeys(languages))), StudyDefinition
        )
    except msgspec.ValidationError as error:
        raise BadDefinitionError([f"{error}."]) from error
    return _put(definition, now)


def _usual(slug: str, title: str, languages: tuple[str, ...]) -> dict[str, Any]:
    def said(text: str) -> dict[str, str]:
        return dict.fromkeys(languages, text)

    steps = [
        {
            "kind": "consent",
            "key": "consent",
            "title": said("Consent"),
            "text": {name: TEMPLATE.get(name, TEMPLATE["en"]) for name in languages},
            "sharing": {name: SHARING.get(name, SHARING["en"]) for name in languages},
        },
        {
            "kind": "form",
            "key": "about_you",
            "title": said("About you"),
            "questionnaire": "ict",
            "version": 2,
        },
        {
            "kind": "instructions",
            "key": "instructions",
            "title": said("How it works"),
            "leaves": [],
        },
        {"kind": "task", "key": "task", "title": said("Task")},
        {
            "kind": "questionnaire",
            "key": "experience",
            "title": said("Your experience"),
            "questionnaire": "experience",
        },
        {"kind": "debrief", "key": "thanks", "title": said("Thanks"), "text": {}},
    ]
    study = {
        "format": 1,
        "slug": slug,
        "version": 1,
        "title": said(title),
        "languages": list(languages),
        "conditions": [],
        "courses": [],
    }
    return {**study, "steps": steps}


def new_version(row: Row, now: datetime.datetime) -> Row:
    """Return a draft copy, numbered after the newest version; how people come in and when is taken
    along.
    """
    newest = Row.objects.filter(slug=row.slug).aggregate(newest=Max("version"))["newest"]
    made = _put(msgspec.structs.replace(row.as_definition(), version=newest + 1), now)
    kept = ("entry", "opening_hours", "time_zone", "exclusive", "publication")
    Row.objects.filter(pk=made.pk).update(**{name: getattr(row, name) for name in kept})
    return Row.objects.get(pk=made.pk)


def copy(row: Row, slug: str, title: str, now: datetime.datetime) -> Row:
    """Return a draft of a new study that says the same under another name: its first version, with
    neither participants nor researchers.

    Raises:
        BadDefinitionError: there is a study of that name, or it cannot be one.
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
    """Make whoever brought a study its owner, when it has none."""
    if not StudyMember.objects.filter(slug=row.slug, role=StudyMember.Role.OWNER).exists():
        StudyMember.objects.update_or_create(
            slug=row.slug, user=user, defaults={"role": StudyMember.Role.OWNER}
        )


# --- what stands in the way -----------------------------------------------------------------------


def problems_of(row: Row) -> list[Problem]:
    """Return what is wrong with a study in itself, and what stands in its way here. A consent with
    placeholders is only refused here: a rehearsal may be run with them.
    """
    definition = row.as_definition()
    found = [*problems(definition), *_unfilled(definition), *obstacles_here(definition)]
    return [one for n, one in enumerate(found) if one not in found[:n]]


def _unfilled(definition: StudyDefinition) -> Iterator[Problem]:
    if (consent := definition.consent) is not None:
        place = ProblemPlace("steps", definition.steps.index(consent))
        yield from within(consent.unfilled(), place, _("Step"), consent.key)


def obstacles_here(definition: StudyDefinition) -> list[Problem]:
    """Return what makes a study impossible with the sites, robots and questionnaires of this
    server.
    """
    return [
        *obstacles(definition, known_here(), unreachable),
        *_elsewhere(definition),
        *_unknown_measures(definition),
        *_named_answers(definition),
        *_missing_media(definition),
        *_balance_factors(definition),
    ]


def _missing_media(definition: StudyDefinition) -> Iterator[Problem]:
    """Yield the steps with an uploaded picture that another site has, where the study is from."""
    for n, step in enumerate(definition.steps):
        pages = step.leaves if isinstance(step, Instructions) else ()
        own = {one.picture for one in pages if (one.picture or "").startswith(OWN_MEDIA)}
        if InstructionMedia.objects.filter(name__in=own).count() < len(own):
            words = _("an own picture or video is not on this site; upload it again.")
            yield from within([Problem(words)], ProblemPlace("steps", n), _("Step"), step.key)


def measures_here(definition: StudyDefinition) -> dict[str, dict[str, str]]:
    """Return what a study can measure, by group: metrics of its sessions, and of each
    questionnaire that it asks the overall score, topics and items, with what each is called.
    """
    # needs the columns of datasets, which a page about a study without analyses need not load
    from experiments.analysis.metrics.definitions import METRICS  # noqa: PLC0415

    found = {"": {one.name: metric_name(one.name, one.unit) for one in METRICS}}
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


def metric_name(name: str, unit: str) -> str:
    """Return what a metric is called on pages: "Task time (s)"."""
    words = name.replace("_", " ").capitalize()
    return f"{words} ({unit})" if unit else words


def _unknown_measures(definition: StudyDefinition) -> Iterator[Problem]:
    if not definition.analyses:
        return
    from experiments.analysis.metrics.definitions import unfit_for  # noqa: PLC0415

    known = {name for group in measures_here(definition).values() for name in group}
    asked = {step.questionnaire for step in definition.asking}
    for n, one in enumerate(definition.analyses):
        unknown = (
            Problem(_NO_ITEM if "." in name else _NO_METRIC, {"name": name})
            for name in one.measures
            if name not in known and ("." not in name or name.partition(".")[0] in asked)
        )
        unfit = (
            Problem(
                _("the test does not fit %(name)s; choose one of: %(tests)s."),
                {"name": measure, "tests": tests},
            )
            for measure in one.measures
            if (tests := unfit_for(one.test, measure))
        )
        for found in (unknown, unfit):
            yield from within(found, ProblemPlace("analyses", n), _("Analysis"), one.key)


def _named_answers(definition: StudyDefinition) -> Iterator[Problem]:
    """Yield the attention checks, screening rules and quotas that name an item or an answer which a
    questionnaire does not have, or which an export would not have.
    """
    checks = definition.plan.attention_checks if definition.plan is not None else ()
    for check in checks:
        yield from _of_answers(definition, check, (check.answer,), "plan", _("attention check"))
    for rule in (*definition.screening, *definition.answer_quotas):
        yield from _of_answers(definition, rule, rule.answers, "recruitment", _("rule"))


def _of_answers(
    definition: StudyDefinition,
    check: AttentionCheck | AnswerRule | AnswerQuota,
    answers: Sequence[str],
    page: str,
    name: str,
) -> Iterator[Problem]:
    asked = {
        (step.questionnaire, step.version)
        for step in definition.asking
        if step.questionnaire == check.questionnaire
    }
    for one in _questionnaires(asked):
        found = within(
            _of_check(one, check.item, answers), None, name, f"{check.questionnaire}.{check.item}"
        )
        yield from within(found, ProblemPlace(page), *([_("Plan")] if page == "plan" else []))


def _of_check(
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
    """Yield the balance factors of which nothing is known when the robot is assigned."""
    before = takewhile(lambda step: not isinstance(step, DriveStep), definition.steps)
    asked = {(one.questionnaire, one.version) for one in before if isinstance(one, AskingStep)}
    for factor in definition.allocation.balance:
        questionnaire, _point, item = factor.item.rpartition(".")
        found = [one for one in _questionnaires(asked) if one.slug == questionnaire]
        consent = definition.consent
        if not questionnaire:
            words = _("the consent does not ask the age: give it a minimum age.")
            wrong = consent is None or not consent.minimum_age
        elif not found:
            words = _("the questionnaire is not asked before the first drive.")
            wrong = True
        else:
            words = _("the questionnaire has no such item.")
            wrong = not any(one.key == item for each in found for one in each.questions())
        if wrong:
            named = within([Problem(words)], None, _("balance factor"), factor.item)
            yield from within(named, ProblemPlace("rules"))


def _questionnaires(versions: Iterable[tuple[str, int]]) -> Iterator[QuestionnaireDefinition]:
    shipped = {(one.slug, one.version): one for one in questionnaires.shipped().values()}
    for slug, version in sorted(versions):
        row = QuestionnaireRow.objects.filter(slug=slug, version=version).first()
        found = row.as_definition() if row is not None else shipped.get((slug, version))
        if found is not None:
            yield found


def known_here() -> Known:
    """Return what is at hand. Questionnaires that come with the site count: publishing puts them
    in.
    """
    return Known(
        sites=sites(),
        robots=_robots(),
        questionnaires=frozenset((one.slug, one.version) for one in usable()),
        interfaces=frozenset(INTERFACES),
    )


def sites() -> dict[str, floorplan.FloorPlan]:
    """Return the plans of the sites by map id; a site that has only a picture is none to make a
    course on.
    """
    rows = FloorPlan.objects.exclude(plan={}).values_list("name", "plan")
    return {name: floorplan.decode(msgspec.json.encode(plan)) for name, plan in rows}


def _robots() -> dict[str, RobotFacts]:
    """Return what every robot of a series can do: a participant may get any of them."""
    found: dict[str, RobotFacts] = {}
    for robot in _heard_of():
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


def _heard_of() -> list[Robot]:
    """Return the robots in use that have said what they are, once at least."""
    robots = (
        Robot.objects.filter(enabled=True, practice=False)
        .select_related("floor_plan")
        .defer("floor_plan__image")
    )
    return [robot for robot in robots if robot.presence.factsheet]


def _elsewhere(definition: StudyDefinition) -> Iterator[Problem]:
    here = {
        ((robot.presence.factsheet or {})["series"], robot.floor_plan.name)
        for robot in _heard_of()
        if robot.floor_plan is not None
    }
    series = {name for name, _site in here}
    for n, condition in enumerate(definition.conditions):
        if condition.robot in series and (condition.robot, condition.site) not in here:
            words = _("there is no %(robot)s at the site %(site)s.")
            named = {"robot": condition.robot, "site": condition.site}
            yield from of_condition(n, condition, [Problem(words, named)])


def usable() -> Iterator[QuestionnaireDefinition]:
    """Yield the questionnaires that can be asked: in the database, and what comes with the site;
    never templates, nor what is half written.
    """
    rows = list(QuestionnaireRow.objects.order_by("title", "slug", "version"))
    yield from (row.as_definition() for row in rows if questionnaires.is_usable(row))
    taken = {(row.slug, row.version) for row in rows}
    for one in questionnaires.shipped().values():
        if not one.template and (one.slug, one.version) not in taken:
            yield one


# --- publishing -----------------------------------------------------------------------------------


def passed_rehearsal(row: Row) -> Rehearsal | None:
    """Return the newest rehearsal of exactly this definition that passed."""
    rehearsals = Rehearsal.objects.filter(
        study=row, sha256=row.sha256, passed=True, finished_at__isnull=False
    )
    return rehearsals.order_by("-finished_at").first()


def publish(
    row: Row, user: Any, reason: str, now: datetime.datetime, *, is_confirmed: bool = False
) -> Row:
    """Open a draft to participants; from now on its definition is frozen, and no earlier version
    takes anybody new.

    Args:
        row: the draft.
        user: who does it, for the log; None for a command.
        reason: why without a rehearsal that passed; asked for only where there is none.
        now: the time.
        is_confirmed: what is doubtful (experiments.definition.problems.doubts) is meant so.

    Raises:
        NotPublishableError: with everything that stands in the way.
    """
    rehearsal, reason = passed_rehearsal(row), reason.strip()
    is_draft = row.status == Row.Status.DRAFT
    wrong = problems_of(row) if is_draft else [Problem(_("Only a draft can be published."))]
    if rehearsal is None and len(reason) < LEAST_REASON:
        words = _(
            "No rehearsal of this definition has passed: say in at least %(n)d characters why it "
            "is published without one."
        )
        wrong.append(Problem(words, {"n": LEAST_REASON}))
    unsure = list(doubts(row.as_definition()))
    if not is_confirmed:
        wrong += unsure
    if wrong:
        raise NotPublishableError(wrong)
    definition = row.as_definition()
    _freeze_questionnaires(definition, now)
    told = {
        "definition": as_stored(definition),
        "sha256": digest(definition),
        "status": Row.Status.PUBLISHED,
        "published_at": now,
        "published_by": user,
        "unrehearsed_reason": "" if rehearsal is not None else reason,
    }
    if not Row.objects.filter(pk=row.pk, status=Row.Status.DRAFT, sha256=row.sha256).update(**told):
        words = _("The study has since been changed or published. Reload the page.")
        raise NotPublishableError([Problem(words)])
    Row.objects.filter(slug=row.slug, status=Row.Status.PUBLISHED).exclude(pk=row.pk).update(
        status=Row.Status.CLOSED, closed_at=now
    )
    audit.note(
        "study_published",
        actor=user,
        study=row.slug,
        detail=f"version {row.version}{', unrehearsed' if rehearsal is None else ''}",
        at=now,
    )
    log(
        row, user, f"Published without a rehearsal: {reason}" if rehearsal is None else "Published."
    )
    for one in unsure:
        log(row, user, f"Confirmed: {one}")
    return Row.objects.get(pk=row.pk)


def log(row: Model, user: Any, text: str) -> None:
    """Note in the administration's log what somebody did with a study, or with
    what belongs to it.
    """
    if user is not None:
        LogEntry.objects.log_actions(user.pk, [row], CHANGE, text, single_object=True)


def _freeze_questionnaires(definition: StudyDefinition, now: datetime.datetime) -> None:
    """Put in those that come with the site, and let none of them change any more."""
    shipped = {(one.slug, one.version): one for one in questionnaires.shipped().values()}
    for step in definition.asking:
        row = QuestionnaireRow.objects.filter(slug=step.questionnaire, version=step.version).first()
        questionnaires.freeze(
            row or questionnaires.store(shipped[step.questionnaire, step.version], now), now
        )


def close(row: Row, now: datetime.datetime) -> Row:
    """Take nobody new; who takes part may finish.

    Raises:
        NotPublishableError: it is not published.
    """
    if not Row.objects.filter(pk=row.pk, status=Row.Status.PUBLISHED).update(
        status=Row.Status.CLOSED, closed_at=now
    ):
        raise NotPublishableError([Problem(_("Only a published study can be closed."))])
    return Row.objects.get(pk=row.pk)


def reopen(row: Row) -> Row:
    """Take participants again.

    Raises:
        NotPublishableError: it is not closed, or a newer version is published.
    """
    if (
        Row.objects.filter(slug=row.slug, version__gt=row.version)
        .exclude(status=Row.Status.DRAFT)
        .exists()
    ):
        words = _("A newer version of this study has been published; this one stays closed.")
        raise NotPublishableError([Problem(words)])
    if not Row.objects.filter(pk=row.pk, status=Row.Status.CLOSED).update(
        status=Row.Status.PUBLISHED, closed_at=None
    ):
        raise NotPublishableError([Problem(_("Only a closed study can be opened again."))])
    return Row.objects.get(pk=row.pk)


def may_delete(row: Row) -> bool:
    """Tell whether nothing is lost with a study: a draft that nobody took part in."""
    used = row.participants.exists() or PersonalLink.objects.filter(study=row).exists()
    return row.status == Row.Status.DRAFT and not used
