"""Studies in the database: stored as drafts, published, closed.

A draft may be incomplete: only its types must be right. A published study has no problems, is
feasible with the sites, robots and questionnaires of this server, and never changes again.
"""

import datetime
from collections.abc import Iterable, Sequence
from typing import Any

import msgspec
from django.contrib.admin.models import CHANGE, LogEntry
from django.db import IntegrityError, transaction
from django.db.models import Max, Model, QuerySet

from accounts import audit
from experiments.definition.problems import doubts, name_problems, problems
from experiments.definition.schema import StudyDefinition, as_stored, digest
from experiments.definition.steps.consent import SHARING, TEMPLATE
from experiments.models import PersonalLink, Rehearsal, Study as Row, StudyMember
from experiments.resources import obstacles_here, shipped_questionnaires
from surveys import questionnaires
from surveys.documents import (
    BadDefinitionError,
    ChangedMeanwhileError,
    Problem,
    ProblemPlace,
    gettext_noop as _,
    text_in,
    within,
)
from surveys.models import Questionnaire as QuestionnaireRow

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


def store(definition: StudyDefinition, now: datetime.datetime) -> Row:
    """Store a study as a draft, in place of a draft of the same version, or return the row that
    has the same definition already. BadDefinitionError: it has problems, or its version was
    published with other content.
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
    """Store a changed draft, complete or not; name and version stay. ChangedMeanwhileError: the
    study was changed or published since the row was read.
    """
    named = msgspec.structs.replace(definition, slug=row.slug, version=row.version)
    if not _draft(row).update(**_fields(named)):
        raise ChangedMeanwhileError(f"{row.slug} {row.version} has since been changed or published")
    return Row.objects.get(pk=row.pk)


def begin_empty(slug: str, title: str, languages: Sequence[str], now: datetime.datetime) -> Row:
    """Create a draft with the usual steps, without conditions and courses. BadDefinitionError: the
    name is taken or reserved, or it or a language is malformed.
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
    participants and researchers. BadDefinitionError: the name is taken or reserved.
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


def passed_rehearsal(row: Row) -> Rehearsal | None:
    """Return the newest rehearsal of exactly this definition that passed."""
    passed = Rehearsal.objects.filter(study=row, sha256=row.sha256, passed=True)
    return passed.exclude(finished_at=None).order_by("-finished_at").first()


def publish(
    row: Row, user: Any, reason: str, now: datetime.datetime, *, is_confirmed: bool = False
) -> Row:
    """Open a draft to participants, freeze its definition, and close the former version.

    `user` is None for a command. A `reason` is needed without a rehearsal that passed.
    `is_confirmed`: the publisher has confirmed the doubts. NotPublishableError has every reason.
    """
    rehearsal, reason, definition = passed_rehearsal(row), reason.strip(), row.as_definition()
    is_draft, unsure = row.status == Row.Status.DRAFT, list(doubts(definition))
    wrong = problems_of(row) if is_draft else [Problem(_("Only a draft can be published."))]
    wrong += [] if is_confirmed else unsure
    if rehearsal is None and len(reason) < LEAST_REASON:
        words = _(
            "No rehearsal of this definition has passed: say in at least %(n)d characters why it "
            "is published without one."
        )
        wrong.append(Problem(words, {"n": LEAST_REASON}))
    if wrong:
        raise NotPublishableError(wrong)
    shipped = shipped_questionnaires()
    for step in definition.questionnaire_steps:
        rows = QuestionnaireRow.objects.filter(slug=step.questionnaire, version=step.version)
        used = rows.first() or questionnaires.store(shipped[step.questionnaire, step.version], now)
        questionnaires.freeze(used, now)
    unrehearsed = reason if rehearsal is None else ""
    published = {"status": Row.Status.PUBLISHED, "published_at": now, "published_by": user}
    fields = _fields(definition) | published | {"unrehearsed_reason": unrehearsed}
    if not _draft(row).update(**fields):
        words = _("The study has since been changed or published. Reload the page.")
        raise NotPublishableError([Problem(words)])
    others = Row.objects.filter(slug=row.slug, status=Row.Status.PUBLISHED).exclude(pk=row.pk)
    others.update(status=Row.Status.CLOSED, closed_at=now)
    detail = f"version {row.version}{', unrehearsed' if unrehearsed else ''}"
    audit.note("study_published", actor=user, study=row.slug, detail=detail, at=now)
    log(row, user, f"Published without a rehearsal: {reason}" if unrehearsed else "Published.")
    for one in unsure:
        log(row, user, f"Confirmed: {one}")
    return Row.objects.get(pk=row.pk)


def log(row: Model, user: Any, text: str) -> None:
    if user is not None:
        LogEntry.objects.log_actions(user.pk, [row], CHANGE, text, single_object=True)


def close(row: Row, now: datetime.datetime) -> Row:
    """Accept no new participants; those who take part may finish. NotPublishableError: it is not
    published.
    """
    rows = Row.objects.filter(pk=row.pk, status=Row.Status.PUBLISHED)
    if not rows.update(status=Row.Status.CLOSED, closed_at=now):
        raise NotPublishableError([Problem(_("Only a published study can be closed."))])
    return Row.objects.get(pk=row.pk)


def reopen(row: Row) -> Row:
    """Accept participants again. NotPublishableError: it is not closed, or a newer version is
    published.
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
