"""The task engine: records in, in whatever order and however often they come; the task's events and
outcome out.

What has happened is a fold (experiments/tasks/progress.py) over all different records in order of
time. A record that comes late is put in its place and the fold is done again from there, so that a
live session, with its losses, repetitions and delays, and the stored record give the same. The
robot's own events are not asked: whatever they say, its states say too.

States before the first picture place the robot and no more. Nothing after the end counts.
"""

from bisect import bisect_left
from dataclasses import dataclass

from experiments.definition.course import CourseTrack
from experiments.definition.cues import Cue
from experiments.definition.schema import Outcome
from experiments.tasks.progress import Progress, ProgressEvent, Settled, step, until
from experiments.tasks.records import Order, Record, identity, order

PhotoOutcome = Settled | None


@dataclass(frozen=True)
class Result:
    """The task in a few facts. `checkpoints` has the time of each that was passed; `photo` is None
    where none was asked for, "" unanswered.

    `doors` were gone through, in order; `doors_missed` were asked for, open, and not gone through.
    `dock_contacts` counts how often the charging contacts met after the last checkpoint: 1 is a
    docking that held at once.
    """

    outcome: Outcome | None
    started: float | None
    ended: float | None
    checkpoints: tuple[float, ...]
    photo: PhotoOutcome
    doors: tuple[str, ...]
    doors_missed: tuple[str, ...]
    dock_contacts: int = 0


class TaskEngine:
    """One participant's task on a course."""

    def __init__(self, track: CourseTrack) -> None:
        self.track = track
        self._now = float("-inf")
        self._known: dict[tuple[int, str, int], Record] = {}
        self._orders: list[Order] = []
        self._records: list[Record] = []
        self._folded: list[tuple[Progress, tuple[ProgressEvent, ...]]] = []
        self._told: set[ProgressEvent] = set()

    def feed(self, record: Record) -> None:
        """Take a record. Of two copies that say different times the earlier counts, whichever came
        first.
        """
        name, place = identity(record), order(record)
        known = self._known.get(name)
        if known is not None:
            if order(known) <= place:
                return
            self._remove(order(known))
        self._known[name] = record
        self._insert(place, record)
        self._now = max(self._now, record.at)

    def advance(self, now: float) -> None:
        """Tell the time: warning and end come when nothing else does, too."""
        self._now = max(self._now, now)

    def _insert(self, place: Order, record: Record) -> None:
        index = bisect_left(self._orders, place)
        self._orders.insert(index, place)
        self._records.insert(index, record)
        del self._folded[index:]

    def _remove(self, place: Order) -> None:
        index = bisect_left(self._orders, place)
        del self._orders[index], self._records[index], self._folded[index:]

    def _fold(self) -> None:
        progress = self._folded[-1][0] if self._folded else Progress()
        for record in self._records[len(self._folded) :]:
            stepped = step(self.track, progress, record)
            self._folded.append(stepped)
            progress = stepped[0]

    @property
    def progress(self) -> Progress:
        """How things stand now."""
        self._fold()
        return until(self.track, self._folded[-1][0] if self._folded else Progress(), self._now)[0]

    @property
    def events(self) -> tuple[ProgressEvent, ...]:
        """All that has happened until now, in order."""
        self._fold()
        folded = [event for _, events in self._folded for event in events]
        return (
            *folded,
            *until(self.track, self._folded[-1][0] if self._folded else Progress(), self._now)[1],
        )

    def news(self) -> tuple[ProgressEvent, ...]:
        """Return the events that were not handed out before.

        One that a late record changed is handed out again as it is now; what is stored for good is
        `events` when the session is over.
        """
        fresh = tuple(event for event in self.events if event not in self._told)
        self._told.update(fresh)
        return fresh

    @property
    def cue(self) -> Cue:
        """What the visitor is told now."""
        return self.progress.cue

    def remaining(self) -> float | None:
        """Return the seconds left once they are few enough to be shown, else None."""
        left = self.progress.remaining(self.track, self._now)
        return left if left is not None and left <= self.track.last else None

    @property
    def result(self) -> Result:
        """The task in a few facts."""
        progress = self.progress
        missed = tuple(
            door.name
            for door in self.track.doorways
            if door.required and door.name not in progress.doors
        )
        return Result(
            outcome=progress.outcome,
            started=progress.started,
            ended=progress.ended,
            checkpoints=progress.passed,
            photo=None if self.track.photo is None else progress.photo.settled,
            doors=progress.doors,
            doors_missed=missed,
            dock_contacts=progress.dock_contacts,
        )
