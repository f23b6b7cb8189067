"""When a session came how far: first picture, first motion, checkpoints, the dock. From events,
which the task engine made.
"""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

from experiments.analysis.metrics.motion import Trajectory
from experiments.dataset.columns import Floats
from experiments.dataset.records import EventRecord, SessionRecord
from experiments.definition.schema import Course

CHECKPOINT = "checkpoint"
DOCKED = "docked"
STARTED, ENDED = "task_started", "task_ended"
PHOTO_KEPT = "photo_kept"
TASK = "task"  # robot and page tell of docking and photos as well, by clocks of their own
NEAR_DOCK, OFF_DOCK = 0.8, 1.1  # m: coming nearer is an attempt to dock, going farther gives it up


@dataclass(frozen=True)
class Milestones:
    """Times in the session's seconds, NaN for what never came. `checkpoints` has those after the
    charging station, by number.
    """

    start: float = math.nan
    motion: float = math.nan
    checkpoints: Mapping[int, float] = field(default_factory=dict)
    docked: float = math.nan
    photo: float = math.nan
    end: float = math.nan

    @property
    def last_checkpoint(self) -> float:
        """When the last checkpoint that was passed was passed."""
        return max(self.checkpoints.values(), default=math.nan)


def milestones(
    session: SessionRecord, events: Iterable[EventRecord], course: Course | None
) -> Milestones:
    """Return when a session came how far, from its own events; docking counts once every checkpoint
    was passed.
    """
    own = sorted((event for event in events if event.source == TASK), key=lambda event: event.stamp)
    passed: dict[int, float] = {}
    for event in own:
        number = event.data.get("number")
        if event.type == CHECKPOINT and isinstance(number, int) and number > 0:
            passed.setdefault(number, event.stamp)
    wanted = (
        [stop.number for stop in course.checkpoints if stop.number > 0]
        if course is not None
        else []
    )
    ready = (
        max((passed[number] for number in wanted), default=-math.inf)
        if set(wanted) <= set(passed)
        else math.nan
    )
    docked = next(
        (event.stamp for event in own if event.type == DOCKED and event.stamp >= ready), math.nan
    )
    photo = next((event.stamp for event in own if event.type == PHOTO_KEPT), math.nan)
    start = next((event.stamp for event in own if event.type == STARTED), session.first_frame)
    end = next((event.stamp for event in own if event.type == ENDED), session.ended)
    return Milestones(start, session.first_motion, passed, docked, photo, end)


def docking_attempts(track: Trajectory, dock: tuple[float, float], start: float) -> int:
    """Count how often a robot came near its charging station after a time."""
    later = track.between(start, math.nan)
    away: Floats = ((later.states["x"] - dock[0]) ** 2 + (later.states["y"] - dock[1]) ** 2) ** 0.5
    count, near = 0, False
    for distance in away.tolist():
        if not near and distance < NEAR_DOCK:
            count, near = count + 1, True
        elif distance > OFF_DOCK:
            near = False
    return count
