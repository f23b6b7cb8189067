"""Deletes data older than settings.RETENTION_DAYS. A study's data, except for addresses, is kept as
long as the study.

Rows are deleted in parts, so that a database with years of data is not locked for long.
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
from experiments.participation.withdrawal import deletion
from robots.models import Enrolment
from sessions.models import NetworkSample, Session, Snapshot, SystemLog
from sessions.recording.batches import iter_batches

PART = 200
GUESTS_KEPT = datetime.timedelta(days=1)


@dataclass(frozen=True)
class RetentionKind:
    """A kind of data: how to count and how to delete rows older than a moment."""

    name: str
    count: Callable[[datetime.datetime], int]
    forget: Callable[[datetime.datetime], int]


def forget_all(now: datetime.datetime, *, dry_run: bool) -> Iterator[tuple[str, int]]:
    """Delete, or with `dry_run` only count, expired rows; yield (kind, number)."""
    for kind in KINDS:
        days = settings.RETENTION_DAYS[kind.name]
        if days > 0.0:
            before = now - datetime.timedelta(days=days)
            yield kind.name, kind.count(before) if dry_run else kind.forget(before)
    stale = Enrolment.objects.filter(expires_at__lt=now)
    yield "enrolments", stale.count() if dry_run else stale.delete()[0]
    yield "undecided", deletion.forget_undecided(now - GUESTS_KEPT, dry_run=dry_run)
    idle = _idle_guests(now - GUESTS_KEPT)
    yield "guests", idle.count() if dry_run else idle.delete()[1].get(User._meta.label, 0)


def empty_write_ahead_log() -> None:
    """Truncate SQLite's write-ahead log, which otherwise still has the deleted data. A long read
    transaction prevents it until the next night.
    """
    if connection.vendor == "sqlite" and not connection.in_atomic_block:
        with connection.cursor() as cursor:
            cursor.execute("PRAGMA wal_checkpoint(TRUNCATE)")


def _idle_guests(before: datetime.datetime) -> "QuerySet[User]":
    """Return old accounts without a password that are no longer needed: visitors who tried a
    simulated robot, with their drives, and participants who withdrew while they were driving, or
    never agreed to a consent.
    """
    withdrawn = Q(kind=User.Kind.PARTICIPANT, participations=None, robot_sessions=None)
    tried = Q(kind=User.Kind.VISITOR, last_login__lt=before)
    return User.objects.filter(withdrawn | tried, date_joined__lt=before)


def _of_no_study(before: datetime.datetime) -> "QuerySet[Session]":
    """Return old sessions with a closed record that belong to no study."""
    return Session.objects.filter(
        state=Session.State.ENDED, closed_at__isnull=False, ended_at__lt=before, drive=None
    )


def _rows(
    of: Callable[[datetime.datetime], "QuerySet[Any]"],
) -> tuple[Callable[[datetime.datetime], int], Callable[[datetime.datetime], int]]:
    """Return functions that count and delete the rows that `of` returns."""

    def forget(before: datetime.datetime) -> int:
        total = 0
        while keys := list(of(before).order_by().values_list("pk", flat=True)[:PART]):
            of(before).model.objects.filter(pk__in=keys).delete()
            total += len(keys)
        return total

    return lambda before: of(before).count(), forget


def _with_address(before: datetime.datetime) -> Iterator[Session]:
    """Yield old sessions that still have a network or a user agent; only `device` is read."""
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


# Sessions first: other rows are deleted with them.
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
    RetentionKind(
        "interventions",
        lambda before: audit.forget_interventions(before, dry_run=True),
        audit.forget_interventions,
    ),
)
