"""Studies as they are run. Five facts are separate: the assigned condition (Participant, Draw),
exposure (Drive: the page showed the robot's video), driving (Drive), the outcome of the task
(Drive), and the answers (surveys). The site deletes nothing of an exposed participant; a withdrawn
one leaves a row without personal data.
"""

import secrets
import uuid
from typing import Any

from django.conf import settings
from django.db import models
from django.db.models import CASCADE, PROTECT, SET_NULL, ForeignKey, OneToOneField
from django.utils.translation import get_language, gettext_lazy as _

from accounts.passwordless import CODE_LETTERS
from experiments.definition.recruitment.recruiting import ENDINGS
from experiments.definition.schema import StudyDefinition, as_stored, digest, from_stored
from sessions.models import Session
from surveys.documents import spoken

CODE_LENGTH = 8
USER = settings.AUTH_USER_MODEL
OPTIONAL: dict[str, Any] = {"null": True, "blank": True}
DONE, TIMED_OUT, TECHNICAL_FAILURE, SCREENED_OUT, LEFT = ENDINGS  # of taking part


def not_drawn() -> str:
    """Return a random word for a unique column without a value yet."""
    return uuid.uuid4().hex


def new_code() -> str:
    return "".join(secrets.choice(CODE_LETTERS) for _ in range(CODE_LENGTH))


def _choice(title: Any, default: models.TextChoices, **more: Any) -> models.CharField:
    return models.CharField(title, choices=type(default), default=default, **more)


def _unique(name: str, *fields: str) -> models.UniqueConstraint:
    return models.UniqueConstraint(fields=fields, name=name)


class UuidModel(models.Model):
    id = models.UUIDField(primary_key=True, default=uuid.uuid4, editable=False)

    class Meta:
        abstract = True


class ParticipantKind(models.TextChoices):
    PARTICIPANT = "participant", _("participant")
    PILOT = "pilot", _("pilot")
    BOT = "bot", _("bot")


class FrozenStudyError(ValueError):
    """A change of a published study."""


class Study(UuidModel):
    """One version of a study. A published definition never changes: a change is a new version."""

    class Status(models.TextChoices):
        """Only pilots and bots run drafts; a closed study accepts no new participants."""

        DRAFT = "draft", _("draft")
        PUBLISHED = "published", _("published")
        CLOSED = "closed", _("closed")

    class Entry(models.TextChoices):
        OPEN = "open", _("open link, with an account")
        CODE = "code", _("open link, without an account")
        PERSONAL = "personal", _("personal links only")

    FROZEN = ("slug", "version", "sha256")
    MAX_DIGITS = 6  # of a version's number in an address or a command
    slug = models.SlugField(_("name"), max_length=40)
    version = models.PositiveIntegerField(_("version"))
    title = models.CharField(_("title"), max_length=200)
    definition = models.JSONField(_("definition"))
    sha256 = models.CharField(max_length=64, editable=False)
    status = _choice(_("status"), Status.DRAFT, max_length=10, db_index=True)
    entry = _choice(_("entry"), Entry.OPEN, max_length=10)
    # as in experiments/definition/opening_hours.py; empty means always
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
    # decides which robots it can use: experiments/participation/robot_eligibility.py
    published_by = ForeignKey(USER, SET_NULL, **OPTIONAL, related_name="published_studies")
    unrehearsed_reason = models.TextField(_("reason for publishing without rehearsal"), blank=True)
    deviations = models.TextField(
        _("deviations from the plan"),
        blank=True,
        help_text=_("What was done differently, when and why. It is exported with the data."),
    )
    # metadata of its dataset, and its drafts in repositories by their name (experiments/deposit/)
    publication = models.JSONField(
        _("publication details"), default=dict, blank=True, editable=False
    )
    deposits = models.JSONField(default=dict, blank=True, editable=False)
    # keys the hash of networks, so that they can be counted within this study only
    secret = models.CharField(max_length=64, default=secrets.token_hex, editable=False)
    # makes the completion codes (empty: the secret does); the same in all versions
    code_key = models.CharField(max_length=64, blank=True, editable=False)

    class Meta:
        verbose_name = _("study")
        verbose_name_plural = _("studies")
        ordering = ("slug", "-version")
        constraints = [_unique("study_version_once", "slug", "version")]

    def __str__(self) -> str:
        return f"{self.title} · {self.slug} {self.version}"

    def save(self, **options: Any) -> None:
        """Save the study, a draft with every value and its digest; a published digest stays. One
        that was published with something else, or would be a draft again, is a FrozenStudyError.
        """
        definition = self.as_definition()
        published = Study.objects.filter(pk=self.pk).exclude(status=self.Status.DRAFT).first()
        if published is None:
            self.definition, self.sha256 = as_stored(definition), digest(definition)
        elif (
            self.status == self.Status.DRAFT
            or definition != published.as_definition()
            or any(getattr(self, name) != getattr(published, name) for name in self.FROZEN)
        ):
            which = f"version {published.version} of {published.slug}"
            raise FrozenStudyError(f"{which} is published and cannot change: make a new version")
        super().save(**options)

    @property
    def shown_title(self) -> str:
        """The title in the language of the page."""
        titles = (self.definition or {}).get("title") or {}
        return (spoken(titles, get_language() or "") if titles else "") or self.title

    def as_definition(self) -> StudyDefinition:
        return from_stored(self.definition)

    @classmethod
    def version_of(cls, slug: str, wanted: str) -> "Study | None":
        """Return a version of a study by its number; without a number the newest that is no draft,
        else the newest.
        """
        rows = cls.objects.filter(slug=slug).order_by("-version")
        if wanted:
            is_number = wanted.isdecimal() and len(wanted) < cls.MAX_DIGITS
            rows = rows.filter(version=int(wanted)) if is_number else rows.none()
        return rows.exclude(status=cls.Status.DRAFT).first() or rows.first()


class StudyMember(UuidModel):
    """A researcher in all versions of a study."""

    class Role(models.TextChoices):
        OWNER = "owner", _("owner: full access")
        RESEARCHER = "researcher", _("researcher: sees data, excludes drives, intervenes")
        VIEWER = "viewer", _("viewer: sees pseudonymous data")
        WIZARD = "wizard", _("hidden operator: only operates the robot")
        CODER = "coder", _("coder: codes replays, sees nothing else")

    slug = models.SlugField(_("study"), max_length=40, db_index=True)
    user = ForeignKey(USER, CASCADE, related_name="studies", verbose_name=_("user"))
    role = models.CharField(_("role"), max_length=12, choices=Role)

    class Meta:
        verbose_name = _("researcher")
        verbose_name_plural = _("researchers")
        constraints = [_unique("one_role_in_a_study", "slug", "user")]

    def __str__(self) -> str:
        return f"{self.user} · {self.slug} · {self.get_role_display()}"


class ResearcherInvitation(UuidModel):
    """An invitation to become a researcher of a study, by a link that works once; only a hash of
    its token is stored.
    """

    slug = models.SlugField(_("study"), max_length=40, db_index=True)
    email = models.EmailField(_("e-mail address"))
    role = models.CharField(_("role"), max_length=12, choices=StudyMember.Role)
    token_sha256 = models.CharField(max_length=64, unique=True, editable=False)
    invited_by = ForeignKey(USER, CASCADE, related_name="+", verbose_name=_("invited by"))
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
    """An uploaded picture or video for instructions. Its `name` is made from its content, so that a
    published study cannot change through it.
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


class Participant(UuidModel):
    """A participant in one version of a study. `code` is their name in datasets."""

    class Status(models.TextChoices):
        ACTIVE = "active", _("taking part")
        FINISHED = "finished", _("finished")
        SCREENED_OUT = "screened_out", _("screened out")
        WITHDRAWN = "withdrawn", _("withdrawn")

    class Stage(models.TextChoices):
        """The state of the place in the cell (experiments/participation/assignment.py)."""

        UNASSIGNED = "", _("unassigned")
        UNDER_WAY = "under_way", _("under way")
        FREED = "freed", _("freed")
        FILLED = "filled", _("filled")
        REFILLED = "refilled", _("reassigned")

    study = ForeignKey(Study, PROTECT, related_name="participants", verbose_name=_("study"))
    user = ForeignKey(
        USER, SET_NULL, null=True, blank=True, related_name="participations", verbose_name=_("user")
    )
    # "<study>:<user>", its own id without a user: unique without a partial index
    slot = models.CharField(max_length=80, unique=True, editable=False)
    code = models.CharField(_("code"), max_length=12, unique=True, default=new_code, editable=False)
    kind = _choice(_("kind"), ParticipantKind.PARTICIPANT, max_length=12, db_index=True)
    # experiments.participation.assignment.Access
    access = models.CharField(_("joined via"), max_length=12, default="open")
    status = _choice(_("status"), Status.ACTIVE, max_length=12, db_index=True)
    language = models.CharField(_("language"), max_length=16, default="en")
    # parameters of the link
    recruitment = models.JSONField(_("recruitment"), default=dict, blank=True)
    # The id of a recruitment site, and "<study's name>:<its hash>" or a random word: unique, so
    # that one id is one participant in all versions of the study. After a withdrawal, the id is a
    # keyed hash (experiments/recruitment/recognition.py).
    recruitment_id = models.CharField(
        _("recruitment id"), max_length=100, blank=True, db_index=True
    )
    recruited_as = models.CharField(max_length=120, unique=True, default=not_drawn, editable=False)
    age = models.PositiveIntegerField(_("age"), null=True, blank=True)

    # --- assignment at the first grant of the robot, by the last draw ---
    cell = models.CharField(_("cell"), max_length=400, blank=True, db_index=True)
    conditions = models.JSONField(_("conditions in order"), default=list, blank=True)
    draws_applied = models.PositiveIntegerField(_("draws"), default=0)
    stage = _choice(_("place"), Stage.UNASSIGNED, max_length=10, blank=True, db_index=True)

    # --- the current step: experiments/participation/journey.py ---
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
    # the last stage reached: experiments/extraction/people.py
    withdrawn_stage = models.CharField(_("reached"), max_length=12, blank=True)

    class Meta:
        verbose_name = _("participant")
        verbose_name_plural = _("participants")
        ordering = ("-created_at",)
        indexes = [models.Index(fields=["study", "kind", "stage"], name="participant_places")]

    def __str__(self) -> str:
        return f"{self.code} · {self.study.slug} {self.study.version}"

    @property
    def task_drives(self) -> "models.QuerySet[Drive]":
        return self.drives.exclude(step__in=self.study.as_definition().practice_keys)


def _participant(related_name: str) -> "ForeignKey[Participant, Participant]":
    title = _("participant")
    return ForeignKey(Participant, CASCADE, related_name=related_name, verbose_name=title)


class Draw(UuidModel):
    """A cell that was drawn for a participant, with what the draw depended on
    (experiments/participation/assignment.py): `counts` are the places taken in each open cell,
    `scores` those of alike participants, `best` the cells with the lowest score, `levels` the
    participant's levels of the balance factors.

    `number` is unique within a study and kind: of two participants who are drawn concurrently, one
    is drawn again. `nth` counts the participant's own draws; one beyond
    `Participant.draws_applied` is not applied yet.
    """

    class DrawReason(models.TextChoices):
        FIRST = "first", _("first assignment")
        AGAIN = "again", _("assigned again, because nothing had been seen of the first")

    study = ForeignKey(Study, PROTECT, related_name="draws", verbose_name=_("study"))
    participant = _participant("draws")
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
            _unique("draw_number_once", "study", "kind", "number"),
            _unique("nth_draw_once", "participant", "nth"),
        ]

    def __str__(self) -> str:
        return f"{self.number} · {self.cell}"


class ConsentReceipt(UuidModel):
    """The texts to which a participant agreed."""

    participant = _participant("consents")
    step = models.CharField(_("step"), max_length=40)
    version = models.PositiveIntegerField(_("version"))
    language = models.CharField(_("language"), max_length=16)
    text = models.TextField(_("text as shown"))
    text_sha256 = models.CharField(max_length=64)
    guardian = models.CharField(_("guardian"), max_length=120, blank=True)
    # None: not asked
    sharing = models.BooleanField(_("data may be shared"), null=True)
    sharing_text = models.TextField(_("text on sharing as shown"), blank=True)
    agreed_at = models.DateTimeField(_("agreed"))

    class Meta:
        verbose_name = _("consent")
        verbose_name_plural = _("consents")
        constraints = [_unique("consent_once", "participant", "step", "version")]

    def __str__(self) -> str:
        return f"{self.participant_id} · {self.step} {self.version}"


class PersonalLink(UuidModel):
    """A link for one person, redeemed once, by POST only, so that previews in mail programs do not
    use it up.
    """

    study = ForeignKey(Study, CASCADE, related_name="links", verbose_name=_("study"))
    token_sha256 = models.CharField(max_length=64, unique=True, editable=False)
    label = models.CharField(_("label"), max_length=120, blank=True)
    access = models.CharField(_("access given"), max_length=12, default="invitation")
    # The participant's kind. A bot's data never count; only commands make links for bots.
    kind = _choice(_("for"), ParticipantKind.PARTICIPANT, max_length=12)
    created_at = models.DateTimeField(_("created"))
    expires_at = models.DateTimeField(_("expires"), null=True, blank=True)
    revoked_at = models.DateTimeField(_("revoked"), null=True, blank=True)
    redeemed_at = models.DateTimeField(_("redeemed"), null=True, blank=True)
    participant = ForeignKey(
        Participant, SET_NULL, **OPTIONAL, related_name="links", verbose_name=_("participant")
    )

    class Meta:
        verbose_name = _("personal link")
        verbose_name_plural = _("personal links")
        ordering = ("-created_at",)

    def __str__(self) -> str:
        return self.label or str(self.pk)

    @property
    def guest(self) -> Any:
        """The user without an account whom the link lets in again; else None."""
        user = self.participant.user if self.participant is not None else None
        return user if user is not None and user.is_guest and user.is_active else None

    @property
    def is_revocable(self) -> bool:
        return self.revoked_at is None and (self.redeemed_at is None or self.guest is not None)


class StudyKey(UuidModel):
    """A key to the API of a study in all versions (experiments/recruitment/api.py); only its hash
    is stored.
    """

    slug = models.SlugField(_("study"), max_length=40, db_index=True)
    label = models.CharField(_("label"), max_length=60)
    token_sha256 = models.CharField(max_length=64, unique=True, editable=False)
    made_at = models.DateTimeField(_("created"))
    made_by = ForeignKey(USER, CASCADE, related_name="+", verbose_name=_("created by"))
    last_used_at = models.DateTimeField(_("last used"), null=True, editable=False)

    class Meta:
        verbose_name = _("API key of a study")
        verbose_name_plural = _("API keys of studies")
        constraints = [_unique("one_study_key_of_a_label", "slug", "label")]

    def __str__(self) -> str:
        return f"{self.slug} · {self.label}"


class Contact(UuidModel):
    """The e-mail address of a participant for reminders, deleted when none is due any more. `token`
    is in the address that stops the e-mails.
    """

    participant = OneToOneField(
        Participant, CASCADE, related_name="contact", verbose_name=_("participant")
    )
    email = models.EmailField(_("e-mail address"))
    site = models.CharField(max_length=200, editable=False)  # address of the site in its e-mails
    token = models.CharField(max_length=64, unique=True, default=secrets.token_urlsafe)
    given_at = models.DateTimeField(_("given"))
    # to a second session; None: not, or done
    invite_at = models.DateTimeField(_("invited to a second session"), null=True, blank=True)

    class Meta:
        verbose_name = _("e-mail address of a participant")
        verbose_name_plural = _("e-mail addresses of participants")

    def __str__(self) -> str:
        return str(self.participant_id)


class Appointment(UuidModel):
    """A booked drive. `slot` is "<robot>:<start>", unique, so that of two concurrent bookings of
    one time one fails.
    """

    participant = _participant("appointments")
    robot = ForeignKey("robots.Robot", CASCADE, related_name="+", verbose_name=_("robot"))
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


class StepVisit(UuidModel):
    """A participant on a step, from seeing it first to going on; the funnel counts these."""

    participant = _participant("step_visits")
    visit = models.PositiveIntegerField(_("visit"))
    round = models.PositiveIntegerField(_("round"))
    step = models.CharField(_("step"), max_length=40)
    began_at = models.DateTimeField(_("started at"))
    finished_at = models.DateTimeField(_("finished"), null=True, blank=True)

    class Meta:
        verbose_name = _("step visit")
        verbose_name_plural = _("step visits")
        ordering = ("began_at",)
        constraints = [_unique("step_visit_once", "participant", "visit", "round", "step")]

    def __str__(self) -> str:
        return f"{self.participant_id} · {self.visit}.{self.round} · {self.step}"


class StepResponse(UuidModel):
    """A participant's response to the questionnaire of a step. It is about the drive of the same
    visit and round.
    """

    response = OneToOneField(
        "surveys.Response", CASCADE, related_name="asked_at", verbose_name=_("response")
    )
    participant = _participant("responses")
    visit = models.PositiveIntegerField(_("visit"))
    round = models.PositiveIntegerField(_("round"))
    step = models.CharField(_("step"), max_length=40)

    class Meta:
        verbose_name = _("response at a step")
        verbose_name_plural = _("responses at steps")

    def __str__(self) -> str:
        return f"{self.participant_id} · {self.visit}.{self.round}.{self.step}"


class Drive(UuidModel):
    """A participant's session with the robot in one condition.

    `assigned` is the condition, the terms of the session (sessions/leases/terms.py) and the course
    on the plan as granted; `applied` what the robot and the record reported, and `mismatches` the
    names of what differs. `shown` is the task on the page now (sessions.protocol.Task). `result`
    (experiments.tasks.engine.Result), `began_with` and `ended_with` (the first and last
    experiments.definition.start_condition.RobotSnapshot) are computed from the stored record once
    it is closed (`settled_at`). `clock_offset` is the robot's clock minus ours in s, one for the
    whole drive. `versions` are those of experiments/versions.py. `exposed_at` is when the
    participant's page reported that it shows the robot's video.
    """

    participant = _participant("drives")
    session = OneToOneField(Session, CASCADE, related_name="drive", verbose_name=_("session"))
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
    # for them (sessions/visitor_motion.py), as the whole record shows
    moved = models.BooleanField(_("moved the robot"), default=False)
    outcome = models.CharField(_("task outcome"), max_length=20, blank=True)
    result = models.JSONField(_("result"), default=dict, blank=True)
    began_with = models.JSONField(_("start state"), default=dict, blank=True)
    ended_with = models.JSONField(_("end state"), default=dict, blank=True)
    settled_at = models.DateTimeField(_("finalised"), null=True, blank=True, db_index=True)
    excluded_reason = models.CharField(_("reason for exclusion"), max_length=300, blank=True)
    excluded_by = ForeignKey(USER, SET_NULL, null=True, blank=True, related_name="+")
    excluded_at = models.DateTimeField(_("excluded"), null=True, blank=True)

    class Meta:
        verbose_name = _("drive")
        verbose_name_plural = _("drives")
        ordering = ("-granted_at",)

    def __str__(self) -> str:
        return f"{self.participant.code} · {self.condition} · {self.number}"

    @property
    def has_moved(self) -> bool:
        """Whether the robot moved for the participant, also before the record is settled."""
        return self.moved or self.session.first_motion_at is not None


class TaskEvent(UuidModel):
    """An event of the task engine; rewritten from the stored record when that is closed."""

    drive = ForeignKey(Drive, CASCADE, related_name="events", verbose_name=_("drive"))
    number = models.PositiveIntegerField(_("number"))  # in order of time
    stamp = models.FloatField(_("timestamp"))
    type = models.CharField(_("type"), max_length=40, db_index=True)
    data = models.JSONField(_("data"), default=dict)

    class Meta:
        verbose_name = _("task event")
        verbose_name_plural = _("task events")
        ordering = ("number",)
        constraints = [_unique("task_event_once", "drive", "number")]

    def __str__(self) -> str:
        return f"{self.type} · {self.stamp:.1f}"


class Rehearsal(UuidModel):
    """A dress rehearsal of one definition with bots (experiments/rehearsal/runs.py): its progress,
    its report, and whether the study may be published after it.
    """

    class Status(models.TextChoices):
        WAITING = "waiting", _("waiting")
        RUNNING = "running", _("running")
        STOPPED = "stopped", _("ended by a researcher")
        FAILED = "failed", _("did not finish")
        DONE = "done", _("finished")

    study = ForeignKey(Study, CASCADE, related_name="rehearsals", verbose_name=_("study"))
    sha256 = models.CharField(max_length=64)  # of the definition that was rehearsed
    status = _choice(_("status"), Status.WAITING, max_length=10)
    # the study's id while it waits or runs: unique without a partial index
    live_key = models.CharField(max_length=40, unique=True, editable=False, default=uuid.uuid4)
    began_at = models.DateTimeField(_("started at"))
    seen_at = models.DateTimeField(null=True, blank=True, editable=False)  # its process lived
    host = models.CharField(_("computer"), max_length=100, blank=True)
    progress = models.JSONField(default=dict, blank=True, editable=False)  # play.py, Progress
    finished_at = models.DateTimeField(_("finished"), null=True, blank=True)
    ended_by = ForeignKey(USER, SET_NULL, **OPTIONAL, related_name="+", verbose_name=_("ended by"))
    reason = models.TextField(_("reason"), blank=True)  # why it failed
    passed = models.BooleanField(_("passed"), default=False)
    report = models.JSONField(_("report"), default=dict)

    class Meta:
        verbose_name = _("rehearsal")
        verbose_name_plural = _("rehearsals")
        ordering = ("-began_at",)

    def __str__(self) -> str:
        return f"{self.study_id} · {self.began_at:%Y-%m-%d %H:%M}"


class CodingSchemeVersion(UuidModel):
    """A coding scheme (experiments/definition/coding.py) of a study: the first is that of its
    definition or the first upload, a changed one the next.
    """

    study = ForeignKey(Study, CASCADE, related_name="coding_schemes", verbose_name=_("study"))
    version = models.PositiveIntegerField(_("version"))
    document = models.JSONField(_("definition"))
    created_at = models.DateTimeField(_("created"))

    class Meta:
        verbose_name = _("coding scheme")
        verbose_name_plural = _("coding schemes")
        ordering = ("study", "version")
        constraints = [_unique("coding_scheme_once", "study", "version")]

    def __str__(self) -> str:
        return f"{self.study} · {self.version}"


class Coding(UuidModel):
    """A session as one coder codes it by one scheme. `number` names the coder in all versions of a
    study (C1, C2 …). A finished coding does not change.
    """

    session = ForeignKey(Session, CASCADE, related_name="codings", verbose_name=_("session"))
    scheme = ForeignKey(
        CodingSchemeVersion, CASCADE, related_name="codings", verbose_name=_("coding scheme")
    )
    coder = ForeignKey(USER, SET_NULL, **OPTIONAL, related_name="+", verbose_name=_("coder"))
    number = models.PositiveIntegerField(_("coder's number"))
    began_at = models.DateTimeField(_("started at"))
    done_at = models.DateTimeField(_("finished"), null=True, blank=True)

    class Meta:
        verbose_name = _("coding")
        verbose_name_plural = _("codings")
        ordering = ("session", "number")
        constraints = [_unique("coding_once", "session", "scheme", "number")]

    def __str__(self) -> str:
        return f"{self.session_id} · C{self.number}"


class CodingEdit(UuidModel):
    """A version of a coded event; the newest counts, and a deletion is one. The page makes both
    ids, so that a repeated request is stored once. Times are in s since the grant.
    """

    coding = ForeignKey(Coding, CASCADE, related_name="edits", verbose_name=_("coding"))
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
        constraints = [_unique("coding_edit_version_once", "coding", "event", "version")]

    def __str__(self) -> str:
        return f"{self.code} · {self.begin:.1f} · {self.version}"
