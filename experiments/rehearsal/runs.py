"""The rows of rehearsals: one at a time for a study, run by the process that takes it, on any
computer.

The pages and the process share only the row. The process signs it every few seconds; a row that
was not signed for a while has lost its process, and the next one replaces it. To end a rehearsal, a
page changes its row; the process notices this when it signs.
"""

import datetime
from dataclasses import asdict
from typing import Any
from uuid import UUID

from django.db import IntegrityError, transaction
from django.utils import timezone

from experiments.models import Rehearsal, Study
from experiments.rehearsal.report import RehearsalReport

SILENT = datetime.timedelta(seconds=30)  # without a signature: the process is gone
NOT_TAKEN = datetime.timedelta(seconds=15)  # waiting for longer: no process seems to take it
Status = Rehearsal.Status
LIVE = (Status.WAITING, Status.RUNNING)
LOST = "Its process ended without giving a reason, or its computer was restarted."


class AlreadyRehearsedError(RuntimeError):
    """The study is being rehearsed."""


def is_lost(row: Rehearsal, now: datetime.datetime) -> bool:
    return row.status == Status.RUNNING and row.seen_at is not None and row.seen_at < now - SILENT


def is_live(row: Rehearsal, now: datetime.datetime) -> bool:
    return row.status in LIVE and not is_lost(row, now)


def latest(study: Study) -> Rehearsal | None:
    return Rehearsal.objects.filter(study=study).select_related("ended_by").first()


def request(study: Study, now: datetime.datetime) -> Rehearsal:
    """Ask for a rehearsal of a study; an AlreadyRehearsedError when one waits or runs. Of
    simultaneous requests, one succeeds.
    """
    for row in Rehearsal.objects.filter(live_key=str(study.pk)):
        if is_lost(row, now):
            fail(row.pk, LOST)
    try:
        with transaction.atomic():
            fields = {"study": study, "sha256": study.sha256, "live_key": str(study.pk)}
            return Rehearsal.objects.create(began_at=now, **fields)
    except IntegrityError:
        raise AlreadyRehearsedError from None


def take(row: Rehearsal, host: str, now: datetime.datetime) -> bool:
    """Begin a rehearsal that waits; False when another process was first."""
    waiting = Rehearsal.objects.filter(pk=row.pk, status=Status.WAITING)
    return bool(waiting.update(status=Status.RUNNING, host=host, began_at=now, seen_at=now))


def take_next(host: str, now: datetime.datetime) -> Rehearsal | None:
    waiting = Rehearsal.objects.filter(status=Status.WAITING).select_related("study")
    return next((row for row in waiting.order_by("began_at") if take(row, host, now)), None)


def begin(study: Study, host: str, now: datetime.datetime) -> Rehearsal:
    """Begin a rehearsal, or the one that waits; an AlreadyRehearsedError when one runs."""
    key = str(study.pk)
    row = Rehearsal.objects.filter(live_key=key, status=Status.WAITING).first()
    row = row or request(study, now)
    if not take(row, host, now):
        raise AlreadyRehearsedError
    return row


def sign(key: UUID, now: datetime.datetime, **changes: Any) -> bool:
    """Note that the process of a rehearsal lives, and how far it is; False when it is to end."""
    running = Rehearsal.objects.filter(pk=key, status=Status.RUNNING)
    return bool(running.update(seen_at=now, **changes))


def finish(key: UUID, report: RehearsalReport) -> bool:
    """Keep what was found; False when the rehearsal was ended before."""
    return _end(key, Status.DONE, report=asdict(report), passed=report.passed)


def fail(key: UUID, reason: str) -> bool:
    report = {"problems": [reason], "passed": False}
    return _end(key, Status.FAILED, report=report, reason=reason)


def stop(key: UUID, user: Any) -> bool:
    return _end(key, Status.STOPPED, ended_by=user)


def _end(key: UUID, status: str, **changes: Any) -> bool:
    living, now = Rehearsal.objects.filter(pk=key, status__in=LIVE), timezone.now()
    return bool(living.update(status=status, finished_at=now, live_key=str(key), **changes))
