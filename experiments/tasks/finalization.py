"""What came of a drive, for good: computed from its complete record alone, as often as anybody
likes with the same result.

When the record of a session is closed, everything that the task engine takes is folded again:
events, result and outcome are written anew, what was in force is compared with what was assigned,
and the participant's place in the cell is filled, freed or given to another. Something that comes
late opens the record again; then it is all done again.

The session manager does it beside its own work, a little at each look (`Settler`), so that no lease
waits for a long record.
"""

import datetime
import time
from collections.abc import Iterator
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
from experiments.participation.layout import track_of
from experiments.tasks.engine import TaskEngine
from experiments.tasks.manipulation_check import Gathering, as_stored
from experiments.tasks.progress import ProgressEvent
from experiments.tasks.records import FirstFrame, seen
from experiments.tasks.stored_records import TASK, ended, events_of, of_event, offset_of, states_of
from sessions.models import Session

log = structlog.stdlib.get_logger(__name__)

SHARE_SECONDS = 0.05  # of a look of the session manager
STATES_AT_ONCE = 50
Stage = Participant.Stage


def due() -> Any:
    """Return the drives whose record is complete, and was not when they were settled last; the
    oldest first.
    """
    later = Q(settled_at=None) | Q(settled_at__lt=F("session__closed_at"))
    return Drive.objects.filter(later, session__closed_at__isnull=False).order_by("granted_at")


def settle(drive: Drive, now: datetime.datetime) -> None:
    for _ in _work(drive, now):
        pass


class Settler:
    def __init__(self) -> None:
        self._work: Iterator[None] | None = None
        self._refused: set[object] = set()

    def tick(self, now: datetime.datetime, share: float = SHARE_SECONDS) -> None:
        """Go on for about `share` seconds, and by one step at least."""
        until = time.monotonic() + share
        while True:
            if self._work is None:
                drive = (
                    due()
                    .exclude(pk__in=self._refused)
                    .select_related("participant__study", "session__robot__floor_plan")
                    .first()
                )
                if drive is None:
                    return
                self._work = self._insisting(drive, now)
            self._step()
            if time.monotonic() >= until:
                return

    def _step(self) -> None:
        work, self._work = self._work, None  # an error ends this attempt; the drive is begun anew
        if work is not None and next(work, self) is None:
            self._work = work

    def _insisting(self, drive: Drive, now: datetime.datetime) -> Iterator[None]:
        try:
            yield from _work(drive, now)
        except msgspec.ValidationError:
            self._refused.add(drive.pk)
            log.exception("drive_not_finalized", session=drive.session_id)


def note_end(drive: Drive) -> None:
    """Note how a session has ended, for the participant's next step; what is computed from the
    whole record comes later.
    """
    session, told = drive.session, str(drive.shown.get("outcome") or "")
    at_end = ended(session)
    outcome = told or (
        at_end.outcome if at_end is not None and track_of(drive) is not None else session.outcome
    )
    moved = session.first_motion_at is not None
    Drive.objects.filter(pk=drive.pk, settled_at=None).update(outcome=outcome, moved=moved)


def note_exposure(drive: Drive, at: float | None) -> None:
    """Note when a participant first saw the robot's video in a drive that lives: `at` in Unix
    seconds, None when they have not.
    """
    if at is not None and drive.exposed_at is None:
        drive.exposed_at = datetime.datetime.fromtimestamp(at, datetime.UTC)
        Drive.objects.filter(pk=drive.pk, exposed_at=None).update(exposed_at=drive.exposed_at)


# --- the work -------------------------------------------------------------------------------------


def _work(drive: Drive, now: datetime.datetime) -> Iterator[None]:
    track, offset, gathering = track_of(drive), offset_of(drive), Gathering(drive)
    engine = TaskEngine(track) if track is not None else None
    frames = []
    for number, state in enumerate(states_of(drive)):
        gathering.see(state)
        if engine is not None:
            engine.feed(seen(state, offset))
        if number % STATES_AT_ONCE == 0:
            _fold(engine)
            yield
    for event in events_of(drive):
        gathering.hear(event)
        record = of_event(event, offset)
        if isinstance(record, FirstFrame):
            frames.append(record.at)
        if engine is not None and record is not None:
            engine.feed(record)
    yield
    if engine is not None:
        end(engine, drive.session)
    yield
    _write(drive, engine, gathering, min(frames, default=None), now)


def _fold(engine: TaskEngine | None) -> None:
    """Have the engine do now what it would do at the end."""
    if engine is not None:
        _ = engine.progress


def end(engine: TaskEngine, session: Session) -> None:
    """Tell an engine that was told the whole record of a session how that has ended."""
    at_end = ended(session)
    if at_end is None:
        return
    engine.advance(at_end.at)
    # What the task itself has ended it ends again; by the clock of its states that may be a moment
    # later than by ours.
    if session.outcome_reason != TASK or engine.progress.outcome is None:
        engine.feed(at_end)


def _write(
    drive: Drive,
    engine: TaskEngine | None,
    gathering: Gathering,
    first_frame: float | None,
    now: datetime.datetime,
) -> None:
    condition = _condition_of(drive)
    applied = gathering.done()
    outcome = engine.progress.outcome if engine is not None else drive.session.outcome
    # Where states are lost for good nobody can tell that nothing was done to the participant.
    missing = bool(drive.session.summary.get("missing")) and drive.session.driving_at is not None
    moved = gathering.moved or missing
    _write_events(drive, engine.events if engine is not None else ())
    began_with, ended_with = gathering.ends()
    Drive.objects.filter(pk=drive.pk).update(
        outcome=outcome or drive.session.outcome,
        exposed_at=_exposed_at(drive, first_frame, moved=moved),
        moved=moved,
        versions=drive.versions | {"metrics": str(METRICS_VERSION)},
        applied=as_stored(applied),
        clock_offset=offset_of(drive),
        began_with=began_with,
        ended_with=ended_with,
        mismatches=list(conditions.mismatches(condition, applied, by_wizard=_is_by_wizard(drive)))
        if moved and condition is not None
        else [],
        result=msgspec.to_builtins(engine.result) if engine is not None else {},
    )
    closed_at = drive.session.closed_at or now
    drive.refresh_from_db()
    settle_place(drive)
    # Last of all: what is cut off before this is done again.
    Drive.objects.filter(pk=drive.pk).update(settled_at=max(now, closed_at))
    log.info(
        "drive_settled",
        session=drive.session_id,
        outcome=drive.outcome,
        exposed=drive.exposed_at is not None,
        moved=drive.moved,
        mismatches=drive.mismatches,
    )


def _exposed_at(
    drive: Drive, first_frame: float | None, *, moved: bool
) -> datetime.datetime | None:
    """Return when a participant was exposed: at the first video frame; one whose page's event was
    lost, though the robot moved for them, at the first motion.
    """
    if first_frame is not None:
        return datetime.datetime.fromtimestamp(first_frame, datetime.UTC)
    return (drive.session.first_motion_at or drive.granted_at) if moved else None


def _is_by_wizard(drive: Drive) -> bool:
    return bool(drive.assigned.get("terms", {}).get("driver") == "wizard")


def _condition_of(drive: Drive) -> Condition | None:
    assigned = drive.assigned.get("condition")
    if assigned is None:
        return drive.participant.study.as_definition().condition(drive.condition)
    return msgspec.convert(assigned, Condition)


def _write_events(drive: Drive, events: tuple[ProgressEvent, ...]) -> None:
    rows = [
        TaskEvent(drive=drive, number=number, stamp=event.at, type=event.type, data=event.data())
        for number, event in enumerate(events)
    ]
    # where there are no transactions, a drive that is not settled yet is done again
    with transaction.atomic():
        TaskEvent.objects.filter(drive=drive).delete()
        TaskEvent.objects.bulk_create(rows)


# --- the place in the cell ------------------------------------------------------------------------


def settle_place(drive: Drive) -> None:
    """Fill, free or pass on the place of a participant whose drive is over; a place of which they
    saw something is never freed.
    """
    participant = Participant.objects.select_related("study").get(pk=drive.participant_id)
    exposed = Drive.objects.filter(participant=participant, exposed_at__isnull=False)
    if exposed.exists():
        first = exposed.order_by("granted_at").values_list("visit", flat=True)[0]
        under_way = participant.stage in {Stage.UNDER_WAY, Stage.FREED}
        if under_way or (participant.stage == Stage.FILLED and drive.visit == first):
            _move(participant, _stage_after(drive, participant))
    elif (
        participant.stage == Stage.UNDER_WAY
        and not participant.study.as_definition().reveals_condition
        and not Drive.objects.filter(participant=participant, settled_at=None)
        .exclude(pk=drive.pk)
        .exists()
    ):
        _move(participant, Stage.FREED)


def _stage_after(drive: Drive, participant: Participant) -> str:
    """Return what becomes of the place of somebody who was exposed; only a task that ended badly
    can be given to another.
    """
    definition = participant.study.as_definition()
    if definition.task is None or drive.step != definition.task.key:
        return participant.stage if participant.stage == Stage.FILLED else Stage.UNDER_WAY
    alike = Participant.objects.filter(study=participant.study, kind=participant.kind)
    refilled = alike.filter(cell=participant.cell, stage=Stage.REFILLED).count()
    outcome: Any = drive.outcome
    return assignment.stage_at_end(outcome, definition.refill, refilled)


def _move(participant: Participant, stage: str) -> None:
    if stage != participant.stage:
        Participant.objects.filter(
            pk=participant.pk, stage=participant.stage, draws_applied=participant.draws_applied
        ).update(stage=stage)
