"""Robots, the places where they drive, and who may drive them."""

import base64
import datetime
import re
import uuid
from collections.abc import Mapping
from typing import Any
from urllib.parse import urlsplit

from django.conf import settings
from django.core.exceptions import ValidationError
from django.core.validators import (
    MaxValueValidator,
    MinValueValidator,
    RegexValidator,
    URLValidator,
)
from django.db import models, transaction
from django.utils.translation import get_language, gettext_lazy as _

from robots.api import floorplan
from robots.api.idle import ONLINE_SECONDS
from robots.api.messages import FloorPlanUpdate
from robots.api.topics import RESERVED_NAMES, ROBOT_NAME

TITLE_LENGTH = 80
LANGUAGE = re.compile(r"[a-z]{2,3}(-[a-z0-9]{2,8})*")


def refuse_reserved_name(name: str) -> None:
    """Raise ValidationError for a name that the topic tree uses itself."""
    if name in RESERVED_NAMES:
        text = _("“%(name)s” is reserved. Choose another name.")
        raise ValidationError(text, params={"name": name})


def check_translations(value: Any) -> None:
    """Raise ValidationError unless the translations of a robot are {language: {"title": …,
    "description": …}}, where each may be absent.
    """
    is_right = isinstance(value, dict) and all(
        LANGUAGE.fullmatch(language)
        and isinstance(words, dict)
        and set(words) <= {"title", "description"}
        and all(isinstance(text, str) and text.strip() for text in words.values())
        and len(words.get("title", "")) <= TITLE_LENGTH
        for language, words in value.items()
    )
    if not is_right:
        raise ValidationError(
            _('Enter translations like this: {"es": {"title": "…", "description": "…"}}.')
        )


def check_site(value: str) -> None:
    """Raise ValidationError unless the value has only scheme, host and port of a site."""
    URLValidator(schemes=["https", "http"])(value)
    parts = urlsplit(value)
    if "@" in value or value != f"{parts.scheme}://{parts.netloc}":
        raise ValidationError(
            _("Enter an address without a path, such as https://robots.north.example.org.")
        )


class FloorPlan(models.Model):
    """A stored site: the occupancy map of ROS map_server, and `plan`, a
    robots.api.floorplan.FloorPlan as JSON.
    """

    id = models.UUIDField(primary_key=True, default=uuid.uuid4, editable=False)
    name = models.SlugField(_("map id"), unique=True)
    title = models.CharField(_("title"), max_length=120)
    resolution = models.FloatField(
        _("resolution (m/pixel)"), validators=[MinValueValidator(0.001), MaxValueValidator(10.0)]
    )
    origin_x = models.FloatField(_("origin x (m)"))
    origin_y = models.FloatField(_("origin y (m)"))
    origin_theta = models.FloatField(_("origin θ (rad)"), default=0.0)
    negate = models.BooleanField(default=False)
    occupied_thresh = models.FloatField(default=0.65)
    free_thresh = models.FloatField(default=0.196)
    width = models.PositiveIntegerField(_("width (pixels)"))
    height = models.PositiveIntegerField(_("height (pixels)"))
    image = models.BinaryField(_("occupancy image (PNG)"))
    plan = models.JSONField(_("plan"), default=dict)
    sha256 = models.CharField(max_length=64, editable=False)

    class Meta:
        verbose_name = _("floor plan")
        verbose_name_plural = _("floor plans")
        ordering = ("title",)

    def __str__(self) -> str:
        return self.title

    def as_message(self) -> FloorPlanUpdate:
        """Return the retained message on a robot's `floorplan` topic."""
        return FloorPlanUpdate(
            map_id=self.name,
            sha256=self.sha256,
            resolution=self.resolution,
            origin=(self.origin_x, self.origin_y, self.origin_theta),
            negate=self.negate,
            occupied_thresh=self.occupied_thresh,
            free_thresh=self.free_thresh,
            image=base64.b64encode(bytes(self.image)).decode(),
            # Robots use names; an older agent refuses a plan with unknown fields.
            plan={name: part for name, part in self.plan.items() if name != "translations"} or None,
        )

    def plan_in(self, language: str) -> dict[str, Any]:
        """Return the plan with its titles in a language; {} when there is none."""
        return floorplan.in_language(self.plan or {}, language)

    @property
    def shown_title(self) -> str:
        """The title in the language of the page."""
        offered = (self.plan or {}).get("translations", {})
        return floorplan.translation(offered, get_language() or "").get(self.title, self.title)


class WithPresence(models.Manager["Robot"]):
    """Robots joined with their presence, which nearly all readers need."""

    def get_queryset(self) -> "models.QuerySet[Robot]":
        return super().get_queryset().select_related("presence")


class Robot(models.Model):
    """A robot as its owner set it up; other processes write its presence and credentials."""

    class Access(models.TextChoices):
        OPEN = "open", _("open to all logged-in users")
        INVITATION = "invitation", _("by invitation")
        TRAINED = "trained", _("for trained users")

    class DriveAssist(models.TextChoices):
        """robots.api.messages.AssistLevel."""

        OFF = "off", _("off")
        SLOW = "slow", _("slows down and stops at obstacles")
        STEER = "steer", _("steers around obstacles and through doors")

    class Calls(models.TextChoices):
        """Whether people at the robot must accept a visitor's call: robots.api.messages.Config."""

        ACCEPT = "accept", _("start immediately")
        ASK = "ask", _("somebody at the screen must accept")

    class Turnaround(models.TextChoices):
        """The state of the robot between two visits (sessions/leases/readiness.py)."""

        READY = "ready", _("ready")
        RETURNING = "returning", _("returning home")
        CHARGING = "charging", _("charging")
        PAUSED = "paused", _("paused")

    id = models.UUIDField(primary_key=True, default=uuid.uuid4, editable=False)
    name = models.CharField(
        _("name"),
        max_length=63,
        unique=True,
        validators=[
            RegexValidator(ROBOT_NAME, _("Use only lower-case letters, digits and hyphens.")),
            refuse_reserved_name,
        ],
        help_text=_("Used in links, topics and “run_robot NAME”."),
    )
    title = models.CharField(_("title"), max_length=TITLE_LENGTH)
    description = models.TextField(_("description"), blank=True)
    translations = models.JSONField(
        _("translations"),
        default=dict,
        blank=True,
        validators=[check_translations],
        help_text=_(
            "Title and description in other languages, by language code. "
            "What you leave out is shown as above."
        ),
    )
    owner = models.ForeignKey(
        settings.AUTH_USER_MODEL,
        models.SET_NULL,
        null=True,
        blank=True,
        related_name="owned_robots",
        verbose_name=_("owner"),
    )
    floor_plan = models.ForeignKey(
        FloorPlan,
        models.SET_NULL,
        null=True,
        blank=True,
        related_name="robots",
        verbose_name=_("floor plan"),
    )
    enabled = models.BooleanField(_("enabled"), default=True)
    # A disabled robot cannot connect, so it could not be tested before visitors drive it. One that
    # is added in the administration is therefore hidden at first. Those that programs add (demo,
    # practice, rehearsals) can be driven at once.
    shown_to_visitors = models.BooleanField(
        _("show to visitors"),
        default=True,
        help_text=_(
            "Visitors see the robot and can drive it. Available once the robot has connected. "
            "You and its operators can always drive it."
        ),
    )
    for_experienced = models.BooleanField(
        _("for experienced drivers"),
        default=False,
        help_text=_("Shown on the home page; other robots are listed before it."),
    )
    access = models.CharField(_("access"), max_length=12, choices=Access, default=Access.OPEN)
    observers_allowed = models.BooleanField(_("viewers allowed"), default=True)
    turn_minutes = models.FloatField(
        _("turn (minutes)"),
        null=True,
        blank=True,
        validators=[MinValueValidator(0.1)],
        help_text=_(
            "How long a visitor drives when others wait. Leave blank to use the site's default."
        ),
    )
    max_linear = models.FloatField(
        _("speed limit (m/s)"), null=True, blank=True, validators=[MinValueValidator(0.01)]
    )
    max_angular = models.FloatField(
        _("turning limit (rad/s)"), null=True, blank=True, validators=[MinValueValidator(0.01)]
    )

    adapter = models.CharField(
        _("adapter"),
        max_length=100,
        blank=True,
        validators=[
            RegexValidator(r"^[\w./][\w./-]*\Z", _("Enter a name or the path of a .py file."))
        ],
        help_text=_("The software that connects the agent to the robot."),
    )
    profile = models.CharField(
        _("profile"),
        max_length=200,
        blank=True,
        validators=[
            RegexValidator(r"^[\w./][\w./-]*\Z", _("Enter a name or the path of a .toml file."))
        ],
        help_text=_("The model of the robot: its size, speed and sensors."),
    )
    # Options of the adapter that robots/enrol/connect_command.py asks, by name; texts.
    options = models.JSONField(default=dict, blank=True, editable=False)
    assist = models.CharField(
        _("assistance"),
        max_length=5,
        choices=DriveAssist,
        default=DriveAssist.OFF,
        help_text=_(
            "Used unless the visitor or a study chooses another level. Visitors who have never "
            "driven begin with a robot that stops at obstacles."
        ),
    )
    doors = models.JSONField(
        _("doors"),
        default=dict,
        blank=True,
        editable=False,
        help_text=_("Simulated site only: names of the doors that are open or closed."),
    )
    returns_home = models.BooleanField(
        _("docks after each visit"),
        default=True,
        help_text=_(
            "The robot drives to its charging station by itself. It is free again "
            "once it is docked and charged and knows its position."
        ),
    )
    # A simulated robot for visitors who wait (telepresence_site/practice): in no list or study.
    practice = models.BooleanField(default=False, editable=False)
    # When a page last requested any practice robot; the same for all of them.
    wanted_at = models.DateTimeField(null=True, editable=False)
    charge_limit = models.FloatField(
        _("minimum charge for a visit"),
        default=0.2,
        validators=[MinValueValidator(0.0), MaxValueValidator(1.0)],
    )
    # Set and removed by people. While it is set, no visitor gets the robot, and the queue waits
    # (sessions/leases/store.py).
    held = models.CharField(_("queue pause reason"), max_length=200, blank=True, editable=False)

    calls = models.CharField(
        _("calls"),
        max_length=6,
        choices=Calls,
        default=Calls.ACCEPT,
        help_text=_("Applies when a visitor turns on the microphone or camera."),
    )
    # a user's key and permits, set by robots.access.prefetch_permits
    permit_cache: tuple[Any, frozenset[str]] | None = None

    objects = WithPresence()

    class Meta:
        verbose_name = _("robot")
        verbose_name_plural = _("robots")
        ordering = ("title",)

    def __str__(self) -> str:
        return self.title or self.name

    @transaction.atomic
    def save(self, *args: Any, **options: Any) -> None:
        """Save the row; a new robot gets the rows that belong to it."""
        is_new = self._state.adding
        super().save(*args, **options)
        if is_new:
            RobotPresence.objects.create(robot=self)
            RobotCredentials.objects.create(robot=self)

    def title_in(self, language: str) -> str:
        """Return the title in a language, or untranslated."""
        return self._words_in(language).get("title") or self.title or self.name

    @property
    def titles(self) -> dict[str, str]:
        words = (self.translations or {}).items()
        return {language: texts["title"] for language, texts in words if texts.get("title")}

    @property
    def shown_title(self) -> str:
        """The title in the language of the page."""
        return self.title_in(get_language() or "")

    @property
    def shown_description(self) -> str:
        """The description in the language of the page."""
        return self._words_in(get_language() or "").get("description") or self.description

    def _words_in(self, language: str) -> Mapping[str, str]:
        return floorplan.translation(self.translations or {}, language)

    def doors_in(self, language: str) -> list[dict[str, Any]]:
        """Return the doors of its site: name, title, and the state set by the server or plan."""
        plan = self.floor_plan.plan_in(language) if self.floor_plan else {}
        return [
            {
                "name": door["name"],
                "title": door.get("title") or door["name"],
                "state": self.doors.get(door["name"], door.get("state", "open")),
            }
            for door in plan.get("doors", ())
        ]

    @property
    def can_go_home(self) -> bool:
        """Whether it should dock after each visit, and reports that it can."""
        capabilities = (self.presence.factsheet or {}).get("capabilities", ())
        return self.returns_home and "dock" in capabilities

    def is_online(self, now: datetime.datetime) -> bool:
        """Tell whether the robot is connected and has sent a message recently; an idle one is
        silent for half a minute (robots/api/idle.py).
        """
        seen_at = self.presence.last_seen_at
        is_recent = seen_at is not None and (now - seen_at).total_seconds() < ONLINE_SECONDS
        return self.enabled and self.presence.connection == "ONLINE" and is_recent

    @staticmethod
    def online_at(now: datetime.datetime) -> models.Case:
        """Return `is_online` as an expression for queries of robots: true or false, never NULL."""
        seen_after = now - datetime.timedelta(seconds=ONLINE_SECONDS)
        is_online = models.Q(
            enabled=True, presence__connection="ONLINE", presence__last_seen_at__gt=seen_after
        )
        return models.Case(
            models.When(is_online, then=True), default=False, output_field=models.BooleanField()
        )


class RobotPresence(models.Model):
    """A robot's last report, and its state between two visits. The session manager writes it every
    few seconds, in a separate row so that these writes and the owner's edits of the robot never
    overwrite each other.
    """

    robot = models.OneToOneField(
        Robot, models.CASCADE, primary_key=True, related_name="presence", editable=False
    )
    connection = models.CharField(_("connection"), max_length=20, default="OFFLINE", editable=False)
    boot = models.CharField(max_length=64, blank=True, editable=False)
    last_seen_at = models.DateTimeField(_("last seen"), null=True, editable=False)
    factsheet = models.JSONField(_("factsheet"), null=True, blank=True, editable=False)
    report = models.JSONField(_("last state"), null=True, blank=True, editable=False)
    turnaround = models.CharField(
        _("between visits"),
        max_length=10,
        choices=Robot.Turnaround,
        default=Robot.Turnaround.READY,
        editable=False,
    )
    turnaround_reason = models.CharField(_("reason"), max_length=300, blank=True, editable=False)
    turnaround_at = models.DateTimeField(_("since"), null=True, editable=False)

    class Meta:
        verbose_name = _("robot presence")
        verbose_name_plural = _("robot presence")

    def __str__(self) -> str:
        return f"{self.robot_id} · {self.connection}"


class RobotCredentials(models.Model):
    """The hashes of a robot's keys: to the broker (robots/enrol/credentials.py), and of its screen
    (robots/screens.py).
    """

    robot = models.OneToOneField(
        Robot, models.CASCADE, primary_key=True, related_name="credentials", editable=False
    )
    screen_hash = models.CharField(max_length=200, blank=True, editable=False)
    screen_made_at = models.DateTimeField(_("screen key created"), null=True, editable=False)

    credential_hash = models.CharField(max_length=200, blank=True, editable=False)
    # The same token's hash for a broker that reads no other kind; empty for a token that is older
    # than this field and was not sent to us since.
    bcrypt_hash = models.CharField(max_length=100, blank=True, editable=False)
    credential_made_at = models.DateTimeField(_("credentials created"), null=True, editable=False)

    # The hash's user at the broker, or empty for the robot's name; each rotation makes a new one
    # (robots/enrol/credentials.py).
    credential_user = models.CharField(max_length=80, blank=True, editable=False)
    # The previous credentials, valid until then, so that a robot can change them while it runs.
    former_user = models.CharField(max_length=80, blank=True, editable=False)
    former_hash = models.CharField(max_length=200, blank=True, editable=False)
    former_bcrypt_hash = models.CharField(max_length=100, blank=True, editable=False)
    former_until = models.DateTimeField(null=True, editable=False)
    renewal_asked_at = models.DateTimeField(
        _("credential renewal requested"), null=True, editable=False
    )

    class Meta:
        verbose_name = _("robot credentials")
        verbose_name_plural = _("robot credentials")

    def __str__(self) -> str:
        return str(self.robot_id)


class Enrolment(models.Model):
    """The hash of a one-time token with which a robot's computer fetches the robot's credentials
    (robots/enrol/tokens.py).
    """

    id = models.UUIDField(primary_key=True, default=uuid.uuid4, editable=False)
    robot = models.ForeignKey(
        Robot, models.CASCADE, related_name="enrolments", verbose_name=_("robot")
    )
    token_sha256 = models.CharField(max_length=64, unique=True, editable=False)
    made_at = models.DateTimeField(_("created"))
    expires_at = models.DateTimeField(_("expires"))
    used_at = models.DateTimeField(_("used"), null=True)

    class Meta:
        verbose_name = _("enrolment")
        verbose_name_plural = _("enrolments")

    def __str__(self) -> str:
        return f"{self.robot_id} · {self.made_at:%Y-%m-%d %H:%M}"


class RobotElsewhere(models.Model):
    """A robot that another site of the same organization serves (robots/enrol/elsewhere.py)."""

    id = models.UUIDField(primary_key=True, default=uuid.uuid4, editable=False)
    name = models.CharField(
        _("name"),
        max_length=63,
        unique=True,
        validators=[
            RegexValidator(ROBOT_NAME, _("Use only lower-case letters, digits and hyphens."))
        ],
        help_text=_(
            "The robot's name at the other site. If a robot of this name is enabled here, "
            "this entry has no effect."
        ),
    )
    site = models.CharField(
        _("site"),
        max_length=200,
        validators=[check_site],
        help_text=_("The other site's address, such as https://robots.north.example.org."),
    )

    class Meta:
        verbose_name = _("robot at another site")
        verbose_name_plural = _("robots at other sites")
        ordering = ("name",)

    def __str__(self) -> str:
        return f"{self.name} · {self.site}"


class RobotPermit(models.Model):
    """A user whom a robot's owner invited, declared trained, or made an operator (who may stop,
    pause and message sessions).
    """

    class Privilege(models.TextChoices):
        INVITED = "invited", _("invited")
        TRAINED = "trained", _("trained")
        OPERATOR = "operator", _("operator")

    id = models.UUIDField(primary_key=True, default=uuid.uuid4, editable=False)
    robot = models.ForeignKey(
        Robot, models.CASCADE, related_name="permits", verbose_name=_("robot")
    )
    user = models.ForeignKey(
        settings.AUTH_USER_MODEL,
        models.CASCADE,
        related_name="robot_permits",
        verbose_name=_("user"),
    )
    kind = models.CharField(_("kind"), max_length=10, choices=Privilege)
    granted_at = models.DateTimeField(_("granted"), auto_now_add=True)

    class Meta:
        verbose_name = _("permit")
        verbose_name_plural = _("permits")
        constraints = [
            models.UniqueConstraint(fields=["robot", "user", "kind"], name="one_permit_of_a_kind")
        ]

    def __str__(self) -> str:
        return f"{self.user} · {self.robot} · {self.get_kind_display()}"
