"""How far a task is: one step of the fold that turns records into events.

`step` depends only on the progress before and on the next record in order of time, so the same
records always give the same events. The rules:

- the time counts from the first video frame; at its limit the task ends, even if another record has
  the same time;
- checkpoints count in order, each within its radius and its room; arriving at a later one is shown
  and recorded each time;
- near the photo's checkpoint, once that is passed, the photo's window opens until the visitor keeps
  a photo or skips it;
- docking ends the task once all checkpoints are passed, with or without the photo; before that it
  is recorded and changes nothing. The robot is docked when it reports so and the course's rule
  (robots/api/docked.py) agrees: contact, standstill and released controls without a break. Contacts
  that are lost sooner are events, and the visitor is asked to drive on into the station;
- a door is passed where the robot's centre goes through its frame; the result lists the required
  doors that were missed.
"""

import math
from dataclasses import dataclass, replace
from typing import Any, Literal

from experiments.definition.course import CourseTrack, Motion, Sight
from experiments.definition.cues import FIRST, LEAVING, Cue, Situation, Window, choose
from experiments.definition.schema import Outcome
from experiments.tasks import records
from experiments.tasks.records import Record, Seen
from robots.api.docked import APART, DockReading, DockState, follow
from robots.api.geometry import Pose2D

CourseEvent = Literal["checkpoint", "out_of_order", "door_passed"]
DockEvent = Literal["left_station", "docked_early", "dock_contact", "dock_contact_lost", "docked"]
PhotoEvent = Literal[
    "photo_prompt", "photo_taken", "photo_failed", "photo_kept", "photo_again", "photo_skipped"
]
TaskTimes = Literal["task_started", "time_warning", "task_ended"]
EventType = Literal[TaskTimes, CourseEvent, DockEvent, PhotoEvent, "cue"]
Settled = Literal["", "kept", "skipped"]
# What an answer to a photo makes of it: the event, and whether the photo is settled.
ANSWERS: dict[str, tuple[EventType, Settled]] = {
    "keep": ("photo_kept", "kept"),
    "again": ("photo_again", ""),
    "skip": ("photo_skipped", "skipped"),
}
LEFT_M = 0.3  # a robot farther from a docked pose or a doorway has left it
# Two states show a motion only if they are at most MAX_GAP_S apart in time, and in distance at most
# MAX_JUMP_M and what MAX_SPEED (m/s) allows.
MAX_GAP_S, MAX_JUMP_M, MAX_SPEED = 2.5, 0.3, 2.5
LOST_AFTER_S = 1.0  # without localization, before the visitor reads that the robot is lost


@dataclass(frozen=True)
class ProgressEvent:
    """Something that happened once.

    `number` is that of a checkpoint or of a contact with the charger, `name` that of a door, cue,
    photo or outcome; `pose` is the last known one.
    """

    at: float
    type: EventType
    pose: Pose2D | None = None
    number: int | None = None
    name: str = ""
    sight: Sight | None = None

    def data(self) -> dict[str, Any]:
        """Return the fields that are stored beside stamp and type, without unknown ones."""
        fields: dict[str, Any] = {"number": self.number, "name": self.name or None}
        if self.pose is not None:
            fields["pose"] = {"x": self.pose.x, "y": self.pose.y, "theta": self.pose.theta}
        if self.sight is not None:
            names = ("bearing", "distance", "before", "sees")
            fields["facing"] = {name: getattr(self.sight, name) for name in names}
        return {name: value for name, value in fields.items() if value is not None}


@dataclass(frozen=True)
class PhotoState:
    """The progress of the photo; `pending` is the newest picture that waits for an answer."""

    is_open: bool = False
    prompted: bool = False
    pending: str = ""
    settled: Settled = ""

    @property
    def window(self) -> Window:
        if self.settled or not self.is_open:
            return "shut"
        return "review" if self.pending else "open"


@dataclass(frozen=True)
class Progress:
    """The state of a task.

    `last` is the newest state of the robot, `placed` the newest with a known place. `passed` has
    the time of each checkpoint, `doors` the doors passed, in order. `dock` is the state of docking
    by the course's rule, `dock_contacts` counts contacts with the charger after the last
    checkpoint. `in_doorway` has the doors whose line was crossed and that the robot has not left,
    `on_later` the later checkpoints at which the robot is.
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
        placed = self.placed
        return None if placed is None else Pose2D(placed.x, placed.y, placed.theta)

    @property
    def docked(self) -> bool:
        """Whether the robot reports to be docked and, once it has been out, the course's rule
        agrees.
        """
        return self.last is not None and self.last.docked and (self.dock.docked or not self.is_out)

    def remaining(self, track: CourseTrack, now: float) -> float | None:
        """Return the seconds left; None before the start and after the end."""
        if self.started is None or self.outcome is not None:
            return None
        return max(0.0, self.started + track.limit - now)


Stepped = tuple[Progress, tuple[ProgressEvent, ...]]


def step(track: CourseTrack, progress: Progress, record: Record) -> Stepped:
    """Take the next record; return the progress after it, and the events."""
    fold = _Fold(track, progress)
    fold.pass_time(record.at)
    if fold.progress.outcome is None:
        fold.take(record)
        fold.update_cue(record.at)
    return fold.progress, tuple(fold.events)


def until(track: CourseTrack, progress: Progress, now: float) -> Stepped:
    """Let the time pass until `now`; return the progress then, and the events."""
    fold = _Fold(track, progress)
    fold.pass_time(now)
    return fold.progress, tuple(fold.events)


class _Fold:
    """Applies the rules to one record: replaces `progress` and adds `events`."""

    def __init__(self, track: CourseTrack, progress: Progress) -> None:
        self.track, self.progress = track, progress
        self.events: list[ProgressEvent] = []

    def set(self, **changes: Any) -> None:
        self.progress = replace(self.progress, **changes)

    def add(self, at: float, kind: EventType, number: int | None = None, **about: Any) -> None:
        self.events.append(ProgressEvent(at, kind, self.progress.pose, number, **about))

    @property
    def sight(self) -> Sight | None:
        spot, pose = self.track.photo, self.progress.pose
        return spot.sight(pose) if spot is not None and pose is not None else None

    @property
    def has_passed_all(self) -> bool:
        return len(self.progress.passed) == len(self.track.stops)

    def pass_time(self, now: float) -> None:
        progress, track = self.progress, self.track
        if progress.started is None or progress.outcome is not None:
            return
        deadline = progress.started + track.limit
        if not progress.warned and 0.0 < track.last < track.limit and now >= deadline - track.last:
            self.set(warned=True)
            self.add(deadline - track.last, "time_warning")
        if now >= deadline:
            self.end(deadline, "timed_out")
            self.update_cue(deadline)

    def end(self, at: float, outcome: Outcome) -> None:
        self.set(ended=at, outcome=outcome)
        self.add(at, "task_ended", name=outcome)

    def update_cue(self, at: float) -> None:
        cue = choose(self._situation(at), self.track, self.progress.cue)
        if cue != self.progress.cue:
            self.set(cue=cue)
            self.add(at, "cue", cue.number, name=cue.key)

    def _situation(self, at: float) -> Situation:
        progress, pose, placed = self.progress, self.progress.pose, self.progress.placed
        is_unlocalized = progress.last is not None and not progress.last.localized
        return Situation(
            started=progress.started is not None,
            outcome=progress.outcome,
            lost=is_unlocalized and (placed is None or at - placed.at > LOST_AFTER_S),
            docked=progress.docked,
            early=progress.came_early,
            touching=progress.dock.touching and progress.dock_contacts > 0,
            dock_contacts=progress.dock_contacts,
            passed=len(progress.passed),
            wrong=min(progress.on_later, default=None),
            window=progress.photo.window,
            sight=self.sight,
            home=pose.distance(self.track.dock) if pose is not None else math.inf,
        )

    def take(self, record: Record) -> None:
        match record:
            case Seen():
                self._take_state(record)
            case records.TaskEnded():
                self.end(record.at, record.outcome)
            case records.FirstFrame():
                if self.progress.started is None:
                    self.set(started=record.at)
                    self.add(record.at, "task_started")
            case _ if self.progress.started is None:
                pass
            case records.PhotoFailed():
                self.add(record.at, "photo_failed", name=record.id)
            case records.PhotoTaken():  # an event even when no photo was asked for
                photo = self.progress.photo
                if photo.prompted and not photo.settled:
                    self.set(photo=replace(photo, pending=record.id))
                self.add(record.at, "photo_taken", name=record.id, sight=self.sight)
            case records.PhotoAnswer():
                self._answer_photo(record)

    def _answer_photo(self, record: records.PhotoAnswer) -> None:
        """An answer counts once the window has opened; keeping and repeating need a photo."""
        photo = self.progress.photo
        has_choice = bool(photo.pending) or record.choice == "skip"
        if photo.prompted and not photo.settled and has_choice:
            kind, settled = ANSWERS[record.choice]
            self.set(photo=replace(photo, pending="", settled=settled))
            self.add(record.at, kind, name=photo.pending)

    def _take_state(self, seen: Seen) -> None:
        before, dock = self.progress.placed, self.progress.dock
        placed = seen if seen.localized else before
        self.set(last=seen, placed=placed, dock=_dock(self.track, dock, seen))
        if self.progress.started is None:
            return
        if seen.localized:
            motion = _motion(before, seen)
            self._pass_doors(motion, seen.at)
            self._pass_checkpoints(motion, seen.at)
            self._update_photo_window(motion, seen.at)
        if self.has_passed_all and self.progress.dock.touching != dock.touching:
            self._change_contact(seen.at)
        self._leave_or_dock(seen)

    def _pass_doors(self, motion: Motion, at: float) -> None:
        """A door is passed when the robot has driven on, not when it turns in the doorway."""
        doorways = self.track.doorways
        crossed = {door.name for door in doorways if motion.crosses(door.start, door.end)}
        entered = self.progress.in_doorway ^ crossed
        if not entered and not self.progress.in_doorway:
            return
        left = [door.name for door in doorways if door.distance(*motion.end) > LEFT_M]
        passed = tuple(name for name in left if name in entered)
        self.set(in_doorway=entered - set(passed), doors=self.progress.doors + passed)
        for name in passed:
            self.add(at, "door_passed", name=name)

    def _pass_checkpoints(self, motion: Motion, at: float) -> None:
        stops, before = self.track.stops, self.progress.on_later
        while not self.has_passed_all and stops[len(self.progress.passed)].is_passed(motion):
            self.add(at, "checkpoint", stops[len(self.progress.passed)].number)
            self.set(passed=(*self.progress.passed, at))
        # the robot leaves a later checkpoint only when it is well outside
        on_later = frozenset(
            stop.number
            for stop in stops[len(self.progress.passed) + 1 :]
            if (stop.number in before and stop.distance(*motion.end) <= stop.radius * LEAVING)
            or stop.is_passed(motion)
        )
        if on_later != before:
            self.set(on_later=on_later)
            for number in sorted(on_later - before):
                self.add(at, "out_of_order", number)

    def _update_photo_window(self, motion: Motion, at: float) -> None:
        spot, photo = self.track.photo, self.progress.photo
        if spot is None or photo.settled or len(self.progress.passed) < spot.stop.number:
            return
        radius = spot.radius * (LEAVING if photo.is_open else 1.0)
        is_open = spot.stop.distance(*motion.end) <= radius
        if is_open != photo.is_open:
            self.set(photo=replace(photo, is_open=is_open, prompted=photo.prompted or is_open))
            if is_open:
                self.add(at, "photo_prompt", spot.stop.number, sight=self.sight)

    def _change_contact(self, at: float) -> None:
        """After the last checkpoint each contact with the charger is an attempt to dock."""
        if self.progress.dock.touching:
            self.set(dock_contacts=self.progress.dock_contacts + 1)
            self.add(at, "dock_contact", self.progress.dock_contacts)
        elif self.progress.dock_contacts > 0:
            self.add(at, "dock_contact_lost", self.progress.dock_contacts)

    def _leave_or_dock(self, seen: Seen) -> None:
        progress, pose = self.progress, self.progress.pose
        if not progress.docked:
            may_leave = not progress.is_out and not seen.docked and seen.localized
            if may_leave and pose is not None and pose.distance(self.track.dock) > LEFT_M:
                self.set(is_out=True)
                self.add(seen.at, "left_station", 0)
        elif self.has_passed_all and progress.dock.docked:
            self.add(seen.at, "docked", 0)
            self.end(seen.at, "completed")
        elif progress.is_out:
            self.set(is_out=False, came_early=True)
            self.add(seen.at, "docked_early", self.track.stops[len(progress.passed)].number)


def _motion(before: Seen | None, seen: Seen) -> Motion:
    """Return the motion since the last known place; none when that is too old or too far away."""
    here = (seen.x, seen.y)
    if before is None:
        return Motion(here, here)
    seconds, metres = seen.at - before.at, math.dist((before.x, before.y), here)
    followed = seconds <= MAX_GAP_S and metres <= MAX_JUMP_M + MAX_SPEED * seconds
    return Motion((before.x, before.y) if followed else here, here)


def _dock(track: CourseTrack, before: DockState, seen: Seen) -> DockState:
    if track.docked is None:
        return DockState(docked=seen.docked)
    speed = {"linear": seen.linear, "angular": seen.angular}
    reading = DockReading(at=seen.at, contact=seen.contact, released=seen.released, **speed)
    return follow(track.docked, before, reading)
