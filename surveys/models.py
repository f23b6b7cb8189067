"""Questionnaires as they were used, who answered them, and every answer."""

import uuid

from django.conf import settings
from django.db import models
from django.utils.translation import gettext_lazy as _

from surveys.answers import AnswerValue, Missing, Stored, response_statuses
from surveys.conditions import Circumstances
from surveys.definition import Definition, from_stored

SEED_LIMIT = 2**31


class Questionnaire(models.Model):
    """One version of a questionnaire; it never changes after its first response began."""

    id = models.UUIDField(primary_key=True, default=uuid.uuid4, editable=False)
    slug = models.SlugField(_("name"), max_length=40)
    version = models.PositiveIntegerField(_("version"))
    title = models.CharField(_("title"), max_length=200)
    definition = models.JSONField(_("definition"))
    sha256 = models.CharField(max_length=64, editable=False)
    created_at = models.DateTimeField(_("imported"))
    frozen_at = models.DateTimeField(_("in use since"), null=True, blank=True)
    # An ImportReport (surveys.importing.report); None for a questionnaire that was written here.
    import_report = models.JSONField(_("import report"), null=True, editable=False)

    class Meta:
        verbose_name = _("questionnaire")
        verbose_name_plural = _("questionnaires")
        ordering = ("slug", "-version")
        constraints = [
            models.UniqueConstraint(fields=["slug", "version"], name="questionnaire_version_once")
        ]

    def __str__(self) -> str:
        return f"{self.title} · {self.slug} {self.version}"

    def as_definition(self) -> Definition:
        return from_stored(self.definition)


class Response(models.Model):
    """The answers of one respondent to one questionnaire in one context.

    The respondent is a user, or has an anonymous key. The context is an opaque key (a step of a
    study and its session), with a label for people.
    """

    id = models.UUIDField(primary_key=True, default=uuid.uuid4, editable=False)
    questionnaire = models.ForeignKey(
        Questionnaire, models.PROTECT, related_name="responses", verbose_name=_("questionnaire")
    )
    user = models.ForeignKey(
        settings.AUTH_USER_MODEL,
        models.CASCADE,
        null=True,
        blank=True,
        related_name="survey_responses",
        verbose_name=_("user"),
    )
    respondent_key = models.CharField(
        _("anonymous respondent"), max_length=64, blank=True, db_index=True
    )
    # A hash of questionnaire's name, respondent and context: unique on every database, so that no
    # respondent answers twice.
    slot = models.CharField(max_length=64, unique=True, editable=False)
    context = models.CharField(_("context"), max_length=200, db_index=True)
    context_label = models.CharField(_("asked in"), max_length=200, blank=True)
    robot = models.JSONField(_("robot"), default=list)
    outcome = models.CharField(_("outcome"), max_length=40, blank=True)
    return_to = models.CharField(max_length=500, blank=True, editable=False)
    back_to = models.CharField(max_length=500, blank=True, editable=False)
    seed = models.BigIntegerField(_("order seed"))
    language = models.CharField(_("language"), max_length=16)
    # The number of pages done; going back does not lower it.
    reached = models.PositiveIntegerField(_("pages done"), default=0)
    started_at = models.DateTimeField(_("started"), db_index=True)
    seen_at = models.DateTimeField(_("last seen"))
    finished_at = models.DateTimeField(_("finished"), null=True, blank=True, db_index=True)

    class Meta:
        verbose_name = _("response")
        verbose_name_plural = _("responses")
        ordering = ("-started_at",)

    def __str__(self) -> str:
        return f"{self.questionnaire} · {self.respondent}"

    @property
    def respondent(self) -> str:
        return str(self.user_id) if self.user_id is not None else self.respondent_key

    @property
    def circumstances(self) -> Circumstances:
        return Circumstances(robot=frozenset(self.robot), outcome=self.outcome)

    def given(self) -> Stored:
        return {row.item: row.given for row in self.answers.only("item", "value", "missing")}

    def response_statuses(self, definition: Definition, stored: Stored) -> Stored:
        reached = self.reached if self.finished_at is None else len(definition.pages)
        return response_statuses(definition, stored, self.circumstances, reached)


class Answer(models.Model):
    """The answer to one question: `value`, or in `missing` the reason why there is none."""

    class Reason(models.TextChoices):
        SKIPPED = Missing.SKIPPED.value, _("skipped")
        PREFERRED_NOT = Missing.PREFERRED_NOT.value, _("preferred not to answer")
        NOT_APPLICABLE = Missing.NOT_APPLICABLE.value, _("not applicable")

    id = models.UUIDField(primary_key=True, default=uuid.uuid4, editable=False)
    response = models.ForeignKey(
        Response, models.CASCADE, related_name="answers", verbose_name=_("response")
    )
    item = models.CharField(_("question"), max_length=40)
    value = models.JSONField(_("value"), null=True)
    missing = models.CharField(_("missing"), max_length=16, choices=Reason, blank=True)
    language = models.CharField(_("language"), max_length=16)
    # Question.fingerprint of the texts that were shown.
    text_version = models.CharField(_("text version"), max_length=12)
    position = models.PositiveIntegerField(_("position"))
    # Seconds of attention as the page measured them, None without JavaScript.
    seconds = models.FloatField(_("seconds"), null=True)
    # The page load that saved it, and the number of its request: one that arrives late is ignored.
    writer = models.CharField(max_length=32, blank=True, editable=False)
    writing = models.BigIntegerField(default=0, editable=False)
    first_at = models.DateTimeField(_("first answered"))
    answered_at = models.DateTimeField(_("answered"))

    class Meta:
        verbose_name = _("answer")
        verbose_name_plural = _("answers")
        ordering = ("position",)
        constraints = [models.UniqueConstraint(fields=["response", "item"], name="answer_once")]

    def __str__(self) -> str:
        return f"{self.item}: {self.missing or self.value}"

    @property
    def given(self) -> AnswerValue:
        return AnswerValue(self.value, Missing(self.missing) if self.missing else None)
