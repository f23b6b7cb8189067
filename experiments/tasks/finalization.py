"""The final results of a drive, computed from its complete record alone: each time the same.

When the record of a session is closed, all records of the task are folded again: events, result and
outcome are written again, what was in force is compared with what was assigned, and the
participant's place in the cell is filled, freed or given to another. A late record opens the
session's record again; then all of this is repeated.

The session manager does it beside its other work, a little in each tick (`Finalizer`), so that no
lease waits for a long record.
"""

import time
from collections.abc import Iterator
from datetime import UTC, datetime
from typing import Any

import msgspec
import structlog
from django.db import transaction
from django.db.models import F, Q

from experiments.analysis.metrics.definitions import VERSION as METRICS_VERSION
from experiments.definition import conditions
from experiments.definition.schema import Condition
from experiments.models import Drive, Participant, TaskEvent
from experiments.participation import assignment
from experiments.tasks.engine import TaskEngine
from experiments.tasks.manipulation_check import ManipulationCheck, as_stored
from experiments.tasks.records import FirstFrame
from experiments.tasks.stored_records import TASK, ended, offset_of, rows_with_records, track_of
from sessions.models import Session

log = structlog.stdlib.get_logger(__name__)

SHARE_SECONDS = 0.05  # of a tick of the session manager
ROWS_AT_ONCE = 50
Stage = Participant.Stage


def due() -> Any:
    """Return the drives whose record was closed after they were last settled, the oldest first."""
    is_due = Q(settled_at=None) | Q(settled_at__lt=F("session__closed_at"))
    return Drive.objects.filter(is_due, session__closed_at__isnull=False).order_by("granted_at")


def settle(drive: Drive, now: datetime) -> None:
    for _ in _finalize_in_steps(drive, now):
        pass


class Finalizer:
    def __init__(self) -> None:
        self._work: Iterator[None] | None = None
        self._refused: set[object] = set()

    def tick(self, now: datetime, share: float = SHARE_SECONDS) -> None:
        """Continue for about `share` seconds, and for one step at least."""
        until = time.monotonic() + share
        while (work := self._work or self._next(now)) is not None:
            self._work = None  # an error ends this attempt, and the drive is begun again
            if next(work, self) is None:
                self._work = work
            if time.monotonic() >= until:
                return

    def _next(self, now: datetime) -> Iterator[None] | None:
        rows = due().select_related("participant__study", "session__robot__floor_plan")
        drive = rows.exclude(pk__in=self._refused).first()
        return self._unless_refused(drive, now) if drive is not None else None

    def _unless_refused(self, drive: Drive, now: datetime) -> Iterator[None]:
        try:
            yield from _finalize_in_steps(drive, now)
        except msgspec.ValidationError:
            self._refused.add(drive.pk)
            log.exception("drive_not_finalized", session=drive.session_id)


def record_end(drive: Drive) -> None:
    """Store how a session has ended, until its whole record is settled."""
    session, at_end = drive.session, ended(drive.session)
    outcome = str(drive.shown.get("outcome") or "")
    if not outcome:
        outcome = session.outcome
        if at_end is not None and track_of(drive) is not None:
            outcome = at_end.outcome
    moved = session.first_motion_at is not None
    Drive.objects.filter(pk=drive.pk, settled_at=None).update(outcome=outcome, moved=moved)


def note_exposure(drive: Drive, at: float | None) -> None:
    """Store when a participant first saw the robot's video in a living drive: `at` in Unix seconds,
    None when they have not.
    """
    if at is not None and drive.exposed_at is None:
        drive.exposed_at = datetime.fromtimestamp(at, UTC)
        Drive.objects.filter(pk=drive.pk, exposed_at=None).update(exposed_at=drive.exposed_at)


def _finalize_in_steps(drive: Drive, now: datetime) -> Iterator[None]:
    """Settle a drive, and yield between two steps."""
    track, check = track_of(drive), ManipulationCheck(drive)
    engine = TaskEngine(track) if track is not None else None
    frames = []
    for number, (row, record) in enumerate(rows_with_records(drive, offset_of(drive))):
        check.take(row)
        if isinstance(record, FirstFrame):
            frames.append(record.at)
        if engine is not None and record is not None:
            engine.feed(record)
        if number % ROWS_AT_ONCE == 0:
            if engine is not None:
                _ = engine.progress  # folds these records now instead of all of them at the end
            yield
    if engine is not None:
        end(engine, drive.session)
    yield
    _write(drive, engine, check, min(frames, default=None), now)


def end(engine: TaskEngine, session: Session) -> None:
    """Feed the end of a session into an engine that has its whole record."""
    at_end = ended(session)
    if at_end is None:
        return
    engine.advance(at_end.at)
    # A session that the task has ended, the task ends again: by the clock of its states perhaps a
    # moment later than by the server's.
    if session.outcome_reason != TASK or engine.progress.outcome is None:
        engine.feed(at_end)


def _write(
    drive: Drive,
    engine: TaskEngine | None,
    check: ManipulationCheck,
    first_frame: float | None,
    now: datetime,
) -> None:
    session, applied = drive.session, check.result()
    _write_events(drive, engine)
    began_with, ended_with = check.ends()
    outcome = engine.progress.outcome if engine is not None else None
    Drive.objects.filter(pk=drive.pk).update(
        outcome=outcome or session.outcome,
        exposed_at=_exposed_at(drive, first_frame, moved=check.moved),
        moved=check.moved,
        versions=drive.versions | {"metrics": str(METRICS_VERSION)},
        applied=as_stored(applied),
        clock_offset=offset_of(drive),
        began_with=began_with,
        ended_with=ended_with,
        mismatches=_mismatches(drive, applied) if check.moved else [],
        result=msgspec.to_builtins(engine.result) if engine is not None else {},
    )
    drive.refresh_from_db()
    settle_place(drive)
    # last, so that an interrupted run is repeated
    settled_at = max(now, session.closed_at or now)
    Drive.objects.filter(pk=drive.pk).update(settled_at=settled_at)
    about = {"outcome": drive.outcome, "moved": drive.moved, "mismatches": drive.mismatches}
    is_exposed = drive.exposed_at is not None
    log.info("drive_settled", session=drive.session_id, exposed=is_exposed, **about)


def _exposed_at(drive: Drive, first_frame: float | None, *, moved: bool) -> datetime | None:
    if first_frame is not None:
        return datetime.fromtimestamp(first_frame, UTC)
    return (drive.session.first_motion_at or drive.granted_at) if moved else None


def _mismatches(drive: Drive, applied: conditions.Applied) -> list[str]:
    if (assigned := drive.assigned.get("condition")) is not None:
        condition = msgspec.convert(assigned, Condition)
    elif (condition := drive.participant.study.as_definition().condition(drive.condition)) is None:
        return []
    by_wizard = drive.assigned.get("terms", {}).get("driver") == "wizard"
    return list(conditions.mismatches(condition, applied, by_wizard=by_wizard))


def _write_events(drive: Drive, engine: TaskEngine | None) -> None:
    rows = [
        TaskEvent(drive=drive, number=number, stamp=event.at, type=event.type, data=event.data())
        for number, event in enumerate(engine.events if engine is not None else ())
    ]
    # without transactions, an interrupted run is repeated, because the drive is not settled yet
    with transaction.atomic():
        TaskEvent.objects.filter(drive=drive).delete()
        TaskEvent.objects.bulk_create(rows)


def settle_place(drive: Drive) -> None:
    """Fill, free or pass on the place of a participant whose drive is over. Only the video of the
    task exposes them, and fills it; that of practice tells them their condition, so that it is
    never freed.
    """
    participant = Participant.objects.select_related("study").get(pk=drive.participant_id)
    seen = {"exposed_at__isnull": False}
    exposed = participant.task_drives.filter(**seen).order_by("granted_at").first()
    if exposed is not None:
        is_filled_again = participant.stage == Stage.FILLED and drive.visit == exposed.visit
        if participant.stage in {Stage.UNDER_WAY, Stage.FREED} or is_filled_again:
            _move(participant, _stage_after(drive, participant))
    elif (
        participant.stage == Stage.UNDER_WAY
        and not participant.study.as_definition().reveals_condition
        and not participant.drives.filter(**seen).exists()
        and not participant.drives.filter(settled_at=None).exclude(pk=drive.pk).exists()
    ):
        _move(participant, Stage.FREED)


def _stage_after(drive: Drive, participant: Participant) -> str:
    """Return the stage of the place of an exposed participant; only the task decides whether it is
    filled or given to another.
    """
    definition = participant.study.as_definition()
    if definition.task is None or drive.step != definition.task.key:
        return participant.stage if participant.stage == Stage.FILLED else Stage.UNDER_WAY
    alike = Participant.objects.filter(study=participant.study, kind=participant.kind)
    refilled = alike.filter(cell=participant.cell, stage=Stage.REFILLED).count()
    outcome: Any = drive.outcome
    return assignment.stage_at_end(outcome, definition.refill, refilled)


def _move(participant: Participant, stage: str) -> None:
    """Change the stage of a place that no other process has changed or drawn again."""
    if stage != participant.stage:
        Participant.objects.filter(
            pk=participant.pk, stage=participant.stage, draws_applied=participant.draws_applied
        ).update(stage=stage)
