"""A drive through the cabin as the session manager and its record have it: the same records as
states, events and page events.

`say` passes them to the runner, as the session manager's signals do; `write` puts them into the
database, as the recorder does.
"""

import datetime
import uuid
from typing import Any

import msgspec
from django.utils import timezone

from accounts.models import User
from experiments.models import Drive, ParticipantKind
from experiments.tasks.records import FirstFrame, PhotoAnswer, PhotoFailed, PhotoTaken, Record, Seen
from experiments.tasks.runner import Runner
from robots.api import messages as m
from robots.models import Robot, RobotPresence
from sessions.leases import store
from sessions.models import Session, SessionEvent
from sessions.protocol import PageEvent
from tests.support import words
from tests.support.sessions.rows import chunk_row
from tests.support.studies import participants as p, task_drives
from tests.support.studies.studies import small_study
from tests.support.studies.study_site import cabin_with_giraff

AHEAD = 12.5  # the robot's clock is that much ahead of ours: seconds


def cabin_robot() -> Robot:
    """The cabin and its giraff, which is online."""
    cabin_with_giraff()
    RobotPresence.objects.update(
        connection="ONLINE", last_seen_at=timezone.now() + datetime.timedelta(hours=1)
    )
    return Robot.objects.get(name="giraff")


def begin(robot: Robot, name: str = "ada", study: Any = None, **changes: Any) -> Drive:
    """A participant who just got the robot, in the condition with every door open, and drives."""
    study = study or p.published(small_study(conditions=[small_conditions()[0]], **changes))
    participant = p.comer(
        study, User.objects.create(username=name), kind=ParticipantKind.PARTICIPANT
    )
    session = store.take(robot, participant.user, f"peer-{name}", now=timezone.now()).session
    Session.objects.filter(pk=session).update(state="driving", driving_at=timezone.now())
    return Drive.objects.select_related("session__robot", "participant__study").get(session=session)


def small_conditions() -> list[dict[str, Any]]:
    """The conditions of the small study, as JSON."""
    return msgspec.to_builtins(small_study().conditions)


def photographed(at: float) -> list[Record]:
    """The whole task; its first photo failed, the second was taken again, the third kept."""
    drive = task_drives.Drive(at=at, frame=False)
    drive.say(FirstFrame(drive.at, repr(drive.at - 0.5))).go(*task_drives.THERE)
    drive.say(PhotoFailed(drive.at, "a1")).see()
    drive.say(PhotoTaken(drive.at, "a2")).see()
    drive.say(PhotoAnswer(drive.at, repr(drive.at), "again")).see()
    drive.say(PhotoTaken(drive.at, "a3")).see()
    drive.say(PhotoAnswer(drive.at, repr(drive.at), "keep")).see()
    return drive.go(*task_drives.BACK).dock().records


def state_of(seen: Seen, drive: Drive, *, moving: bool = True) -> m.State:
    """What the robot says, by its own clock."""
    command = words.applied(seen.seq, stamp=seen.at)
    return words.state(
        seen.seq,
        stamp=seen.at + AHEAD,
        boot=seen.boot,
        session=str(drive.session_id),
        epoch=1,
        pose=m.Pose(x=seen.x, y=seen.y, theta=seen.theta, localized=seen.localized),
        velocity=m.Velocity(linear=seen.linear, angular=0.0),
        battery=m.Battery(charge=1.0),
        docked=seen.docked,
        charger_contact=seen.contact,
        visitor_silence=0.1,
        applied=(command,) if moving and not (seen.contact and seen.released) else (),
    )


def message_of(record: Record) -> m.Event | m.ActionStatus | PageEvent:
    """Return the message of an input. A page gives it a stamp of its own, the receiver the time."""
    match record:
        case FirstFrame(id=word):
            return PageEvent(stamp=float(word), type="first_frame")
        case PhotoAnswer(id=word, choice=choice):
            return PageEvent(stamp=float(word), type="photo_answer", data={"choice": choice})
        case PhotoTaken(at, action):
            return m.Event(
                stamp=at + AHEAD, boot="boot", seq=0, type="photo", action_id=action, sha256="ab"
            )
        case PhotoFailed(at, action):
            failed = {"status": "FAILED", "type": "photo", "reason": "no_picture"}
            return m.ActionStatus(action_id=action, stamp=at + AHEAD, **failed)
    raise AssertionError(record)


def say(
    runner: Runner, drive: Drive, record: Record, *, robot: str = "giraff", moving: bool = True
) -> None:
    """Have the runner hear a record at the moment it was received."""
    about = {"session": str(drive.session_id), "received_at": record.at, "clock_offset": AHEAD}
    if isinstance(record, Seen):
        runner.on_state(robot=robot, state=state_of(record, drive, moving=moving), **about)
    else:
        message = message_of(record)
        runner.on_message(
            robot="" if isinstance(message, PageEvent) else robot, message=message, **about
        )


def write(
    drive: Drive, records: list[Record], *, moving: bool = True, offset: float | None = AHEAD
) -> None:
    """Put records into the database, states four to a chunk."""
    states = [
        (record.at, state_of(record, drive, moving=moving))
        for record in records
        if isinstance(record, Seen)
    ]
    for start in range(0, len(states), 4):
        part = states[start : start + 4]
        stored = [msgspec.to_builtins(state) for _, state in part]
        chunk_row(drive.session, stored, received_at=part[0][0], clock_offset=offset)
    for record in records:
        if not isinstance(record, Seen):
            write_event(drive, message_of(record), record.at)


def write_event(
    drive: Drive, message: m.Event | m.ActionStatus | PageEvent, received_at: float
) -> None:
    """Put an event into the database as the recorder does."""
    fields = msgspec.to_builtins(message)
    if isinstance(message, PageEvent):
        source, kind, data = "page", message.type, dict(message.data)
    else:
        source, kind = "robot", message.type if isinstance(message, m.Event) else "action"
        data = {
            name: value
            for name, value in fields.items()
            if name != "stamp" and (name != "type" or kind == "action")
        }
    about = {"source": source, "type": kind, "data": data}
    about |= {"stamp": message.stamp, "received_at": received_at}
    SessionEvent.objects.create(pk=uuid.uuid4(), session_id=drive.session_id, **about)


def close(
    drive: Drive, *, outcome: str = "", reason: str = "", at: float, missing: int = 0
) -> Drive:
    """End the session, if it lives, and close its record."""
    when = datetime.datetime.fromtimestamp(at, datetime.UTC)
    if outcome:
        store.end(str(drive.session_id), outcome, reason, when)
    Session.objects.filter(pk=drive.session_id).update(
        closed_at=when + datetime.timedelta(seconds=3), summary={"missing": missing}
    )
    return Drive.objects.select_related("session__robot__floor_plan", "participant__study").get(
        pk=drive.pk
    )
