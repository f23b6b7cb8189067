"""Sessions whose record is known by construction, for replays and the live view."""

import datetime
import math
from typing import Any

from django.utils import timezone

from accounts.models import User
from experiments.models import Drive, Participant, Study, TaskEvent
from robots.models import FloorPlan, Robot
from sessions.models import NetworkSample, Session, SessionEvent, Snapshot, StateChunk
from tests.support.robots import create_robot, floor_plan
from tests.support.sessions.rows import session_row, unsaved_chunk
from tests.support.studies.studies import PLAN, STUDY

GRANTED = datetime.datetime(2026, 3, 2, 10, 0, tzinfo=datetime.UTC)
RATE = 4.0
OFFSET = 2.0  # how far the robot's clock is ahead of the server's, in s
CIRCLE = 0.2  # rad/s, round (2, 2) with 1 m


def cabin_robot(name: str = "giraff", **more: Any) -> Robot:
    """A robot in the cabin of tests/support/studies/studies.py."""
    drawn = {"width": 160, "height": 80, "plan": PLAN, "sha256": "a" * 64}
    plan = FloorPlan.objects.filter(name="cabin").first() or floor_plan("cabin", **drawn)
    footprint = [[0.25, 0.2], [-0.25, 0.2], [-0.25, -0.2], [0.25, -0.2]]
    factsheet = {"series": "giraff", "footprint": footprint}
    return create_robot(name, floor_plan=plan, factsheet=factsheet, **more)


def study(**more: Any) -> Study:
    """The study of tests/support/studies/studies.py, stored as it stands."""
    fields = {"slug": "cabin-study", "version": 1, "title": "Cabin", "definition": STUDY}
    fields |= {"sha256": "0" * 64, "created_at": GRANTED}
    return Study.objects.create(**{**fields, **more})


def participant(of: Study, user: User, **more: Any) -> Participant:
    """Somebody on the task's step."""
    now = timezone.now()
    fields = {"slot": f"{of.pk}:{user.pk}", "step": "task", "conditions": ["all_open"]}
    fields |= {"created_at": now, "seen_at": now}
    return Participant.objects.create(study=of, user=user, **{**fields, **more})


def session(
    robot: Robot,
    visitor: User,
    *,
    granted: datetime.datetime = GRANTED,
    seconds: float | None = None,
    **more: Any,
) -> Session:
    """A session that ended after `seconds`, or still goes on."""
    fields: dict[str, Any] = {"queued_at": granted, "granted_at": granted, "driving_at": granted}
    if seconds is None:
        fields["state"] = "driving"
    else:
        ended = granted + datetime.timedelta(seconds=seconds)
        key = f"{robot.pk.hex}{visitor.pk.hex}:{granted.timestamp():.3f}"  # 80 at most
        fields |= {"state": "ended", "outcome": "completed", "ended_at": ended, "live_key": key}
    return session_row(robot, visitor, **fields | more)


def drive(of: Participant, driven: Session, /, **more: Any) -> Drive:
    """The drive that a session is."""
    fields = {"step": "task", "visit": 1, "round": 0, "number": 1, "condition": "all_open"}
    fields |= {"seed": 1, "granted_at": driven.granted_at}
    return Drive.objects.create(participant=of, session=driven, **{**fields, **more})


def place(t: float) -> tuple[float, float, float]:
    """Where the robot is `t` seconds after the grant: on a circle."""
    angle = CIRCLE * t
    theta = math.remainder(angle + math.pi / 2.0, math.tau)
    return 2.0 + math.cos(angle), 2.0 + math.sin(angle), theta


def state(t: float, begin: float, seq: int, applied: int = 1) -> dict[str, Any]:
    """What a robot stores of itself `t` seconds after the grant, with the commands of the last
    quarter of a second.
    """
    x, y, theta = place(t)
    stamp = begin + t + OFFSET
    command = {"method": "keyboard", "way": "datachannel", "age": 0.03}
    command |= {"linear": 0.2, "angular": 0.2}
    ages = [(applied - 1 - n) / RATE / max(1, applied) for n in range(applied)]
    commands = [
        {**command, "seq": seq * applied + n, "stamp": begin + t - age}
        for n, age in enumerate(ages)
    ]
    return {
        "stamp": stamp,
        "boot": "boot",
        "seq": seq,
        "pose": {"x": x, "y": y, "theta": theta},
        "velocity": {"linear": 0.2, "angular": 0.2},
        "battery": {"charge": 0.8},
        "clearance": 0.9,
        "applied": commands,
    }


def record(visit: Session, *, seconds: int = 60, applied: int = 1) -> None:
    """Store `seconds` of states at 4 Hz and a network sample each second."""
    assert visit.granted_at is not None
    begin, per = visit.granted_at.timestamp(), int(RATE)
    chunks, samples = [], []
    for second in range(seconds):
        states = [state(second + n / RATE, begin, second * per + n, applied) for n in range(per)]
        about = {"received_at": begin + second + 1.0, "clock_offset": OFFSET}
        chunks.append(unsaved_chunk(visit, states, **about))
        data = {"roundTrip": 0.04 + 0.02 * math.sin(second), "loss": 0.0, "fps": 30.0}
        data["way"] = "datachannel"
        times = {"stamp": begin + second, "received_at": begin + second}
        samples.append(NetworkSample(session=visit, data=data, **times))
    StateChunk.objects.bulk_create(chunks)
    NetworkSample.objects.bulk_create(samples)


def told(visit: Session, at: float, kind: str, source: str = "robot", **data: Any) -> SessionEvent:
    """An event `at` seconds after the grant, by the clock of whoever tells it."""
    assert visit.granted_at is not None
    begin = visit.granted_at.timestamp()
    stamp = begin + at + (OFFSET if source == "robot" else 0.0)
    return SessionEvent.objects.create(
        session=visit, source=source, type=kind, stamp=stamp, received_at=begin + at, data=data
    )


def task_told(of: Drive, at: float, kind: str, **data: Any) -> TaskEvent:
    """What the task engine tells."""
    about = {"number": of.events.count(), "stamp": of.granted_at.timestamp() + at}
    return TaskEvent.objects.create(drive=of, type=kind, data=data, **about)


def photo(visit: Session, at: float, jpeg: bytes = b"\xff\xd8jpeg") -> Snapshot:
    """A photo taken `at` seconds after the grant."""
    assert visit.granted_at is not None
    stamp = visit.granted_at.timestamp() + at + OFFSET
    about = {"action_id": "p1", "stamp": stamp, "sha256": "b" * 64}
    return Snapshot.objects.create(session=visit, jpeg=jpeg, **about)
