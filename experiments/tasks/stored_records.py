"""What the task engine is fed with, from what is heard of a session while it lives, and from its
stored record: the same from both.

A state's time is its stamp less the robot's clock offset, one for the whole drive; so is a photo's.
Everything else has the time at which the server received it, which the record keeps.
"""

from collections.abc import Iterator, Mapping
from typing import Any, get_args

from experiments.definition.schema import Outcome
from experiments.models import Drive
from experiments.stored_states import StateReader, clock_offsets
from experiments.tasks.records import (
    FirstFrame,
    Input,
    PhotoAnswer,
    PhotoFailed,
    PhotoTaken,
    Record,
    TaskEnded,
    seen,
)
from robots.api.messages import ActionStatus, Event, State
from sessions.leases.absences import end_of
from sessions.models import Session, SessionEvent
from sessions.protocol import PageEvent
from sessions.recording.batches import iter_batches

STORED = StateReader(State)
CHOICES = ("keep", "again", "skip")
TASK = "task"  # the reason of a session that the task has ended: its outcome is the task's own


def of_message(message: object, received_at: float, offset: float) -> Input | None:
    """Return what a message means for the task; None when nothing. Unix seconds, `offset` the
    robot's clock minus ours.
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
    """Return what a stored event means for the task; None when nothing."""
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
        return FirstFrame(received_at, repr(stamp))
    if kind == "photo_answer" and data.get("choice") in CHOICES:
        said = data.get("id")  # the page says it again, as the same one, until it is understood
        return PhotoAnswer(
            received_at, said if isinstance(said, str) and said else repr(stamp), data["choice"]
        )
    return None


def ended(session: Session) -> TaskEnded | None:
    """Return the end of a session as the task takes it: leaving it is no way to complete it, and
    the time in which a lost connection was waited for is none of its own. None while it lives.
    """
    at = end_of(session)
    if at is None or session.outcome not in get_args(Outcome):
        return None
    left = session.outcome == Session.Outcome.COMPLETED and session.outcome_reason != TASK
    outcome: Outcome = "cancelled" if left else session.outcome
    return TaskEnded(at.timestamp(), str(session.pk), outcome)


def offset_of(drive: Drive) -> float:
    """Return the robot's clock minus ours for a drive: what was decided while it lived, else the
    first that was measured in its record.
    """
    if drive.clock_offset is not None:
        return drive.clock_offset
    return clock_offsets(drive.session_id).first() or 0.0


def states_of(drive: Drive) -> Iterator[State]:
    """Yield the stored states of a drive as they came from the robot."""
    yield from STORED.of(drive.session_id)


def events_of(drive: Drive) -> Iterator[SessionEvent]:
    """Yield the stored events of a drive in the order of their stamps."""
    yield from iter_batches(SessionEvent.objects.filter(session=drive.session_id), 500)


def stored(drive: Drive, offset: float) -> Iterator[Record]:
    """Yield all that the record of a drive has for the task, but for the session's end."""
    for state in states_of(drive):
        yield seen(state, offset)
    for event in events_of(drive):
        record = of_event(event, offset)
        if record is not None:
            yield record
