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
from django.utils.translation import get_language
from django.utils.translation import gettext_lazy as _

from robots.api import floorplan
from robots.api.idle import ONLINE_SECONDS
from robots.api.messages import FloorPlanUpdate
from robots.api.topics import RESERVED_NAMES, ROBOT_NAME

TITLE_LENGTH = 80
LANGUAGE = re.compile(r"[a-z]{2,3}(-[a-z0-9]{2,8})*")


def refuse_reserved_name(name: str) -> None:
    """Raise ValidationError for a name that the topic tree uses itself."""
    if name in RESERVED_NAMES:
        raise ValidationError(
            _("“%(name)s” is reserved. Choose another name."), params={"name": name}
        )


def check_translations(value: Any) -> None:
    """Raise ValidationError for translations of a robot that are not {language: {"title": …,
    "description": …}}, either left out.
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
            _(
                "Enter translations like this: "
                "{“es”: {“title”: “…”, “description”: “…”}}, with straight quotes."
            )
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
    """A site as it is stored: the occupancy map of ROS map_server, and in `plan` what
    robots.api.floorplan.FloorPlan is the file and wire form of.
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
        """Return what tells a robot its map; retained on its `floorplan` topic."""
        return FloorPlanUpdate(
            map_id=self.name,
            sha256=self.sha256,
            resolution=self.resolution,
            origin=(self.origin_x, self.origin_y, self.origin_theta),
            negate=self.negate,
            occupied_thresh=self.occupied_thresh,
            free_thresh=self.free_thresh,
            image=base64.b64encode(bytes(self.image)).decode(),
            # Robots go by names; one whose agent is older refuses a plan with fields that it does
            # not know.
            plan={name: part for name, part in self.plan.items() if name != "translations"} or None,
        )

    def plan_in(self, language: str) -> dict[str, Any]:
        """Return the plan with its titles in a language; {} when there is none."""
        return floorplan.in_language(self.plan or {}, language)

    @property
    def shown_title(self) -> str:
        """Return the title in the language of the page that is being made."""
        words = floorplan.in_language(
            {"title": self.title, "translations": (self.plan or {}).get("translations", {})},
            get_language() or "",
        )
        return str(words["title"])


class WithPresence(models.Manager["Robot"]):
    """Robots joined with their presence, which nearly all that read a robot need."""

    def get_queryset(self) -> "models.QuerySet[Robot]":
        """Join the presence."""
        return super().get_queryset().select_related("presence")


class Robot(models.Model):
    """A telepresence robot as its owner set it up; each also has a RobotPresence and
    RobotCredentials, which other processes write.
    """

    class Access(models.TextChoices):
        """Who may drive."""

        OPEN = "open", _("open to all logged-in users")
        INVITATION = "invitation", _("by invitation")
        TRAINED = "trained", _("for trained users")

    class DriveAssist(models.TextChoices):
        """How much the robot assists the driver: robots.api.messages.AssistLevel."""

        OFF = "off", _("off")
        SLOW = "slow", _("slows down and stops at obstacles")
        STEER = "steer", _("steers around obstacles and through doors")

    class Calls(models.TextChoices):
        """Whether the people at the robot are asked before they see and hear a visitor:
        robots.api.messages.Config.
        """

        ACCEPT = "accept", _("start immediately")
        ASK = "ask", _("somebody at the screen must accept")

    class Turnaround(models.TextChoices):
        """Where the robot stands between two visits (sessions/leases/readiness.py)."""

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
    # A disabled robot cannot even connect, so that it could never be tried before visitors come.
    # One that is added in the administration begins hidden; those that programs make (demo,
    # practice, rehearsals) are meant to be driven at once.
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
        help_text=_("The start page says so, and offers other robots first."),
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
        help_text=_(
            "The software that connects the agent to the robot. New credentials "
            "files include its name."
        ),
    )
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
    # A simulated one for visitors who wait (telepresence_site/practice): on no list, and no
    # study's.
    practice = models.BooleanField(default=False, editable=False)
    # When a page last asked for a practice robot, whichever it gets; the same of all of them.
    wanted_at = models.DateTimeField(null=True, editable=False)
    charge_limit = models.FloatField(
        _("minimum charge for a visit (0-1)"),
        default=0.2,
        validators=[MinValueValidator(0.0), MaxValueValidator(1.0)],
    )
    # Set and removed by hand. Until it is removed, no visitor gets the robot, and the queue waits
    # (sessions/leases/store.py).
    held = models.CharField(_("queue pause reason"), max_length=200, blank=True, editable=False)

    calls = models.CharField(
        _("calls"),
        max_length=6,
        choices=Calls,
        default=Calls.ACCEPT,
        help_text=_("Applies when a visitor turns on the microphone or camera."),
    )
    # a user's key and permits here, of a robot that robots.access.know_permits has looked at
    known_permits: tuple[Any, frozenset[str]] | None = None

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
        """Return what visitors call the robot in a language, or the title as it is."""
        return self._words_in(language).get("title") or self.title or self.name

    @property
    def titles(self) -> dict[str, str]:
        """Return the titles in other languages, by language."""
        return {
            language: words["title"]
            for language, words in (self.translations or {}).items()
            if words.get("title")
        }

    @property
    def shown_title(self) -> str:
        """Return the title in the language of the page that is being made."""
        return self.title_in(get_language() or "")

    @property
    def shown_description(self) -> str:
        """Return the description in the language of the page that is being made."""
        return self._words_in(get_language() or "").get("description") or self.description

    def _words_in(self, language: str) -> Mapping[str, str]:
        return floorplan.translation(self.translations or {}, language)

    def doors_in(self, language: str) -> list[dict[str, Any]]:
        """Return the doors of its site: name, title, and the state that the server has set or the
        plan has.
        """
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
        """Tell whether it is meant to go home after a visit, and says that it can dock."""
        capabilities = (self.presence.factsheet or {}).get("capabilities", ())
        return self.returns_home and "dock" in capabilities

    def is_online(self, now: datetime.datetime) -> bool:
        """Tell whether the robot is connected and has sent a message recently: an idle one sends
        none for half a minute (robots/api/idle.py).
        """
        seen_at = self.presence.last_seen_at
        is_recent = seen_at is not None and (now - seen_at).total_seconds() < ONLINE_SECONDS
        return self.enabled and self.presence.connection == "ONLINE" and is_recent


class RobotPresence(models.Model):
    """What a robot last reported, and what it does between two visits. The session manager writes
    it every few seconds, in a row of its own so that these writes and the owner's edits of the
    robot never overwrite each other.
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
    # The same token's hash for a broker that reads no other kind; empty until the token is shown
    # to us again, for one that was made before there was this field.
    bcrypt_hash = models.CharField(max_length=100, blank=True, editable=False)
    credential_made_at = models.DateTimeField(_("credentials created"), null=True, editable=False)

    # The user that the hash belongs to at the broker; empty: the robot's own name. A new one a
    # rotation (robots/enrol/credentials.py).
    credential_user = models.CharField(max_length=80, blank=True, editable=False)
    # The credentials before these hold until then, so that a robot can take the new ones while it
    # runs.
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
    """A one-time token by which a robot's computer fetches the robot's credentials
    (robots/enrol/tokens.py); only its hash is kept.
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
    """A robot that another site of the same house serves (robots/enrol/elsewhere.py)."""

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
    """A user whom a robot's owner invited, or declared trained, or made an operator (may stop,
    pause and message sessions).
    """

    class Privilege(models.TextChoices):
        """What the user may do."""

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
