"""The task engine: takes records in any order, and repeatedly, and returns the task's events and
outcome.

They are a fold (experiments/tasks/progress.py) over all different records in order of time. A late
record is inserted at its time and the fold is repeated from there, so that a live session, with its
losses, repetitions and delays, and the stored record give the same result. The robot's own events
are not used, because its states contain the same facts.

States before the first video frame only give the robot's pose. Nothing after the end counts.
"""

from bisect import bisect_left, insort
from dataclasses import dataclass

from experiments.definition.course import CourseTrack
from experiments.definition.schema import Outcome
from experiments.tasks.progress import Progress, ProgressEvent, Settled, Stepped, step, until
from experiments.tasks.records import Record, identity, order


@dataclass(frozen=True)
class Result:
    """The result of a task. `checkpoints` has the time of each that was passed; `photo` is None
    where none was requested and "" without an answer.

    `doors` were passed, in order; `doors_missed` were required and not passed. `dock_contacts`
    counts how often the charging contacts met after the last checkpoint: 1 is a docking that held
    at once.
    """

    outcome: Outcome | None
    started: float | None
    ended: float | None
    checkpoints: tuple[float, ...]
    photo: Settled | None
    doors: tuple[str, ...]
    doors_missed: tuple[str, ...]
    dock_contacts: int = 0


class TaskEngine:
    def __init__(self, track: CourseTrack) -> None:
        self.track = track
        self._now = float("-inf")
        self._known: dict[tuple[int, str, int], Record] = {}
        self._records: list[Record] = []  # in order of time
        self._folded: list[Stepped] = []  # of the first records
        self._reported: set[ProgressEvent] = set()

    def feed(self, record: Record) -> None:
        """Take a record. Of two copies with different times the earlier counts."""
        name, place = identity(record), order(record)
        known = self._known.get(name)
        if known is not None:
            if order(known) <= place:
                return
            index = bisect_left(self._records, order(known), key=order)
            del self._records[index], self._folded[index:]
        self._known[name] = record
        del self._folded[bisect_left(self._records, place, key=order) :]
        insort(self._records, record, key=order)
        self._now = max(self._now, record.at)

    def advance(self, now: float) -> None:
        """Set the time (Unix seconds), so that warning and end need no other record."""
        self._now = max(self._now, now)

    def _until_now(self) -> Stepped:
        """Fold the records that were not folded yet; return the progress now, and the events that
        time alone has caused since the last record.
        """
        progress = self._folded[-1][0] if self._folded else Progress()
        for record in self._records[len(self._folded) :]:
            self._folded.append(step(self.track, progress, record))
            progress = self._folded[-1][0]
        return until(self.track, progress, self._now)

    @property
    def progress(self) -> Progress:
        return self._until_now()[0]

    @property
    def events(self) -> tuple[ProgressEvent, ...]:
        _progress, latest = self._until_now()
        return (*(event for _, events in self._folded for event in events), *latest)

    def news(self) -> tuple[ProgressEvent, ...]:
        """Return the events that were not returned before. One that a late record changed is
        returned again in its new form; the final list is `events` when the session is over.
        """
        fresh = tuple(event for event in self.events if event not in self._reported)
        self._reported.update(fresh)
        return fresh

    def remaining(self) -> float | None:
        """Return the seconds left once they are few enough to be shown, else None."""
        left = self.progress.remaining(self.track, self._now)
        return left if left is not None and left <= self.track.last else None

    @property
    def result(self) -> Result:
        progress = self.progress
        required = (door.name for door in self.track.doorways if door.required)
        return Result(
            outcome=progress.outcome,
            started=progress.started,
            ended=progress.ended,
            checkpoints=progress.passed,
            photo=None if self.track.photo is None else progress.photo.settled,
            doors=progress.doors,
            doors_missed=tuple(name for name in required if name not in progress.doors),
            dock_contacts=progress.dock_contacts,
        )
