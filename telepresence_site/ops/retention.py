"""What is forgotten when: by kind, as settings.RETENTION_DAYS says. What belongs to a study is kept
as long as the study; its addresses are not.

Every kind is a question for rows that are old enough and what becomes of them, a part at a time, so
that a database with years in it is not locked for long.
"""

import datetime
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

from django.conf import settings
from django.db import connection
from django.db.models import Q, QuerySet

from accounts import audit
from accounts.models import User
from experiments.extraction.pseudonyms import Pseudonyms
from experiments.models import Drive
from robots.models import Enrolment
from sessions.models import NetworkSample, Session, Snapshot, SystemLog
from sessions.recording.batches import iter_batches

PART = 200
GUESTS_KEPT = datetime.timedelta(days=1)


@dataclass(frozen=True)
class RetentionKind:
    """Something that is kept for so many days: how to count, and how to forget, what is older than
    a moment.
    """

    name: str
    count: Callable[[datetime.datetime], int]
    forget: Callable[[datetime.datetime], int]


def forget_all(now: datetime.datetime, *, dry_run: bool) -> Iterator[tuple[str, int]]:
    """Yield (kind, how many) for every kind that is not kept for ever, after forgetting them or,
    dry, only counting.
    """
    for kind in KINDS:
        days = settings.RETENTION_DAYS[kind.name]
        if days > 0.0:
            before = now - datetime.timedelta(days=days)
            yield kind.name, kind.count(before) if dry_run else kind.forget(before)
    stale = Enrolment.objects.filter(expires_at__lt=now)
    yield "enrolments", stale.count() if dry_run else stale.delete()[0]
    idle = _idle_guests(now - GUESTS_KEPT)
    yield "guests", idle.count() if dry_run else idle.delete()[1].get(User._meta.label, 0)


def empty_write_ahead_log() -> None:
    """Move what SQLite has in its write-ahead log into the database and cut the log to nothing:
    until then it holds what was deleted since. Where somebody reads for too long, the next night
    does it.
    """
    if connection.vendor == "sqlite" and not connection.in_atomic_block:
        with connection.cursor() as cursor:
            cursor.execute("PRAGMA wal_checkpoint(TRUNCATE)")


def _idle_guests(before: datetime.datetime) -> "QuerySet[User]":
    """Return accounts without a password that were made so long ago and are good for nothing any
    more: visitors who tried a simulated robot, whose drives go with them, and participants who
    withdrew while they were driving.
    """
    withdrawn = Q(kind=User.Kind.PARTICIPANT, participations=None, robot_sessions=None)
    tried = Q(kind=User.Kind.VISITOR, last_login__lt=before)
    return User.objects.filter(withdrawn | tried, date_joined__lt=before)


def _of_no_study(before: datetime.datetime) -> "QuerySet[Session]":
    """Return sessions whose record is closed, that ended so long ago, and that are no study's."""
    return Session.objects.filter(
        state=Session.State.ENDED, closed_at__isnull=False, ended_at__lt=before, drive=None
    )


def _rows(
    of: Callable[[datetime.datetime], "QuerySet[Any]"],
) -> tuple[Callable[[datetime.datetime], int], Callable[[datetime.datetime], int]]:
    """Return how to count and how to delete what `of` finds."""

    def forget(before: datetime.datetime) -> int:
        total = 0
        while keys := list(of(before).order_by().values_list("pk", flat=True)[:PART]):
            of(before).model.objects.filter(pk__in=keys).delete()
            total += len(keys)
        return total

    return lambda before: of(before).count(), forget


# --- addresses ------------------------------------------------------------------------------------


def _with_address(before: datetime.datetime) -> Iterator[Session]:
    """Yield sessions that still tell a network or a user agent; only these two columns are read."""
    rows = (
        Session.objects.filter(state=Session.State.ENDED, ended_at__lt=before)
        .exclude(device={})
        .only("device")
        .order_by("pk")
    )
    for row in iter_batches(rows, PART):
        if row.device.get("user_agent") or "/" in row.device.get("network", ""):
            yield row


def _forget_addresses(before: datetime.datetime) -> int:
    secrets: dict[Any, str] = dict(
        Drive.objects.values_list("session_id", "participant__study__secret")
    )
    total = 0
    for row in _with_address(before):
        secret = secrets.get(row.pk)
        network = Pseudonyms(secret).network(row.device.get("network", "")) if secret else ""
        Session.objects.filter(pk=row.pk).update(
            device=row.device | {"network": network, "user_agent": ""}
        )
        total += 1
    return total


# In this order: what goes with its session need not be forgotten before.
KINDS = (
    RetentionKind("sessions", *_rows(_of_no_study)),
    RetentionKind(
        "photos", *_rows(lambda before: Snapshot.objects.filter(session__in=_of_no_study(before)))
    ),
    RetentionKind(
        "network_samples",
        *_rows(lambda before: NetworkSample.objects.filter(session__in=_of_no_study(before))),
    ),
    RetentionKind(
        "addresses", lambda before: sum(1 for _ in _with_address(before)), _forget_addresses
    ),
    RetentionKind("system_log", *_rows(lambda before: SystemLog.objects.filter(at__lt=before))),
    RetentionKind("audit_log", lambda before: audit.forget(before, dry_run=True), audit.forget),
)
