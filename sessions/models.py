"""Sessions and their records: who drove which robot when, how it ended, and what happened."""

import datetime
import json
import uuid
from typing import Any

import msgspec
from django.conf import settings
from django.db import models
from django.utils import timezone
from django.utils.translation import gettext_lazy as _

from accounts.models import User
from robots.models import Robot


class Session(models.Model):
    """One visitor at one robot, from joining the queue to the outcome."""

    class State(models.TextChoices):
        """The state of the session."""

        WAITING = "waiting", _("waiting")
        CONNECTING = "connecting", _("connecting")
        DRIVING = "driving", _("driving")
        RECONNECTING = "reconnecting", _("reconnecting")
        ENDED = "ended", _("ended")

    class Outcome(models.TextChoices):
        """The result of a session; the first four are the paper's."""

        COMPLETED = "completed", _("completed")
        TIMED_OUT = "timed_out", _("timed out")
        CONNECTION_REFUSED = "connection_refused", _("connection refused")
        CANCELLED = "cancelled", _("cancelled")
        STOPPED_BY_OPERATOR = "stopped_by_operator", _("stopped by operator")
        ROBOT_FAULT = "robot_fault", _("robot fault")
        CONNECTION_LOST = "connection_lost", _("connection lost")

    id = models.UUIDField(primary_key=True, default=uuid.uuid4, editable=False)
    robot = models.ForeignKey(
        Robot, models.PROTECT, related_name="sessions", verbose_name=_("robot")
    )
    visitor = models.ForeignKey(
        settings.AUTH_USER_MODEL,
        models.CASCADE,
        related_name="robot_sessions",
        verbose_name=_("visitor"),
    )
    state = models.CharField(
        _("state"), max_length=12, choices=State, default=State.WAITING, db_index=True
    )
    outcome = models.CharField(
        _("outcome"), max_length=20, choices=Outcome, blank=True, db_index=True
    )
    outcome_reason = models.CharField(_("reason"), max_length=300, blank=True)
    # "<robot>:<visitor>" while the session lives and its own id afterwards: unique on every
    # database without partial indexes.
    live_key = models.CharField(max_length=80, unique=True, editable=False)
    queued_at = models.DateTimeField(_("queued"))
    offered_at = models.DateTimeField(_("turn offered"), null=True, blank=True)
    granted_at = models.DateTimeField(_("granted"), null=True, blank=True)
    driving_at = models.DateTimeField(_("first connected"), null=True, blank=True)
    first_motion_at = models.DateTimeField(_("first motion"), null=True, blank=True)
    lost_at = models.DateTimeField(_("connection lost"), null=True, blank=True)
    turn_ends_at = models.DateTimeField(_("turn ends"), null=True, blank=True)
    ended_at = models.DateTimeField(_("ended"), null=True, blank=True)
    # Refreshed while a page's WebSocket is open, None once it is closed: distinguishes a reload
    # from a second tab.
    seen_at = models.DateTimeField(_("page last seen"), null=True, blank=True)
    # When the record was complete, or its missing states were given up: `summary` is then final
    # (sessions/recording/summary.py).
    closed_at = models.DateTimeField(_("record closed"), null=True, blank=True, db_index=True)
    device = models.JSONField(_("device"), default=dict, blank=True)
    # The visitor's choice while driving; empty: the robot's level. States have the level in force.
    assist = models.CharField(_("assistance"), max_length=5, blank=True, choices=Robot.DriveAssist)
    # Fixed by an app above this one when the robot was first granted (sessions/leases/terms.py);
    # empty: none.
    terms = models.JSONField(_("terms"), default=dict, blank=True, editable=False)
    summary = models.JSONField(_("summary"), default=dict, blank=True, editable=False)

    class Meta:
        verbose_name = _("session")
        verbose_name_plural = _("sessions")
        ordering = ("-queued_at",)
        indexes = [models.Index(fields=["robot", "state", "queued_at"], name="session_queue")]

    def __str__(self) -> str:
        return f"{self.robot} · {self.queued_at:%Y-%m-%d %H:%M}"

    @property
    def minutes(self) -> float | None:
        """How long the visitor has driven; None if they never did."""
        if self.driving_at is None:
            return None
        return ((self.ended_at or timezone.now()) - self.driving_at).total_seconds() / 60.0

    @classmethod
    def assistance_to_begin_with(cls, robot: Robot, visitor: User) -> str:
        """Return the assistance of a visitor who has not chosen any in their session, on a robot
        whose own level is off although it can assist: the visitor's last level, and in a first
        drive one that stops at obstacles. Empty for the robot's own level.
        """
        can_assist = "assist" in (robot.presence.factsheet or {}).get("capabilities", ())
        if robot.assist != Robot.DriveAssist.OFF or not can_assist:
            return ""
        drives = cls.objects.filter(visitor=visitor, first_motion_at__isnull=False)
        of_drives = drives.exclude(assist="").order_by("first_motion_at")
        last = of_drives.values_list("assist", flat=True).last()
        return last or ("" if drives.exists() else Robot.DriveAssist.SLOW)


# States of a session that has the robot, connected or not.
HOLDING_STATES = (Session.State.CONNECTING, Session.State.DRIVING, Session.State.RECONNECTING)


class Lease(models.Model):
    """The driver of a robot: one row per robot, changed only by comparing and setting its epoch."""

    robot = models.OneToOneField(
        Robot, models.CASCADE, primary_key=True, related_name="lease", verbose_name=_("robot")
    )
    epoch = models.BigIntegerField(default=0)
    session = models.ForeignKey(
        Session,
        models.SET_NULL,
        null=True,
        blank=True,
        related_name="leases",
        verbose_name=_("session"),
    )
    peer = models.CharField(max_length=64, blank=True)
    # The page of the hidden operator, in a session of such terms; empty while none drives. Its
    # epoch grows with every change of the page and is never reset.
    wizard_peer = models.CharField(max_length=64, blank=True, default="")
    wizard_epoch = models.BigIntegerField(default=0)
    wizard = models.ForeignKey(
        settings.AUTH_USER_MODEL, models.SET_NULL, null=True, blank=True, related_name="+"
    )
    renewal = models.BigIntegerField(default=0)
    changed_at = models.DateTimeField(_("changed"))

    class Meta:
        verbose_name = _("lease")
        verbose_name_plural = _("leases")

    def __str__(self) -> str:
        return f"{self.robot_id} · {self.epoch}"


class FastJson(json.JSONEncoder):
    """Encodes JSON ten times as fast as Python's own encoder, which matters only for states."""

    def encode(self, o: Any) -> str:
        """Return a value as JSON; like Python's, but NaN becomes null."""
        return msgspec.json.encode(o).decode()


class StateChunk(models.Model):
    """About a second of a session's states, as the robot sent them.

    `states` holds the JSON of robots.api.messages.State, in order of seq; `received_at` and
    `clock_offset` (robot's clock minus the server's, in seconds) are the recorder's own.
    """

    id = models.UUIDField(primary_key=True, default=uuid.uuid4, editable=False)
    session = models.ForeignKey(Session, models.CASCADE, related_name="chunks")
    boot = models.CharField(max_length=64)
    first_seq = models.BigIntegerField()
    last_seq = models.BigIntegerField()
    count = models.PositiveIntegerField()
    first_stamp = models.FloatField()
    last_stamp = models.FloatField()
    received_at = models.FloatField()
    clock_offset = models.FloatField(null=True)
    states = models.JSONField(encoder=FastJson)

    class Meta:
        verbose_name = _("states")
        verbose_name_plural = _("states")
        constraints = [
            models.UniqueConstraint(fields=["session", "boot", "first_seq"], name="states_once")
        ]
        # Live views poll the newest row of a drive.
        indexes = [
            models.Index(fields=["session", "received_at", "first_seq"], name="states_in_order")
        ]

    def __str__(self) -> str:
        return f"{self.session_id} · {self.boot} · {self.first_seq}-{self.last_seq}"


class SessionEvent(models.Model):
    """An event reported by robot, page or laboratory, or decided by the session manager."""

    class Source(models.TextChoices):
        """The origin of the event."""

        ROBOT = "robot", _("robot")
        PAGE = "page", _("page")
        SERVER = "server", _("server")
        LAB = "lab", _("laboratory")

    id = models.UUIDField(primary_key=True, default=uuid.uuid4, editable=False)
    session = models.ForeignKey(
        Session, models.CASCADE, related_name="events", verbose_name=_("session")
    )
    source = models.CharField(_("source"), max_length=8, choices=Source)
    type = models.CharField(_("type"), max_length=40, db_index=True)
    stamp = models.FloatField(_("timestamp"))
    received_at = models.FloatField(_("received"))
    data = models.JSONField(_("data"), default=dict)

    class Meta:
        verbose_name = _("event")
        verbose_name_plural = _("events")
        ordering = ("received_at",)

    def __str__(self) -> str:
        return f"{self.type} · {self.stamp:.3f}"

    @classmethod
    def of_server(
        cls, session: str, kind: str, now: datetime.datetime, data: dict[str, Any]
    ) -> "SessionEvent":
        """Return an event that the server decides, not stored yet."""
        stamp = now.timestamp()
        return cls(
            session_id=session,
            source=cls.Source.SERVER,
            type=kind,
            stamp=stamp,
            received_at=stamp,
            data=data,
        )

    @classmethod
    def server_events(cls, session: Any, *kinds: str) -> "models.QuerySet[SessionEvent]":
        """Return the events of these kinds that the server has decided."""
        return cls.objects.filter(session=session, source=cls.Source.SERVER, type__in=kinds)


class NetworkSample(models.Model):
    """One second of the visitor's connection, from the page's getStats()."""

    id = models.UUIDField(primary_key=True, default=uuid.uuid4, editable=False)
    session = models.ForeignKey(
        Session, models.CASCADE, related_name="network_samples", verbose_name=_("session")
    )
    stamp = models.FloatField(_("timestamp"))
    received_at = models.FloatField(_("received"))
    data = models.JSONField(_("data"))

    class Meta:
        verbose_name = _("network sample")
        verbose_name_plural = _("network samples")
        ordering = ("received_at",)

    def __str__(self) -> str:
        return f"{self.session_id} · {self.stamp:.1f}"


class Snapshot(models.Model):
    """A photo that the visitor took with the robot's camera."""

    id = models.UUIDField(primary_key=True, default=uuid.uuid4, editable=False)
    session = models.ForeignKey(
        Session, models.CASCADE, related_name="snapshots", verbose_name=_("session")
    )
    action_id = models.CharField(max_length=64)
    stamp = models.FloatField(_("timestamp"))
    sha256 = models.CharField(max_length=64)
    jpeg = models.BinaryField()

    class Meta:
        verbose_name = _("photo")
        verbose_name_plural = _("photos")
        constraints = [
            models.UniqueConstraint(fields=["session", "action_id"], name="snapshot_once")
        ]

    def __str__(self) -> str:
        return f"{self.session_id} · {self.action_id}"


class SystemLog(models.Model):
    """An entry of the system log, the paper's fourth collection: an event name with fields."""

    class Severity(models.TextChoices):
        """The level of the entry."""

        INFO = "info", _("info")
        WARNING = "warning", _("warning")
        ERROR = "error", _("error")

    id = models.UUIDField(primary_key=True, default=uuid.uuid4, editable=False)
    at = models.DateTimeField(_("time"), db_index=True)
    level = models.CharField(_("level"), max_length=8, choices=Severity, default=Severity.INFO)
    event = models.CharField(_("event"), max_length=60, db_index=True)
    robot = models.ForeignKey(
        Robot, models.CASCADE, null=True, blank=True, related_name="+", verbose_name=_("robot")
    )
    session = models.ForeignKey(
        Session, models.CASCADE, null=True, blank=True, related_name="+", verbose_name=_("session")
    )
    fields = models.JSONField(_("fields"), default=dict)

    class Meta:
        verbose_name = _("system log entry")
        verbose_name_plural = _("system log")
        ordering = ("-at",)

    def __str__(self) -> str:
        return self.event


class ApiKey(models.Model):
    """A key for programs to use one robot (sessions/api/views.py); only its hash is stored."""

    id = models.UUIDField(primary_key=True, default=uuid.uuid4, editable=False)
    robot = models.ForeignKey(
        Robot, models.CASCADE, related_name="api_keys", verbose_name=_("robot")
    )
    label = models.CharField(_("label"), max_length=60)
    token_hash = models.CharField(max_length=200, editable=False)
    made_at = models.DateTimeField(_("created"))
    last_used_at = models.DateTimeField(_("last used"), null=True, editable=False)

    class Meta:
        verbose_name = _("API key")
        verbose_name_plural = _("API keys")
        constraints = [
            models.UniqueConstraint(fields=["robot", "label"], name="one_api_key_of_a_label")
        ]

    def __str__(self) -> str:
        return f"{self.robot} · {self.label}"


# After this long without a heartbeat in its row, a session manager counts as silent.
STALE_SECONDS = 4.0


class ManagerBeat(models.Model):
    """The slot of a running session manager, which counts as dead when `beats` does not grow.
    `beat_at` is only shown, because clocks of two computers cannot be compared.
    """

    name = models.CharField(primary_key=True, max_length=20, default="session_manager")
    holder = models.CharField(max_length=64, blank=True)
    beat_at = models.DateTimeField()
    beats = models.BigIntegerField(default=0, editable=False)
    report = models.JSONField(default=dict, blank=True, editable=False)

    class Meta:
        verbose_name = _("session manager")
        verbose_name_plural = _("session manager")

    def __str__(self) -> str:
        return self.holder


class Maintenance(models.Model):
    """The site's maintenance, while it is announced or under way: no session begins, and those in
    progress end at `starts_at`.
    """

    name = models.CharField(primary_key=True, max_length=20, default="maintenance")
    starts_at = models.DateTimeField()

    class Meta:
        verbose_name = _("maintenance")
        verbose_name_plural = _("maintenance")

    def __str__(self) -> str:
        return f"{self.starts_at:%Y-%m-%d %H:%M}"


class Shard(models.Model):
    """A share of the robots, by the hash of their names: `owner` serves them, under an epoch that
    grows whenever the shard changes hands (sessions/shards/ownership.py).
    """

    id = models.UUIDField(primary_key=True, default=uuid.uuid4, editable=False)
    number = models.PositiveSmallIntegerField(unique=True)
    owner = models.CharField(max_length=64, blank=True)
    epoch = models.BigIntegerField(default=0)

    class Meta:
        verbose_name = _("shard")
        verbose_name_plural = _("shards")

    def __str__(self) -> str:
        return f"{self.number} · {self.epoch} · {self.owner}"
