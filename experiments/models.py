"""Studies as they are run: who takes part, what they were assigned, agreed to, went through and
drove, and what became of it.

Five facts are kept apart: what a participant was *assigned* (Participant, and each Draw), whether
they were *exposed* (Drive: their page showed the robot's video), whether they *moved* the robot
(Drive), how the task *ended* (Drive), and whether they *answered* (surveys). Nothing of a
participant who was exposed is deleted by the site itself; one who withdraws leaves a row without a
name.
"""

import secrets
import uuid
from typing import Any, Final

from django.conf import settings
from django.db import models
from django.utils.translation import get_language
from django.utils.translation import gettext_lazy as _

from accounts.passwordless import CODE_LETTERS
from experiments.definition.schema import StudyDefinition, as_stored, digest, from_stored
from sessions.models import Session
from surveys.documents import spoken

CODE_LENGTH = 8
# How taking part ended: experiments.definition.recruitment.recruiting.Ending.
DONE: Final = "done"
TECHNICAL_FAILURE: Final = "technical_failure"
SCREENED_OUT: Final = "screened_out"
TIMED_OUT: Final = "timed_out"
LEFT: Final = "left"


def not_drawn() -> str:
    """Return a unique word for a column that is unique and has no value yet."""
    return uuid.uuid4().hex


def new_code() -> str:
    """Return a random code that tells nothing and can be read out over the telephone."""
    return "".join(secrets.choice(CODE_LETTERS) for _ in range(CODE_LENGTH))


class ParticipantKind(models.TextChoices):
    PARTICIPANT = "participant", _("participant")
    PILOT = "pilot", _("pilot")
    BOT = "bot", _("bot")


class FrozenStudyError(ValueError):
    """A published study whose definition, name or version was to be changed, or that was to become
    a draft again.
    """


class Study(models.Model):
    """One version of a study. Once it is published its definition never changes: a change is a new
    version.
    """

    class Status(models.TextChoices):
        """Drafts are run by pilots and bots alone; a closed study takes nobody new."""

        DRAFT = "draft", _("draft")
        PUBLISHED = "published", _("published")
        CLOSED = "closed", _("closed")

    class Entry(models.TextChoices):
        OPEN = "open", _("open link, with an account")
        CODE = "code", _("open link, without an account")
        PERSONAL = "personal", _("personal links only")

    id = models.UUIDField(primary_key=True, default=uuid.uuid4, editable=False)
    slug = models.SlugField(_("name"), max_length=40)
    version = models.PositiveIntegerField(_("version"))
    title = models.CharField(_("title"), max_length=200)
    definition = models.JSONField(_("definition"))
    sha256 = models.CharField(max_length=64, editable=False)
    status = models.CharField(
        _("status"), max_length=10, choices=Status, default=Status.DRAFT, db_index=True
    )
    entry = models.CharField(_("entry"), max_length=10, choices=Entry, default=Entry.OPEN)
    # experiments/definition/opening_hours.py: [{"days": [0..6], "start": "09:00", "end": "17:00"}],
    # empty is always; and the zone they are meant in.
    opening_hours = models.JSONField(_("opening hours"), default=list, blank=True)
    time_zone = models.CharField(_("time zone"), max_length=60, default="UTC")
    exclusive = models.BooleanField(
        _("exclusive use of its robots"),
        default=False,
        help_text=_("While the study is open, only its participants can drive them."),
    )
    created_at = models.DateTimeField(_("created"))
    published_at = models.DateTimeField(_("published"), null=True, blank=True)
    closed_at = models.DateTimeField(_("closed"), null=True, blank=True)
    # Whose robots it may use: experiments/participation/robot_eligibility.py.
    published_by = models.ForeignKey(
        settings.AUTH_USER_MODEL,
        models.SET_NULL,
        null=True,
        blank=True,
        related_name="published_studies",
    )
    # Why it was published without a rehearsal that passed.
    unrehearsed_reason = models.TextField(_("reason for publishing without rehearsal"), blank=True)
    # What researchers say of deviations from the plan, which is frozen: so it is no part of it.
    deviations = models.TextField(
        _("deviations from the plan"),
        blank=True,
        help_text=_("What was done differently, when and why. It is exported with the data."),
    )
    # What its dataset says about itself in a repository, and
    # the drafts that were made there, by the repository's name (experiments/deposit/).
    publication = models.JSONField(
        _("publication details"), default=dict, blank=True, editable=False
    )
    deposits = models.JSONField(default=dict, blank=True, editable=False)
    # Keys the hash of networks, so that distinct ones can be counted within this study and nowhere
    # else.
    secret = models.CharField(max_length=64, default=secrets.token_hex, editable=False)
    # Makes the completion codes; empty: the secret does. A new version has that of the former one,
    # because a recruitment site knows the codes of the study, whatever its version.
    code_key = models.CharField(max_length=64, blank=True, editable=False)

    class Meta:
        verbose_name = _("study")
        verbose_name_plural = _("studies")
        ordering = ("slug", "-version")
        constraints = [
            models.UniqueConstraint(fields=["slug", "version"], name="study_version_once")
        ]

    def __str__(self) -> str:
        return f"{self.title} · {self.slug} {self.version}"

    def save(self, **options: Any) -> None:
        """Save the study. A draft is completed with every value, and its digest follows from that;
        the digest that was published stays.

        Raises:
            FrozenStudyError: when it is published and not what was published.
        """
        definition = self.as_definition()
        published = Study.objects.filter(pk=self.pk).exclude(status=self.Status.DRAFT).first()
        if published is None:
            self.definition, self.sha256 = as_stored(definition), digest(definition)
        elif self.status == self.Status.DRAFT or not self._is_same(published):
            raise FrozenStudyError(
                f"version {published.version} of {published.slug} is published and cannot "
                "change: make a new version"
            )
        super().save(**options)

    def _is_same(self, published: "Study") -> bool:
        names = ("slug", "version", "sha256")
        return self.as_definition() == published.as_definition() and all(
            getattr(self, name) == getattr(published, name) for name in names
        )

    @property
    def shown_title(self) -> str:
        """Return the title in the language of the page that is being made."""
        titles = (self.definition or {}).get("title") or {}
        return (spoken(titles, get_language() or "") if titles else "") or self.title

    def as_definition(self) -> StudyDefinition:
        return from_stored(self.definition)


class StudyMember(models.Model):
    """A researcher of a study, in all of its versions."""

    class Role(models.TextChoices):
        OWNER = "owner", _("owner: full access")
        RESEARCHER = "researcher", _("researcher: sees data, excludes drives, intervenes")
        VIEWER = "viewer", _("viewer: sees pseudonymous data")
        WIZARD = "wizard", _("hidden operator: only operates the robot")
        CODER = "coder", _("coder: codes replays, sees nothing else")

    id = models.UUIDField(primary_key=True, default=uuid.uuid4, editable=False)
    slug = models.SlugField(_("study"), max_length=40, db_index=True)
    user = models.ForeignKey(
        settings.AUTH_USER_MODEL, models.CASCADE, related_name="studies", verbose_name=_("user")
    )
    role = models.CharField(_("role"), max_length=12, choices=Role)

    class Meta:
        verbose_name = _("researcher")
        verbose_name_plural = _("researchers")
        constraints = [models.UniqueConstraint(fields=["slug", "user"], name="one_role_in_a_study")]

    def __str__(self) -> str:
        return f"{self.user} · {self.slug} · {self.get_role_display()}"


class ResearcherInvitation(models.Model):
    """An invitation to a colleague, with an account or without one, to become a researcher of a
    study. Only a hash of the token in its link is stored; the link works once.
    """

    id = models.UUIDField(primary_key=True, default=uuid.uuid4, editable=False)
    slug = models.SlugField(_("study"), max_length=40, db_index=True)
    email = models.EmailField(_("e-mail address"))
    role = models.CharField(_("role"), max_length=12, choices=StudyMember.Role)
    token_sha256 = models.CharField(max_length=64, unique=True, editable=False)
    invited_by = models.ForeignKey(
        settings.AUTH_USER_MODEL, models.CASCADE, related_name="+", verbose_name=_("invited by")
    )
    created_at = models.DateTimeField(_("created"))
    expires_at = models.DateTimeField(_("expires"))
    accepted_at = models.DateTimeField(_("accepted"), null=True, blank=True)

    class Meta:
        verbose_name = _("invitation")
        verbose_name_plural = _("invitations")
        ordering = ("-created_at",)

    def __str__(self) -> str:
        return f"{self.email} · {self.slug}"


class InstructionMedia(models.Model):
    """A picture or a video of the researchers' own for instructions. Its `name` is made from its
    content, so that a published study can never show another one.
    """

    name = models.CharField(max_length=64, primary_key=True)
    slug = models.SlugField(_("study"), max_length=40, db_index=True)
    title = models.CharField(_("file name"), max_length=200)
    content = models.BinaryField()
    uploaded_at = models.DateTimeField(_("uploaded"))

    class Meta:
        verbose_name = _("picture of the instructions")
        verbose_name_plural = _("pictures of the instructions")

    def __str__(self) -> str:
        return self.title


class Participant(models.Model):
    """Somebody in one version of a study. `code` is what datasets call them."""

    class Status(models.TextChoices):
        ACTIVE = "active", _("taking part")
        FINISHED = "finished", _("finished")
        SCREENED_OUT = "screened_out", _("screened out")
        WITHDRAWN = "withdrawn", _("withdrawn")

    class Stage(models.TextChoices):
        """What became of the place in the cell (experiments/participation/assignment.py)."""

        UNASSIGNED = "", _("unassigned")
        UNDER_WAY = "under_way", _("under way")
        FREED = "freed", _("freed")
        FILLED = "filled", _("filled")
        REFILLED = "refilled", _("reassigned")

    id = models.UUIDField(primary_key=True, default=uuid.uuid4, editable=False)
    study = models.ForeignKey(
        Study, models.PROTECT, related_name="participants", verbose_name=_("study")
    )
    user = models.ForeignKey(
        settings.AUTH_USER_MODEL,
        models.SET_NULL,
        null=True,
        blank=True,
        related_name="participations",
        verbose_name=_("user"),
    )
    # "<study>:<user>", and its own id once there is no user any more: unique on every database
    # without partial indexes.
    slot = models.CharField(max_length=80, unique=True, editable=False)
    code = models.CharField(_("code"), max_length=12, unique=True, default=new_code, editable=False)
    kind = models.CharField(
        _("kind"),
        max_length=12,
        choices=ParticipantKind,
        default=ParticipantKind.PARTICIPANT,
        db_index=True,
    )
    # open or invitation: experiments.participation.assignment.Access
    access = models.CharField(_("joined via"), max_length=12, default="open")
    status = models.CharField(
        _("status"), max_length=12, choices=Status, default=Status.ACTIVE, db_index=True
    )
    language = models.CharField(_("language"), max_length=16, default="en")
    # parameters of the link they came by
    recruitment = models.JSONField(_("recruitment"), default=dict, blank=True)
    # The id that a recruitment site gave them, and "<study's name>:<its hash>": unique, so that one
    # id is one participant of the study, in all of its versions. A random word without an id.
    recruitment_id = models.CharField(
        _("recruitment id"), max_length=100, blank=True, db_index=True
    )
    recruited_as = models.CharField(max_length=120, unique=True, default=not_drawn, editable=False)
    age = models.PositiveIntegerField(_("age"), null=True, blank=True)

    # --- assignment, at the first grant of the robot: as the last draw says ---
    cell = models.CharField(_("cell"), max_length=400, blank=True, db_index=True)
    conditions = models.JSONField(_("conditions in order"), default=list, blank=True)
    draws_applied = models.PositiveIntegerField(_("draws"), default=0)
    stage = models.CharField(
        _("place"),
        max_length=10,
        choices=Stage,
        default=Stage.UNASSIGNED,
        blank=True,
        db_index=True,
    )

    # --- where they are: experiments/participation/journey.py ---
    visit = models.PositiveIntegerField(_("visit"), default=1)
    step = models.CharField(_("step"), max_length=40, blank=True)
    round = models.PositiveIntegerField(_("round"), default=0)

    created_at = models.DateTimeField(_("joined"), db_index=True)
    seen_at = models.DateTimeField(_("last seen"))
    finished_at = models.DateTimeField(_("finished"), null=True, blank=True)
    # experiments.definition.recruitment.recruiting.Ending
    completion = models.CharField(_("completion"), max_length=20, blank=True)
    completion_code = models.CharField(_("completion code"), max_length=20, blank=True)
    withdrawn_at = models.DateField(_("withdrawn on"), null=True, blank=True)
    withdrawn_step = models.CharField(_("withdrawn at step"), max_length=40, blank=True)
    # how far they had come then: experiments/extraction/people.py
    withdrawn_stage = models.CharField(_("reached"), max_length=12, blank=True)

    class Meta:
        verbose_name = _("participant")
        verbose_name_plural = _("participants")
        ordering = ("-created_at",)
        indexes = [models.Index(fields=["study", "kind", "stage"], name="participant_places")]

    def __str__(self) -> str:
        return f"{self.code} · {self.study.slug} {self.study.version}"


class Draw(models.Model):
    """A cell that was drawn for a participant, with all that the draw was decided on
    (experiments/participation/assignment.py): `counts` are the places taken in each open cell,
    `scores` those of alike participants, `best` the cells with the least score, `levels` the
    participant's levels of the balance factors.

    `number` is unique within a study and kind: of two participants who are drawn at the same time
    one is drawn again. `nth` is the participant's own first, second … draw; one beyond
    `Participant.draws_applied` was decided and not applied yet.
    """

    class DrawReason(models.TextChoices):
        FIRST = "first", _("first assignment")
        AGAIN = "again", _("assigned again, because nothing had been seen of the first")

    id = models.UUIDField(primary_key=True, default=uuid.uuid4, editable=False)
    study = models.ForeignKey(Study, models.PROTECT, related_name="draws", verbose_name=_("study"))
    participant = models.ForeignKey(
        Participant, models.CASCADE, related_name="draws", verbose_name=_("participant")
    )
    kind = models.CharField(_("kind"), max_length=12, choices=ParticipantKind)
    number = models.PositiveIntegerField(_("number"))
    nth = models.PositiveIntegerField(_("of the participant"))
    reason = models.CharField(_("reason"), max_length=10, choices=DrawReason)
    cell = models.CharField(_("cell"), max_length=400)
    best = models.JSONField(_("best cells"), default=list)
    counts = models.JSONField(_("places taken"), default=dict)
    scores = models.JSONField(_("places of alike participants"), default=dict)
    levels = models.JSONField(_("balance factors"), default=dict, blank=True)
    best_probability = models.FloatField(_("probability of the best cell"), default=1.0)
    seed = models.BigIntegerField(_("randomisation seed"), null=True)
    at = models.DateTimeField(_("time"), null=True)  # None once the participant withdrew

    class Meta:
        verbose_name = _("draw")
        verbose_name_plural = _("draws")
        ordering = ("number",)
        constraints = [
            models.UniqueConstraint(fields=["study", "kind", "number"], name="draw_number_once"),
            models.UniqueConstraint(fields=["participant", "nth"], name="nth_draw_once"),
        ]

    def __str__(self) -> str:
        return f"{self.number} · {self.cell}"


class ConsentReceipt(models.Model):
    """What a participant agreed to, word by word by its hash, and what they took back."""

    id = models.UUIDField(primary_key=True, default=uuid.uuid4, editable=False)
    participant = models.ForeignKey(
        Participant, models.CASCADE, related_name="consents", verbose_name=_("participant")
    )
    step = models.CharField(_("step"), max_length=40)
    version = models.PositiveIntegerField(_("version"))
    language = models.CharField(_("language"), max_length=16)
    text = models.TextField(_("text as shown"))
    text_sha256 = models.CharField(max_length=64)
    guardian = models.CharField(_("guardian"), max_length=120, blank=True)
    # whether the data may be published; None where the study did not ask
    sharing = models.BooleanField(_("data may be shared"), null=True)
    sharing_text = models.TextField(_("text on sharing as shown"), blank=True)
    agreed_at = models.DateTimeField(_("agreed"))

    class Meta:
        verbose_name = _("consent")
        verbose_name_plural = _("consents")
        constraints = [
            models.UniqueConstraint(fields=["participant", "step", "version"], name="consent_once")
        ]

    def __str__(self) -> str:
        return f"{self.participant_id} · {self.step} {self.version}"


class PersonalLink(models.Model):
    """A link for one person, redeemed once and by POST alone, so that no previewing mail program
    uses it up.
    """

    id = models.UUIDField(primary_key=True, default=uuid.uuid4, editable=False)
    study = models.ForeignKey(Study, models.CASCADE, related_name="links", verbose_name=_("study"))
    token_sha256 = models.CharField(max_length=64, unique=True, editable=False)
    label = models.CharField(_("label"), max_length=120, blank=True)
    access = models.CharField(_("access given"), max_length=12, default="invitation")
    # A bot's link makes whoever redeems it a bot, and what it does never counts; only commands make
    # such links.
    kind = models.CharField(
        _("for"), max_length=12, choices=ParticipantKind, default=ParticipantKind.PARTICIPANT
    )
    created_at = models.DateTimeField(_("created"))
    expires_at = models.DateTimeField(_("expires"), null=True, blank=True)
    revoked_at = models.DateTimeField(_("revoked"), null=True, blank=True)
    redeemed_at = models.DateTimeField(_("redeemed"), null=True, blank=True)
    participant = models.ForeignKey(
        Participant,
        models.SET_NULL,
        null=True,
        blank=True,
        related_name="links",
        verbose_name=_("participant"),
    )

    class Meta:
        verbose_name = _("personal link")
        verbose_name_plural = _("personal links")
        ordering = ("-created_at",)

    def __str__(self) -> str:
        return self.label or str(self.pk)

    @property
    def guest(self) -> Any:
        """The user whom the link lets in again: somebody who used it without an account of their
        own; else None.
        """
        user = self.participant.user if self.participant is not None else None
        return user if user is not None and user.is_guest and user.is_active else None

    @property
    def is_revocable(self) -> bool:
        """Whether revoking it would keep anybody out."""
        return self.revoked_at is None and (self.redeemed_at is None or self.guest is not None)


class StudyKey(models.Model):
    """A key for programs that read the participants of a study, in all of its versions
    (experiments/recruitment/api.py); only its hash is stored.
    """

    id = models.UUIDField(primary_key=True, default=uuid.uuid4, editable=False)
    slug = models.SlugField(_("study"), max_length=40, db_index=True)
    label = models.CharField(_("label"), max_length=60)
    token_sha256 = models.CharField(max_length=64, unique=True, editable=False)
    made_at = models.DateTimeField(_("created"))
    made_by = models.ForeignKey(
        settings.AUTH_USER_MODEL, models.CASCADE, related_name="+", verbose_name=_("created by")
    )
    last_used_at = models.DateTimeField(_("last used"), null=True, editable=False)

    class Meta:
        verbose_name = _("API key of a study")
        verbose_name_plural = _("API keys of studies")
        constraints = [
            models.UniqueConstraint(fields=["slug", "label"], name="one_study_key_of_a_label")
        ]

    def __str__(self) -> str:
        return f"{self.slug} · {self.label}"


class Contact(models.Model):
    """The e-mail address of a participant, who gave it for reminders; deleted when none is due any
    more. `token` is in the address by which they stop the e-mails.
    """

    id = models.UUIDField(primary_key=True, default=uuid.uuid4, editable=False)
    participant = models.OneToOneField(
        Participant, models.CASCADE, related_name="contact", verbose_name=_("participant")
    )
    email = models.EmailField(_("e-mail address"))
    site = models.CharField(max_length=200, editable=False)  # address of the site in its e-mails
    token = models.CharField(max_length=64, unique=True, default=secrets.token_urlsafe)
    given_at = models.DateTimeField(_("given"))
    # When to invite them to their second session; None: not, or done.
    invite_at = models.DateTimeField(_("invited to a second session"), null=True, blank=True)

    class Meta:
        verbose_name = _("e-mail address of a participant")
        verbose_name_plural = _("e-mail addresses of participants")

    def __str__(self) -> str:
        return str(self.participant_id)


class Appointment(models.Model):
    """When a participant drives a robot. `slot` is "<robot>:<start>", unique, so that of two who
    choose the same time at once one has to choose again.
    """

    id = models.UUIDField(primary_key=True, default=uuid.uuid4, editable=False)
    participant = models.ForeignKey(
        Participant, models.CASCADE, related_name="appointments", verbose_name=_("participant")
    )
    robot = models.ForeignKey(
        "robots.Robot", models.CASCADE, related_name="+", verbose_name=_("robot")
    )
    visit = models.PositiveIntegerField(_("visit"))
    starts_at = models.DateTimeField(_("starts"), db_index=True)
    ends_at = models.DateTimeField(_("ends"))
    slot = models.CharField(max_length=80, unique=True, editable=False)
    reminded_at = models.DateTimeField(_("reminded"), null=True, blank=True)

    class Meta:
        verbose_name = _("appointment")
        verbose_name_plural = _("appointments")
        ordering = ("starts_at",)

    def __str__(self) -> str:
        return f"{self.participant_id} · {self.starts_at:%Y-%m-%d %H:%M}"


class StepVisit(models.Model):
    """A participant on a step of the study, from seeing it first to going on: what the funnel is
    made of.
    """

    id = models.UUIDField(primary_key=True, default=uuid.uuid4, editable=False)
    participant = models.ForeignKey(
        Participant, models.CASCADE, related_name="step_visits", verbose_name=_("participant")
    )
    visit = models.PositiveIntegerField(_("visit"))
    round = models.PositiveIntegerField(_("round"))
    step = models.CharField(_("step"), max_length=40)
    began_at = models.DateTimeField(_("started at"))
    finished_at = models.DateTimeField(_("finished"), null=True, blank=True)

    class Meta:
        verbose_name = _("step visit")
        verbose_name_plural = _("step visits")
        ordering = ("began_at",)
        constraints = [
            models.UniqueConstraint(
                fields=["participant", "visit", "round", "step"], name="step_visit_once"
            )
        ]

    def __str__(self) -> str:
        return f"{self.participant_id} · {self.visit}.{self.round} · {self.step}"


class StepResponse(models.Model):
    """A response to the questionnaire of a step: whose it is, and at which place of the study it
    was asked. The drive that it is about is the one of this visit and round.
    """

    id = models.UUIDField(primary_key=True, default=uuid.uuid4, editable=False)
    response = models.OneToOneField(
        "surveys.Response",
        models.CASCADE,
        related_name="asked_at",
        verbose_name=_("response"),
    )
    participant = models.ForeignKey(
        Participant, models.CASCADE, related_name="responses", verbose_name=_("participant")
    )
    visit = models.PositiveIntegerField(_("visit"))
    round = models.PositiveIntegerField(_("round"))
    step = models.CharField(_("step"), max_length=40)

    class Meta:
        verbose_name = _("response at a step")
        verbose_name_plural = _("responses at steps")

    def __str__(self) -> str:
        return f"{self.participant_id} · {self.visit}.{self.round}.{self.step}"


class Drive(models.Model):
    """A participant's session with the robot in one condition: what was assigned, what was applied,
    how the task went.

    `assigned` is the condition and the terms of the session (sessions/leases/terms.py) as they were
    granted, and the course as it was laid out on the plan of that day; `applied` what the robot and
    the record said of themselves, and `mismatches` the names of what differs. `shown` is what the
    page shows of the task now (sessions.protocol.Task). `result` is
    experiments.tasks.engine.Result, computed from the stored record once it is closed
    (`settled_at`), exactly as anybody can compute it again. So are `began_with` and `ended_with`:
    how the robot stood in the first and the last state of the session
    (experiments.definition.start_condition.RobotSnapshot). `clock_offset` is the robot's clock
    minus ours in seconds, one for the whole drive. `versions` are those of the software and of the
    definition (experiments/versions.py). `exposed_at` is when the server heard from the
    participant's page that it shows the robot's video.
    """

    id = models.UUIDField(primary_key=True, default=uuid.uuid4, editable=False)
    participant = models.ForeignKey(
        Participant, models.CASCADE, related_name="drives", verbose_name=_("participant")
    )
    session = models.OneToOneField(
        Session, models.CASCADE, related_name="drive", verbose_name=_("session")
    )
    step = models.CharField(_("step"), max_length=40)
    visit = models.PositiveIntegerField(_("visit"))
    round = models.PositiveIntegerField(_("round"))
    number = models.PositiveIntegerField(_("session number"))  # 1, 2 …
    condition = models.CharField(_("condition"), max_length=40)
    seed = models.BigIntegerField(_("seed"))
    assigned = models.JSONField(_("assigned"), default=dict)
    applied = models.JSONField(_("applied"), default=dict, blank=True)
    mismatches = models.JSONField(_("differs"), default=list, blank=True)
    shown = models.JSONField(_("shown"), default=dict, blank=True, editable=False)
    clock_offset = models.FloatField(_("clock offset (s)"), null=True, editable=False)
    granted_at = models.DateTimeField(_("granted"))
    versions = models.JSONField(_("versions"), default=dict, blank=True)
    exposed_at = models.DateTimeField(_("exposed"), null=True, blank=True)
    # a velocity of theirs was applied, or the robot moved by itself for them
    moved = models.BooleanField(_("moved the robot"), default=False)
    outcome = models.CharField(_("task outcome"), max_length=20, blank=True)
    result = models.JSONField(_("result"), default=dict, blank=True)
    began_with = models.JSONField(_("start state"), default=dict, blank=True)
    ended_with = models.JSONField(_("end state"), default=dict, blank=True)
    settled_at = models.DateTimeField(_("finalised"), null=True, blank=True, db_index=True)
    excluded_reason = models.CharField(_("reason for exclusion"), max_length=300, blank=True)
    excluded_by = models.ForeignKey(
        settings.AUTH_USER_MODEL, models.SET_NULL, null=True, blank=True, related_name="+"
    )
    excluded_at = models.DateTimeField(_("excluded"), null=True, blank=True)

    class Meta:
        verbose_name = _("drive")
        verbose_name_plural = _("drives")
        ordering = ("-granted_at",)

    def __str__(self) -> str:
        return f"{self.participant.code} · {self.condition} · {self.number}"


class TaskEvent(models.Model):
    """What the task engine told of a drive; rewritten from the stored record when
    that is closed.
    """

    id = models.UUIDField(primary_key=True, default=uuid.uuid4, editable=False)
    drive = models.ForeignKey(Drive, models.CASCADE, related_name="events", verbose_name=_("drive"))
    number = models.PositiveIntegerField(_("number"))  # in order of time
    stamp = models.FloatField(_("timestamp"))
    type = models.CharField(_("type"), max_length=40, db_index=True)
    data = models.JSONField(_("data"), default=dict)

    class Meta:
        verbose_name = _("task event")
        verbose_name_plural = _("task events")
        ordering = ("number",)
        constraints = [models.UniqueConstraint(fields=["drive", "number"], name="task_event_once")]

    def __str__(self) -> str:
        return f"{self.type} · {self.stamp:.1f}"


class Rehearsal(models.Model):
    """A dress rehearsal of one definition with bots: how far it is, what was found, and whether it
    may be published on the strength of it. experiments/rehearsal/runs.py changes it.
    """

    class Status(models.TextChoices):
        WAITING = "waiting", _("waiting")
        RUNNING = "running", _("running")
        STOPPED = "stopped", _("ended by a researcher")
        FAILED = "failed", _("did not finish")
        DONE = "done", _("finished")

    id = models.UUIDField(primary_key=True, default=uuid.uuid4, editable=False)
    study = models.ForeignKey(
        Study, models.CASCADE, related_name="rehearsals", verbose_name=_("study")
    )
    sha256 = models.CharField(max_length=64)  # of the definition that was rehearsed
    status = models.CharField(
        _("status"), max_length=10, choices=Status.choices, default=Status.WAITING
    )
    # The study's id while it waits or runs and something else afterwards: unique on every database
    # without partial indexes.
    live_key = models.CharField(max_length=40, unique=True, editable=False, default=uuid.uuid4)
    began_at = models.DateTimeField(_("started at"))
    seen_at = models.DateTimeField(null=True, blank=True, editable=False)  # its process lived
    host = models.CharField(_("computer"), max_length=100, blank=True)
    progress = models.JSONField(default=dict, blank=True, editable=False)  # play.py, Progress
    finished_at = models.DateTimeField(_("finished"), null=True, blank=True)
    ended_by = models.ForeignKey(
        settings.AUTH_USER_MODEL,
        models.SET_NULL,
        null=True,
        blank=True,
        related_name="+",
        verbose_name=_("ended by"),
    )
    reason = models.TextField(_("reason"), blank=True)  # why it failed
    passed = models.BooleanField(_("passed"), default=False)
    report = models.JSONField(_("report"), default=dict)

    class Meta:
        verbose_name = _("rehearsal")
        verbose_name_plural = _("rehearsals")
        ordering = ("-began_at",)

    def __str__(self) -> str:
        return f"{self.study_id} · {self.began_at:%Y-%m-%d %H:%M}"


class CodingSchemeVersion(models.Model):
    """A scheme of codes (experiments/definition/coding.py) by which replays of a study are coded:
    the first is that of its definition or the first that was uploaded, a changed one is the next.
    """

    id = models.UUIDField(primary_key=True, default=uuid.uuid4, editable=False)
    study = models.ForeignKey(
        Study, models.CASCADE, related_name="coding_schemes", verbose_name=_("study")
    )
    version = models.PositiveIntegerField(_("version"))
    document = models.JSONField(_("definition"))
    created_at = models.DateTimeField(_("created"))

    class Meta:
        verbose_name = _("coding scheme")
        verbose_name_plural = _("coding schemes")
        ordering = ("study", "version")
        constraints = [
            models.UniqueConstraint(fields=["study", "version"], name="coding_scheme_once")
        ]

    def __str__(self) -> str:
        return f"{self.study} · {self.version}"


class Coding(models.Model):
    """A session as one coder codes it by one scheme. `number` is what the coder is called in a
    study, in all of its versions (C1, C2 …). Once it is done it does not change.
    """

    id = models.UUIDField(primary_key=True, default=uuid.uuid4, editable=False)
    session = models.ForeignKey(
        Session, models.CASCADE, related_name="codings", verbose_name=_("session")
    )
    scheme = models.ForeignKey(
        CodingSchemeVersion, models.CASCADE, related_name="codings", verbose_name=_("coding scheme")
    )
    coder = models.ForeignKey(
        settings.AUTH_USER_MODEL,
        models.SET_NULL,
        null=True,
        blank=True,
        related_name="+",
        verbose_name=_("coder"),
    )
    number = models.PositiveIntegerField(_("coder's number"))
    began_at = models.DateTimeField(_("started at"))
    done_at = models.DateTimeField(_("finished"), null=True, blank=True)

    class Meta:
        verbose_name = _("coding")
        verbose_name_plural = _("codings")
        ordering = ("session", "number")
        constraints = [
            models.UniqueConstraint(fields=["session", "scheme", "number"], name="coding_once")
        ]

    def __str__(self) -> str:
        return f"{self.session_id} · C{self.number}"


class CodingEdit(models.Model):
    """A version of an event that a coder noted: what it was set to, and when. The newest version
    counts; older ones stay, and a deleted event is a version that says so. The page makes both ids,
    so that what is sent twice is stored once. Seconds since the grant.
    """

    id = models.UUIDField(primary_key=True, default=uuid.uuid4, editable=False)
    coding = models.ForeignKey(
        Coding, models.CASCADE, related_name="edits", verbose_name=_("coding")
    )
    event = models.UUIDField(_("event"))
    version = models.PositiveIntegerField(_("version"))
    code = models.CharField(_("code"), max_length=40)
    begin = models.FloatField(_("beginning (s)"))
    end = models.FloatField(_("end (s)"), null=True, blank=True)
    modifiers = models.JSONField(_("modifiers"), default=dict, blank=True)
    comment = models.TextField(_("comment"), blank=True)
    is_deleted = models.BooleanField(_("deleted"), default=False)
    at = models.DateTimeField(_("changed"))

    class Meta:
        verbose_name = _("version of a coded event")
        verbose_name_plural = _("versions of coded events")
        ordering = ("at",)
        constraints = [
            models.UniqueConstraint(
                fields=["coding", "event", "version"], name="coding_edit_version_once"
            )
        ]

    def __str__(self) -> str:
        return f"{self.code} · {self.begin:.1f} · {self.version}"
