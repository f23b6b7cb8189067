"""Runs the tasks of living drives: one engine a drive, fed with what the session manager hears,
telling the page and ending the session.

In the session manager's scheduler thread alone, so that nothing here is done by two threads. An
engine is
made when its drive is first heard of, from what is stored by then: a session manager that was
started in mid-task goes on where the one before was killed. What is written here while the task
runs is for whoever watches; experiments/tasks/finalization.py writes it for good from the complete
record.

A time limit counts when states that were on their way have had PATIENCE to arrive. A practice drive
has no engine: it ends after its minutes. Whoever never sees a picture is not kept for ever: their
drive ends as timed out when its turn would be over.
"""

import datetime
import math
import uuid
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import structlog

from experiments.models import Drive, TaskEvent
from experiments.participation.layout import track_of
from experiments.tasks.engine import TaskEngine
from experiments.tasks.finalization import Settler, note_end, note_exposure
from experiments.tasks.records import FirstFrame, Record, seen
from experiments.tasks.stored_records import TASK, of_message, offset_of, stored
from robots.api.messages import State
from sessions import protocol
from sessions.leases import store
from sessions.leases.store import LIVE
from sessions.manager import notices
from sessions.models import Session
from sessions.shards.ownership import EVERYTHING, Ownership

log = structlog.stdlib.get_logger(__name__)

PATIENCE = 1.0  # s after a time limit in which a state from before it may still come
REPEAT_AFTER_S = 10.0  # s between two times at which the page is told the same
LAST_OF_PRACTICE = 60.0  # s of a practice drive that are announced
TIME_OVER = "time_over"
NEVER_SEEN = "no_picture"


@dataclass
class Running:
    """A living drive. `started` is when its first picture was shown; `told` what the page shows,
    and `published_at` since when.
    """

    drive: Drive
    robot: str
    offset: float | None
    engine: TaskEngine | None
    seconds: float
    started: float | None = None
    told: dict[str, Any] = field(default_factory=dict)
    published_at: float = float("-inf")
    written: int = 0
    unwritten: list[TaskEvent] = field(default_factory=list)

    def feed(self, record: Record) -> None:
        """Take a record."""
        if isinstance(record, FirstFrame):
            self.started = record.at if self.started is None else min(self.started, record.at)
        if self.engine is not None:
            self.engine.feed(record)

    def advance(self, now: float) -> None:
        """Tell the time, less what is still waited for."""
        if self.engine is not None:
            self.engine.advance(now - PATIENCE)

    def over(self, now: float) -> tuple[str, str] | None:
        """Return (outcome, reason) when the drive is to end now."""
        if self.engine is not None:
            outcome = self.engine.progress.outcome
            if outcome is not None:
                return outcome, TASK
        elif self.started is not None and now >= self.started + self.seconds:
            return Session.Outcome.COMPLETED, TIME_OVER
        last = self.drive.granted_at.timestamp() + float(
            self.drive.assigned["terms"].get("turn_seconds") or self.seconds
        )
        return (
            (Session.Outcome.TIMED_OUT, NEVER_SEEN)
            if self.started is None and now >= last
            else None
        )

    def shown(self, now: float) -> dict[str, Any]:
        """Return what the page shows: the fields of sessions.protocol.Task."""
        return shown_of(self.engine) if self.engine is not None else self._practice(now)

    def _practice(self, now: float) -> dict[str, Any]:
        left = None if self.started is None else max(0.0, self.started + self.seconds - now)
        return {
            "cue": "practice",
            **(
                {"remaining": round(left, 1)}
                if left is not None and left <= LAST_OF_PRACTICE
                else {}
            ),
        }


def shown_of(engine: TaskEngine) -> dict[str, Any]:
    """Return what a page shows of a task: the fields of sessions.protocol.Task."""
    progress, remaining = engine.progress, engine.remaining()
    cue, stops = progress.cue, engine.track.stops
    x, y = cue.target if cue.target is not None else (None, None)
    fields = {
        "cue": cue.key,
        "number": cue.number,
        "x": x,
        "y": y,
        "passed": [stop.number for stop in stops[: len(progress.passed)]],
        "remaining": None if remaining is None else round(remaining, 1),
        "window": progress.photo.window,
        "photo": progress.photo.pending,
        "outcome": progress.outcome or "",
        "doors": list(progress.doors),
    }
    return {name: value for name, value in fields.items() if value is not None}


class Runner:
    """All living drives, and the sessions that are none."""

    def __init__(self) -> None:
        self._running: dict[str, Running] = {}
        self._foreign: set[str] = set()
        self._settler = Settler()

    # --- what is heard ----------------------------------------------------------------------------

    def on_state(
        self,
        *,
        robot: str,
        session: str,
        state: State,
        received_at: float,
        clock_offset: float | None,
        **_more: object,
    ) -> None:
        """Take a state of a session."""
        running = self._of(session)
        if running is None or running.robot != robot:
            return
        offset = self._offset(running, clock_offset)
        if offset is not None:
            running.feed(seen(state, offset))
            self._go_on(running, received_at)

    def on_message(
        self,
        *,
        robot: str,
        session: str,
        message: object,
        received_at: float,
        clock_offset: float | None,
        **_more: object,
    ) -> None:
        """Take an event, the end of an action, or what the page says; `robot` is
        empty for a page.
        """
        running = self._of(session)
        if running is None or robot not in {"", running.robot}:
            return
        record = of_message(message, received_at, self._offset(running, clock_offset) or 0.0)
        if record is not None:
            running.feed(record)
            if isinstance(record, FirstFrame):
                note_exposure(running.drive, running.started)
            self._go_on(running, received_at)

    def tick(
        self, *, now: datetime.datetime, ownership: Ownership = EVERYTHING, **_more: object
    ) -> None:
        """Do what time asks for in every living drive of our robots; the owner of the site settles
        one that is over.
        """
        drives = Drive.objects.filter(session__state__in=LIVE, settled_at=None)
        robots = {
            str(key): robot
            for key, robot in drives.values_list("session_id", "session__robot__name")
            if ownership.owns(robot)
        }
        living = robots.keys()
        for session in self._running.keys() - living:
            del self._running[session]
        self._foreign -= living
        for session, robot in robots.items():
            with ownership.about(robot):
                running = self._of(session)
                if running is not None:
                    self._go_on(running, now.timestamp())
        if ownership.owns_site:
            self._settler.tick(now)

    def on_end(self, *, session: Session, **_more: object) -> None:
        """A session is over, whoever ended it."""
        self._running.pop(str(session.pk), None)
        self._foreign.discard(str(session.pk))
        drive = (
            Drive.objects.filter(session=session)
            .select_related("session", "participant__study")
            .first()
        )
        if drive is not None:
            note_end(drive)

    # --- what is done -----------------------------------------------------------------------------

    def _of(self, session: str) -> Running | None:
        if session in self._running:
            return self._running[session]
        if session in self._foreign:
            return None
        drive = _living_drive(session)
        if drive is None:
            self._remember_foreign(session)
            return None
        running = self._running[session] = begin(drive)
        return running

    def _remember_foreign(self, session: str) -> None:
        """A session that is being granted has no drive yet: it is asked for again at the next look,
        which knows of it.
        """
        if len(self._foreign) > 1000:
            self._foreign.clear()
        self._foreign.add(session)

    def _offset(self, running: Running, heard: float | None) -> float | None:
        """Return the one clock offset of a drive, decided when the first is measured."""
        if running.offset is None and heard is not None:
            Drive.objects.filter(pk=running.drive.pk, clock_offset=None).update(clock_offset=heard)
            running.drive.refresh_from_db(fields=["clock_offset"])
            running.offset = running.drive.clock_offset
        return running.offset

    def _go_on(self, running: Running, now: float) -> None:
        running.advance(now)
        if running.engine is not None:
            write_news(running)
        self._publish(running, now)
        over = running.over(now)
        if over is not None:
            self._end(running, *over, now)

    def _publish(self, running: Running, now: float) -> None:
        """Tell the page when anything has changed but the seconds, which it counts down by itself.
        Until the end it is told again now and then, so that no page goes on with what is over.
        """
        shown = running.shown(now)
        changed = _without_seconds(shown) != _without_seconds(running.told) or (
            "remaining" in shown
        ) != ("remaining" in running.told)
        if math.isinf(running.published_at):  # what is stored was told by whoever was here before
            running.published_at = now
        again = not shown.get("outcome") and now - running.published_at >= REPEAT_AFTER_S
        if changed or again:
            Drive.objects.filter(pk=running.drive.pk).update(shown=shown)
            session = str(running.drive.session_id)
            task = protocol.task_of(session, shown, now)
            if task is not None:
                notices.publish(task)
            # last: what the database did not take is told at the next tick
            running.told, running.published_at = shown, now

    @staticmethod
    def _end(running: Running, outcome: str, reason: str, now: float) -> None:
        session = str(running.drive.session_id)
        if store.end(session, outcome, reason, datetime.datetime.fromtimestamp(now, datetime.UTC)):
            log.info("task_ended", session=session, outcome=outcome, reason=str(reason))


def _without_seconds(shown: Mapping[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in shown.items() if name != "remaining"}


def _living_drive(session: str) -> Drive | None:
    """Return the drive of a living session; None when there is none, or when that is no session at
    all.
    """
    try:
        key = uuid.UUID(session)
    except ValueError:
        return None
    living = Drive.objects.filter(session=key, session__state__in=LIVE)
    return living.select_related("session__robot", "participant__study").first()


def begin(drive: Drive) -> Running:
    """Return a drive with its engine, as far as what is stored says."""
    track = track_of(drive)
    step = drive.participant.study.as_definition().drive(drive.step)
    offset = drive.clock_offset
    engine = TaskEngine(track) if track is not None else None
    seconds = (
        step.minutes * 60.0
        if step is not None and step.is_practice
        else track.limit
        if track is not None
        else 0.0
    )
    running = Running(
        drive, drive.session.robot.name, offset, engine, seconds, told=dict(drive.shown)
    )
    for record in stored(drive, offset_of(drive)):
        running.feed(record)
    note_exposure(drive, running.started)
    running.written = TaskEvent.objects.filter(drive=drive).count()
    if engine is not None:
        known = set(TaskEvent.objects.filter(drive=drive).values_list("stamp", "type"))
        engine.news()
        fresh = [event for event in engine.events if (event.at, event.type) not in known]
        _write(running, fresh)
    return running


def write_news(running: Running) -> None:
    """Write down what has happened in a task since it was asked last."""
    assert running.engine is not None
    _write(running, running.engine.news())


def _write(running: Running, events: Any) -> None:
    """Write events and whatever an earlier attempt could not."""
    running.unwritten += [
        TaskEvent(
            drive=running.drive, number=number, stamp=event.at, type=event.type, data=event.data()
        )
        for number, event in enumerate(events, running.written + len(running.unwritten))
    ]
    if running.unwritten:
        TaskEvent.objects.bulk_create(running.unwritten)
        running.written += len(running.unwritten)
        running.unwritten = []
