"""The task engine's records, from the messages of a live session or from its stored record: both
give the same.

The time of a state, and of a photo, is its stamp minus the robot's clock offset, one for the whole
drive. All other records have the time at which the server received them, which is stored.
"""

from collections.abc import Iterator, Mapping
from typing import Any, get_args

import msgspec

from experiments.definition.course import CourseTrack
from experiments.definition.schema import Outcome
from experiments.models import Drive
from experiments.stored_states import StateReader, clock_offsets
from experiments.tasks import records
from experiments.tasks.progress import ANSWERS
from experiments.tasks.records import Input, PhotoFailed, PhotoTaken, Record, TaskEnded, seen
from robots.api.messages import ActionStatus, Event, State
from sessions.leases.absences import end_of
from sessions.models import Session, SessionEvent
from sessions.protocol import PageEvent
from sessions.recording.batches import iter_batches

STORED = StateReader(State)
TASK = "task"  # the reason of a session that the task has ended: its outcome is the task's own


def of_message(message: object, received_at: float, offset: float) -> Input | None:
    """Return the input that a message is to the task; None for other messages. Unix seconds,
    `offset` is the robot's clock minus the server's.
    """
    match message:
        case PageEvent(stamp=stamp, type=kind, data=data):
            return _of_page(kind, stamp, received_at, data)
        case Event(stamp=stamp, type="photo", action_id=str(action)):
            return PhotoTaken(stamp - offset, action)
        case ActionStatus(action_id=action, type="photo", status="FAILED"):
            return PhotoFailed(received_at, action)
    return None


def of_event(event: SessionEvent, offset: float) -> Input | None:
    data = event.data
    if event.source == SessionEvent.Source.PAGE:
        return _of_page(event.type, event.stamp, event.received_at, data)
    if event.source == SessionEvent.Source.ROBOT and isinstance(data.get("actionId"), str):
        if event.type == "photo":
            return PhotoTaken(event.stamp - offset, data["actionId"])
        if event.type == "action" and (data.get("type"), data.get("status")) == ("photo", "FAILED"):
            return PhotoFailed(event.received_at, data["actionId"])
    return None


def _of_page(kind: str, stamp: float, received_at: float, data: Mapping[str, Any]) -> Input | None:
    if kind == "first_frame":
        return records.FirstFrame(received_at, repr(stamp))
    if kind == "photo_answer" and data.get("choice") in ANSWERS:
        # the page repeats an answer, with the same id, until it is acknowledged
        given = data.get("id")
        name = given if isinstance(given, str) and given else repr(stamp)
        return records.PhotoAnswer(received_at, name, data["choice"])
    return None


def ended(session: Session) -> TaskEnded | None:
    """Return the end of a session as an input to the task; None while it lives. Leaving never
    completes a task, and the time spent waiting for a lost connection is not part of it.
    """
    at = end_of(session)
    if at is None or session.outcome not in get_args(Outcome):
        return None
    left = session.outcome == Session.Outcome.COMPLETED and session.outcome_reason != TASK
    outcome: Outcome = "cancelled" if left else session.outcome
    return TaskEnded(at.timestamp(), str(session.pk), outcome)


def offset_of(drive: Drive) -> float:
    """Return the robot's clock minus the server's (s): as decided, else the first measured."""
    if drive.clock_offset is not None:
        return drive.clock_offset
    return clock_offsets(drive.session_id).first() or 0.0


def track_of(drive: Drive) -> CourseTrack | None:
    """Return the course as it was laid out when the robot was granted, although its plan may have
    changed since; None for a practice drive.
    """
    track = drive.assigned.get("track")
    return msgspec.convert(track, CourseTrack) if track else None


def rows_with_records(
    drive: Drive, offset: float
) -> Iterator[tuple[State | SessionEvent, Record | None]]:
    """Yield all stored states and then all stored events of a drive, with what they are to the
    task; its end is not among them.
    """
    for state in STORED.of(drive.session_id):
        yield state, seen(state, offset)
    for event in iter_batches(SessionEvent.objects.filter(session=drive.session_id), 500):
        yield event, of_event(event, offset)


def stored(drive: Drive, offset: float) -> Iterator[Record]:
    return (record for _, record in rows_with_records(drive, offset) if record is not None)
