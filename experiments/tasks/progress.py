"""How far a task is: one step of the fold that turns records into events.

`step` is a function of where things stood and of the next record in order of time; nothing else is
asked, so the same records give the same events. The rules:

- the time counts from the first picture shown; at its limit the task ends, whatever came at that
  moment;
- checkpoints count in order, each within its radius and its room; standing on a later one is told
  and recorded once a visit;
- near the photo's checkpoint, once that is passed, the photo's window opens by itself until the
  visitor keeps a photo or skips it;
- docking ends the task once all checkpoints are passed, with or without the photo; before that it
  is recorded, and changes nothing. Docked is what the robot says it is and what the course's rule
  (robots/api/docked.py) makes of its states: contact, standstill and released controls without a
  break. Contacts that part sooner are a fact, and the visitor is told to drive on into the station;
- a door is passed where the robot's middle goes through its frame; which were asked for and missed
  is a fact of the result.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any, Literal

from experiments.definition.course import CourseTrack, Motion, Sight
from experiments.definition.cues import FIRST, LEAVING, Cue, Situation, Window, choose
from experiments.definition.schema import Outcome
from experiments.tasks.records import (
    FirstFrame,
    Input,
    PhotoAnswer,
    PhotoFailed,
    PhotoTaken,
    Record,
    Seen,
    TaskEnded,
)
from robots.api.docked import APART, DockReading, DockState, follow
from robots.api.geometry import Pose2D

EventType = Literal[
    "task_started",
    "time_warning",
    "checkpoint",
    "out_of_order",
    "door_passed",
    "left_station",
    "docked_early",
    "dock_contact",
    "dock_contact_lost",
    "docked",
    "cue",
    "photo_prompt",
    "photo_taken",
    "photo_failed",
    "photo_kept",
    "photo_again",
    "photo_skipped",
    "task_ended",
]
Settled = Literal["", "kept", "skipped"]

OUT = 0.3  # who is so far from a docked pose or a doorway has left it: metres
# seconds, metres, m/s: states that are farther apart than these allow show no motion
GAP, JUMP, SPEED = 2.5, 0.3, 2.5
LOST_FOR = 1.0  # seconds without a place before the visitor is told


@dataclass(frozen=True)
class ProgressEvent:
    """Something that happened once.

    `number` is a checkpoint's, or that of a contact with the charger, `name` that of a door, cue,
    photo or outcome; `pose` the last one known.
    """

    at: float
    type: EventType
    pose: Pose2D | None = None
    number: int | None = None
    name: str = ""
    sight: Sight | None = None

    def data(self) -> dict[str, Any]:
        """Return it as it is stored beside stamp and type: what is not known is left out."""
        fields: dict[str, Any] = {"number": self.number, "name": self.name or None}
        if self.pose is not None:
            fields["pose"] = {"x": self.pose.x, "y": self.pose.y, "theta": self.pose.theta}
        if self.sight is not None:
            fields["facing"] = {
                name: getattr(self.sight, name)
                for name in ("bearing", "distance", "before", "sees")
            }
        return {name: value for name, value in fields.items() if value is not None}


@dataclass(frozen=True)
class PhotoState:
    """How far the photo is; `pending` is the newest picture that waits for an answer."""

    is_open: bool = False
    prompted: bool = False
    pending: str = ""
    settled: Settled = ""

    @property
    def window(self) -> Window:
        """What the page shows: a picture that waits for its answer, the hint, or nothing."""
        return "shut" if self.settled or not self.is_open else "review" if self.pending else "open"


@dataclass(frozen=True)
class Progress:
    """How things stand. `passed` has the time of each checkpoint, `doors` the names of doors in the
    order they were gone through.

    `dock` is how the robot stands to its station by the course's rule, `dock_contacts` how often
    the contacts met after the last checkpoint. `in_doorway` names those whose line was crossed
    without having gone on yet, `on_later` the later checkpoints on which the robot stands.
    """

    started: float | None = None
    ended: float | None = None
    outcome: Outcome | None = None
    warned: bool = False
    last: Seen | None = None
    placed: Seen | None = None
    is_out: bool = False
    came_early: bool = False
    passed: tuple[float, ...] = ()
    on_later: frozenset[int] = frozenset()
    in_doorway: frozenset[str] = frozenset()
    doors: tuple[str, ...] = ()
    photo: PhotoState = PhotoState()
    dock: DockState = APART
    dock_contacts: int = 0
    cue: Cue = FIRST

    @property
    def pose(self) -> Pose2D | None:
        """The last pose in which the robot knew where it was."""
        return (
            Pose2D(self.placed.x, self.placed.y, self.placed.theta)
            if self.placed is not None
            else None
        )

    @property
    def docked(self) -> bool:
        """Whether it is docked: as it says, and once it has been out also as the course's rule
        says.
        """
        return self.last is not None and self.last.docked and (self.dock.docked or not self.is_out)

    def remaining(self, track: CourseTrack, now: float) -> float | None:
        """Return the seconds left, None while nothing counts."""
        return (
            None
            if self.started is None or self.outcome is not None
            else max(0.0, self.started + track.limit - now)
        )


Stepped = tuple[Progress, tuple[ProgressEvent, ...]]


def step(track: CourseTrack, progress: Progress, record: Record) -> Stepped:
    """Take the next record; return how things stand then, and what has happened."""
    progress, events = until(track, progress, record.at)
    if progress.outcome is not None:
        return progress, events
    progress, more = (
        _seen(track, progress, record)
        if isinstance(record, Seen)
        else _input(track, progress, record)
    )
    return _cued(track, progress, record.at, (*events, *more))


def until(track: CourseTrack, progress: Progress, now: float) -> Stepped:
    """Let the time pass until `now`; return how things stand then, and what has happened."""
    if progress.started is None or progress.outcome is not None:
        return progress, ()
    events: tuple[ProgressEvent, ...] = ()
    deadline = progress.started + track.limit
    if not progress.warned and 0.0 < track.last < track.limit and now >= deadline - track.last:
        progress = replace(progress, warned=True)
        events = (ProgressEvent(deadline - track.last, "time_warning", progress.pose),)
    if now >= deadline:
        progress, ended = _end(progress, deadline, "timed_out")
        return _cued(track, progress, deadline, (*events, ended))
    return progress, events


def _end(progress: Progress, at: float, outcome: Outcome) -> tuple[Progress, ProgressEvent]:
    return replace(progress, ended=at, outcome=outcome), ProgressEvent(
        at, "task_ended", progress.pose, name=outcome
    )


def _cued(
    track: CourseTrack, progress: Progress, at: float, events: tuple[ProgressEvent, ...]
) -> Stepped:
    """Change the cue if the situation asks for another."""
    cue = choose(_situation(track, progress, at), track, progress.cue)
    if cue == progress.cue:
        return progress, events
    return replace(progress, cue=cue), (
        *events,
        ProgressEvent(at, "cue", progress.pose, number=cue.number, name=cue.key),
    )


def _situation(track: CourseTrack, progress: Progress, at: float) -> Situation:
    pose, placed = progress.pose, progress.placed
    lost = (
        progress.last is not None
        and not progress.last.localized
        and (placed is None or at - placed.at > LOST_FOR)
    )
    spot = track.photo
    return Situation(
        started=progress.started is not None,
        outcome=progress.outcome,
        lost=lost,
        docked=progress.docked,
        early=progress.came_early,
        touching=progress.dock.touching and progress.dock_contacts > 0,
        dock_contacts=progress.dock_contacts,
        passed=len(progress.passed),
        wrong=min(progress.on_later, default=None),
        window=progress.photo.window,
        sight=spot.sight(pose) if spot is not None and pose is not None else None,
        home=pose.distance(track.dock) if pose is not None else math.inf,
    )


# --- states ---------------------------------------------------------------------------------------


def _seen(track: CourseTrack, progress: Progress, seen: Seen) -> Stepped:
    before, dock = progress.placed, progress.dock
    progress = replace(
        progress,
        last=seen,
        placed=seen if seen.localized else progress.placed,
        dock=_dock(track, dock, seen),
    )
    if progress.started is None:
        return progress, ()
    events: tuple[ProgressEvent, ...] = ()
    if seen.localized:
        motion = _motion(before, seen)
        for part in (_doors, _stops, _window):
            progress, more = part(track, progress, motion)
            events += more
    for part_of_station in (_contact, _station):
        progress, more = part_of_station(track, progress, seen, was_touching=dock.touching)
        events += more
    return progress, events


def _motion(before: Seen | None, seen: Seen) -> Motion:
    """Return what the robot has gone since its last known place; nothing when that was too long
    ago, or it was somewhere else.
    """
    here = (seen.x, seen.y)
    if before is None:
        return Motion(here, here)
    seconds, metres = seen.at - before.at, math.dist((before.x, before.y), here)
    followed = seconds <= GAP and metres <= JUMP + SPEED * seconds
    return Motion((before.x, before.y) if followed else here, here)


def _doors(track: CourseTrack, progress: Progress, motion: Motion) -> Stepped:
    """A door is passed when the robot has gone on; who turns round in the doorway has not passed
    it.
    """
    crossed = {
        doorway.name for doorway in track.doorways if motion.crosses(doorway.start, doorway.end)
    }
    begun = progress.in_doorway ^ crossed
    if not begun and not progress.in_doorway:
        return progress, ()
    names = tuple(
        doorway.name
        for doorway in track.doorways
        if doorway.name in begun and doorway.distance(*motion.end) > OUT
    )
    events = tuple(
        ProgressEvent(_now(progress), "door_passed", progress.pose, name=name) for name in names
    )
    return replace(progress, in_doorway=begun - set(names), doors=progress.doors + names), events


def _stops(track: CourseTrack, progress: Progress, motion: Motion) -> Stepped:
    events: list[ProgressEvent] = []
    while len(progress.passed) < len(track.stops) and track.stops[len(progress.passed)].is_passed(
        motion
    ):
        events.append(
            ProgressEvent(
                _now(progress),
                "checkpoint",
                progress.pose,
                number=track.stops[len(progress.passed)].number,
            )
        )
        progress = replace(progress, passed=(*progress.passed, _now(progress)))
    on_later = frozenset(_on_later(track, progress, motion))
    if on_later == progress.on_later:
        return progress, tuple(events)
    numbers = sorted(on_later - progress.on_later)
    events += [
        ProgressEvent(_now(progress), "out_of_order", progress.pose, number=number)
        for number in numbers
    ]
    return replace(progress, on_later=on_later), tuple(events)


def _on_later(track: CourseTrack, progress: Progress, motion: Motion) -> Iterator[int]:
    """Yield the numbers of later checkpoints on which the robot stands; it has left one only when
    it is well outside.
    """
    for stop in track.stops[len(progress.passed) + 1 :]:
        stays = (
            stop.number in progress.on_later and stop.distance(*motion.end) <= stop.radius * LEAVING
        )
        if stays or stop.is_passed(motion):
            yield stop.number


def _window(track: CourseTrack, progress: Progress, motion: Motion) -> Stepped:
    spot, photo = track.photo, progress.photo
    if spot is None or photo.settled or len(progress.passed) < spot.stop.number:
        return progress, ()
    is_open = spot.stop.distance(*motion.end) <= spot.radius * (LEAVING if photo.is_open else 1.0)
    if is_open == photo.is_open:
        return progress, ()
    opens = is_open and not photo.is_open
    pose = progress.pose
    facing = spot.sight(pose) if pose is not None else None
    events = (
        (
            ProgressEvent(
                _now(progress), "photo_prompt", pose, number=spot.stop.number, sight=facing
            ),
        )
        if opens
        else ()
    )
    return replace(
        progress, photo=replace(photo, is_open=is_open, prompted=photo.prompted or opens)
    ), events


def _dock(track: CourseTrack, before: DockState, seen: Seen) -> DockState:
    if track.docked is None:
        return DockState(docked=seen.docked)
    return follow(
        track.docked,
        before,
        DockReading(
            at=seen.at,
            contact=seen.contact,
            linear=seen.linear,
            angular=seen.angular,
            released=seen.released,
        ),
    )


def _contact(track: CourseTrack, progress: Progress, seen: Seen, *, was_touching: bool) -> Stepped:
    """Once all checkpoints are passed each contact is an attempt to dock, and so is its loss a
    fact.
    """
    if len(progress.passed) < len(track.stops) or progress.dock.touching == was_touching:
        return progress, ()
    if progress.dock.touching:
        progress = replace(progress, dock_contacts=progress.dock_contacts + 1)
        return progress, (
            ProgressEvent(seen.at, "dock_contact", progress.pose, number=progress.dock_contacts),
        )
    if progress.dock_contacts == 0:
        return progress, ()
    return progress, (
        ProgressEvent(seen.at, "dock_contact_lost", progress.pose, number=progress.dock_contacts),
    )


def _station(track: CourseTrack, progress: Progress, seen: Seen, **_more: bool) -> Stepped:
    """Leaving the charging station and coming back to it."""
    if not progress.docked:
        pose = progress.pose
        away = (
            not seen.docked
            and seen.localized
            and pose is not None
            and pose.distance(track.dock) > OUT
        )
        if not away or progress.is_out:
            return progress, ()
        left = ProgressEvent(seen.at, "left_station", pose, number=0)
        return replace(progress, is_out=True), (left,)
    if len(progress.passed) == len(track.stops) and progress.dock.docked:
        ended, event = _end(progress, seen.at, "completed")
        return ended, (ProgressEvent(seen.at, "docked", progress.pose, number=0), event)
    if progress.is_out:
        early = replace(progress, is_out=False, came_early=True)
        return early, (
            ProgressEvent(
                seen.at,
                "docked_early",
                progress.pose,
                number=track.stops[len(progress.passed)].number,
            ),
        )
    return progress, ()


def _now(progress: Progress) -> float:
    return progress.last.at if progress.last is not None else math.nan


# --- inputs ---------------------------------------------------------------------------------------


def _input(track: CourseTrack, progress: Progress, record: Input) -> Stepped:
    if isinstance(record, TaskEnded):
        ended, event = _end(progress, record.at, record.outcome)
        return ended, (event,)
    if isinstance(record, FirstFrame):
        if progress.started is not None:
            return progress, ()
        return replace(progress, started=record.at), (
            ProgressEvent(record.at, "task_started", progress.pose),
        )
    if progress.started is None:
        return progress, ()
    if isinstance(record, PhotoAnswer):
        return _answer(progress, record)
    return _picture(track, progress, record)


def _picture(track: CourseTrack, progress: Progress, record: PhotoTaken | PhotoFailed) -> Stepped:
    """A picture, wanted or not, is a fact; so is how the robot stood when it was taken."""
    if isinstance(record, PhotoFailed):
        return progress, (ProgressEvent(record.at, "photo_failed", progress.pose, name=record.id),)
    sight = (
        track.photo.sight(progress.pose)
        if track.photo is not None and progress.pose is not None
        else None
    )
    waits = progress.photo.prompted and not progress.photo.settled
    photo = replace(progress.photo, pending=record.id) if waits else progress.photo
    return replace(progress, photo=photo), (
        ProgressEvent(record.at, "photo_taken", progress.pose, name=record.id, sight=sight),
    )


def _answer(progress: Progress, record: PhotoAnswer) -> Stepped:
    """An answer counts while the window waits for one, wherever the robot stands by then; keeping
    needs something to keep.
    """
    photo = progress.photo
    if photo.settled or not photo.prompted or (record.choice != "skip" and not photo.pending):
        return progress, ()
    types: dict[str, EventType] = {
        "keep": "photo_kept",
        "again": "photo_again",
        "skip": "photo_skipped",
    }
    settled: dict[str, Settled] = {"keep": "kept", "again": "", "skip": "skipped"}
    event = ProgressEvent(record.at, types[record.choice], progress.pose, name=photo.pending)
    return replace(progress, photo=replace(photo, pending="", settled=settled[record.choice])), (
        event,
    )
