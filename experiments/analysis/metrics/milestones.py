"""Times at which a session reached its milestones, by the events of the task engine."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

from experiments.dataset.columns import Floats
from experiments.dataset.records import EventRecord, SessionRecord
from experiments.dataset.trajectory import Trajectory
from experiments.definition.schema import Course

CHECKPOINT = "checkpoint"
DOCKED = "docked"
STARTED, ENDED = "task_started", "task_ended"
PHOTO_KEPT = "photo_kept"
TASK = "task"  # robot and page report docking and photos as well, by clocks of their own
NEAR_DOCK, OFF_DOCK = 0.8, 1.1  # m: coming nearer is an attempt to dock, going farther gives it up


@dataclass(frozen=True)
class Milestones:
    """Times in the session's seconds, NaN if not reached; checkpoints by number, without 0."""

    start: float = math.nan
    motion: float = math.nan
    checkpoints: Mapping[int, float] = field(default_factory=dict)
    docked: float = math.nan
    photo: float = math.nan
    end: float = math.nan

    @property
    def last_checkpoint(self) -> float:
        return max(self.checkpoints.values(), default=math.nan)


def milestones(
    session: SessionRecord, events: Iterable[EventRecord], course: Course | None
) -> Milestones:
    """Return the milestones of a session; docking counts once every checkpoint was passed."""
    own = sorted((event for event in events if event.source == TASK), key=lambda event: event.stamp)
    passed: dict[int, float] = {}
    for event in own:
        number = event.data.get("number")
        if event.type == CHECKPOINT and isinstance(number, int) and number > 0:
            passed.setdefault(number, event.stamp)
    stops = (stop.number for stop in course.checkpoints if stop.number > 0) if course else ()
    ready = max((passed.get(number, math.inf) for number in stops), default=-math.inf)

    def first(kind: str, default: float = math.nan, since: float = -math.inf) -> float:
        found = (event.stamp for event in own if event.type == kind and event.stamp >= since)
        return next(found, default)

    start, end = first(STARTED, session.first_frame), first(ENDED, session.ended)
    docked, photo = first(DOCKED, since=ready), first(PHOTO_KEPT)
    return Milestones(start, session.first_motion, passed, docked, photo, end)


def docking_attempts(track: Trajectory, dock: tuple[float, float], start: float) -> int:
    """Count how often a robot came near its charging station, (x, y) in metres, after a time."""
    later = track.between(start, math.nan)
    away: Floats = ((later.states["x"] - dock[0]) ** 2 + (later.states["y"] - dock[1]) ** 2) ** 0.5
    count, is_near = 0, False
    for distance in away.tolist():
        if not is_near and distance < NEAR_DOCK:
            count, is_near = count + 1, True
        elif distance > OFF_DOCK:
            is_near = False
    return count
