"""Runs the tasks of living drives: one engine a drive, fed with the session manager's messages.
Tells the page of the task, and ends the session.

All of it runs in the session manager's scheduler thread. An engine is made at the first message of
its drive, from the stored record, so that a new session manager continues a task in which the
previous one was killed. Events written here while the task runs serve live views;
experiments/tasks/finalization.py writes the final ones from the complete record.

A time limit applies once states in transit have had PATIENCE to arrive. A practice drive has no
engine: it ends after its minutes. A drive whose visitor never sees a video frame ends as timed out
when its turn would be over.
"""

import math
import uuid
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import Any

import structlog

from experiments.models import Drive, TaskEvent
from experiments.tasks.engine import TaskEngine
from experiments.tasks.finalization import Finalizer, note_exposure, record_end
from experiments.tasks.progress import ProgressEvent
from experiments.tasks.records import FirstFrame, Record, seen
from experiments.tasks.stored_records import TASK, of_message, offset_of, stored, track_of
from robots.api.messages import State
from sessions import protocol
from sessions.leases import store
from sessions.leases.store import LIVE
from sessions.manager import notices
from sessions.models import Session
from sessions.shards.ownership import EVERYTHING, Ownership

log = structlog.stdlib.get_logger(__name__)

PATIENCE = 1.0  # s after a time limit in which a state from before it may still arrive
REPEAT_AFTER_S = 10.0  # after which an unchanged task is published again
LAST_OF_PRACTICE = 60.0  # s of a practice drive in which the page shows the time left
MAX_FOREIGN = 1000  # sessions without a drive that are remembered
TIME_OVER = "time_over"
NEVER_SEEN = "no_picture"


@dataclass
class Running:
    """A living drive. `started` is the time of its first video frame, `published` the last task
    that the page received, `published_at` when; `seconds` is the time limit.
    """

    drive: Drive
    engine: TaskEngine | None
    seconds: float
    published: dict[str, Any]
    started: float | None = None
    published_at: float = float("-inf")
    written: int = 0
    unwritten: list[TaskEvent] = field(default_factory=list)

    @classmethod
    def restored(cls, drive: Drive) -> "Running":
        """Return a drive with its engine, as far as the stored record says."""
        track = track_of(drive)
        step = drive.participant.study.as_definition().drive(drive.step)
        seconds = track.limit if track is not None else 0.0
        if step is not None and step.is_practice:
            seconds = step.minutes * 60.0
        engine = TaskEngine(track) if track is not None else None
        running = cls(drive, engine, seconds, published=dict(drive.shown))
        for record in stored(drive, offset_of(drive)):
            running.feed(record)
        note_exposure(drive, running.started)
        running.written = TaskEvent.objects.filter(drive=drive).count()
        if engine is not None:
            known = set(TaskEvent.objects.filter(drive=drive).values_list("stamp", "type"))
            running.write(one for one in engine.news() if (one.at, one.type) not in known)
        return running

    def feed(self, record: Record) -> None:
        if isinstance(record, FirstFrame):
            self.started = record.at if self.started is None else min(self.started, record.at)
        if self.engine is not None:
            self.engine.feed(record)

    def over(self, now: float) -> tuple[str, str] | None:
        """Return (outcome, reason) when the drive is to end now."""
        outcome = self.engine.progress.outcome if self.engine is not None else None
        if outcome is not None:
            return outcome, TASK
        if self.started is None:
            turn = float(self.drive.assigned["terms"].get("turn_seconds") or self.seconds)
            is_over = now >= self.drive.granted_at.timestamp() + turn
            return (Session.Outcome.TIMED_OUT, NEVER_SEEN) if is_over else None
        is_practised = self.engine is None and now >= self.started + self.seconds
        return (Session.Outcome.COMPLETED, TIME_OVER) if is_practised else None

    def shown(self, now: float) -> dict[str, Any]:
        """Return what the page shows: the fields of sessions.protocol.Task."""
        if self.engine is None:
            left = math.inf if self.started is None else self.started + self.seconds - now
            remaining = {"remaining": round(max(0.0, left), 1)} if left <= LAST_OF_PRACTICE else {}
            return {"cue": "practice", **remaining}
        progress, left_of_task = self.engine.progress, self.engine.remaining()
        cue, stops = progress.cue, self.engine.track.stops
        x, y = cue.target if cue.target is not None else (None, None)
        directions = {"cue": cue.key, "number": cue.number, "x": x, "y": y}
        fields = {
            **directions,
            "passed": [stop.number for stop in stops[: len(progress.passed)]],
            "remaining": None if left_of_task is None else round(left_of_task, 1),
            "window": progress.photo.window,
            "photo": progress.photo.pending,
            "outcome": progress.outcome or "",
            "doors": list(progress.doors),
        }
        return {name: value for name, value in fields.items() if value is not None}

    def write(self, events: Iterable[ProgressEvent]) -> None:
        """Write events, and those that could not be written before."""
        self.unwritten += [
            TaskEvent(drive=self.drive, number=number, stamp=one.at, type=one.type, data=one.data())
            for number, one in enumerate(events, self.written + len(self.unwritten))
        ]
        if self.unwritten:
            TaskEvent.objects.bulk_create(self.unwritten)
            self.written += len(self.unwritten)
            self.unwritten = []


class Runner:
    """All living drives, and the living sessions without one (`_foreign`)."""

    def __init__(self) -> None:
        self._running: dict[str, Running] = {}
        self._foreign: set[str] = set()
        self._finalizer = Finalizer()

    def on_state(self, *, state: State, **about: Any) -> None:
        self._take(lambda offset: None if offset is None else seen(state, offset), **about)

    def on_message(self, *, message: object, received_at: float, **about: Any) -> None:
        """Take an event, the end of an action, or a page's message, whose `robot` is empty."""
        self._take(
            lambda offset: of_message(message, received_at, offset or 0.0),
            received_at=received_at,
            **about,
        )

    def _take(
        self,
        record_of: Callable[[float | None], Record | None],
        *,
        robot: str,
        session: str,
        received_at: float,
        clock_offset: float | None,
        **_more: object,
    ) -> None:
        """Feed a record into the drive of a session; `record_of` makes it with the clock offset."""
        running = self._of(session)
        if running is None or robot not in {"", running.drive.session.robot.name}:
            return
        record = record_of(_offset(running.drive, clock_offset))
        if record is not None:
            running.feed(record)
            if isinstance(record, FirstFrame):
                note_exposure(running.drive, running.started)
            self._advance(running, received_at)

    def tick(self, *, now: datetime, ownership: Ownership = EVERYTHING, **_more: object) -> None:
        """Advance the living drives of our robots; as owner of the site, settle ended ones."""
        drives = Drive.objects.filter(session__state__in=LIVE, settled_at=None)
        robots = {
            str(key): robot
            for key, robot in drives.values_list("session_id", "session__robot__name")
            if ownership.owns(robot)
        }
        for session in self._running.keys() - robots.keys():
            del self._running[session]
        self._foreign -= robots.keys()
        for session, robot in robots.items():
            with ownership.about(robot):
                running = self._of(session)
                if running is not None:
                    self._advance(running, now.timestamp())
        if ownership.owns_site:
            self._finalizer.tick(now)

    def on_end(self, *, session: Session, **_more: object) -> None:
        self._running.pop(str(session.pk), None)
        self._foreign.discard(str(session.pk))
        drives = Drive.objects.filter(session=session)
        drive = drives.select_related("session", "participant__study").first()
        if drive is not None:
            record_end(drive)

    def _of(self, session: str) -> Running | None:
        """Return the drive of a living session. One that is being granted gets its drive later."""
        if session not in self._running and session not in self._foreign:
            drive = _living_drive(session)
            if drive is not None:
                self._running[session] = Running.restored(drive)
            else:
                if len(self._foreign) > MAX_FOREIGN:
                    self._foreign.clear()
                self._foreign.add(session)
        return self._running.get(session)

    def _advance(self, running: Running, now: float) -> None:
        if running.engine is not None:
            running.engine.advance(now - PATIENCE)
            running.write(running.engine.news())
        _publish(running, now)
        over = running.over(now)
        if over is not None:
            session, at = str(running.drive.session_id), datetime.fromtimestamp(now, UTC)
            if store.end(session, *over, at):
                log.info("task_ended", session=session, outcome=over[0], reason=over[1])


def _publish(running: Running, now: float) -> None:
    """Send the task to the page when it has changed in more than the seconds, which the page counts
    down itself. Until the end it is also repeated, so that no page shows an old one for long.
    """
    shown = running.shown(now)
    if math.isinf(running.published_at):  # a previous process has published the stored task
        running.published_at = now
    is_due = not shown.get("outcome") and now - running.published_at >= REPEAT_AFTER_S
    if is_due or _without_seconds(shown) != _without_seconds(running.published):
        Drive.objects.filter(pk=running.drive.pk).update(shown=shown)
        task = protocol.task_of(str(running.drive.session_id), shown, now)
        if task is not None:
            notices.publish(task)
        # last, so that the next tick repeats what the database refused
        running.published, running.published_at = shown, now


def _without_seconds(shown: Mapping[str, Any]) -> dict[str, Any]:
    return {**shown, "remaining": "remaining" in shown}


def _offset(drive: Drive, measured: float | None) -> float | None:
    """Return the one clock offset of a drive, in seconds: the first that is measured."""
    if drive.clock_offset is None and measured is not None:
        Drive.objects.filter(pk=drive.pk, clock_offset=None).update(clock_offset=measured)
        drive.refresh_from_db(fields=["clock_offset"])
    return drive.clock_offset


def _living_drive(session: str) -> Drive | None:
    try:
        key = uuid.UUID(session)
    except ValueError:  # a message of no session
        return None
    living = Drive.objects.filter(session=key, session__state__in=LIVE)
    return living.select_related("session__robot", "participant__study").first()
