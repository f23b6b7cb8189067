"""Tracks which states of one run of an agent have been seen, and which are owed.

An agent numbers its states without gaps, in and between sessions. A gap that touches a session is
therefore a loss in transit, and is requested from the agent, which keeps its last minutes. After a
restart of the session manager some gaps are only suspected: states before the first that is seen,
and gaps of the stored record. They are requested as often, because a request can be lost, too, but
count as no loss when the agent does not have them.
"""

from bisect import bisect_right
from collections.abc import Iterator
from dataclasses import dataclass, field

FIRST_REQUEST_S = 1.0  # after the gap; a buffered message may still arrive
REPEAT = 5.0
ATTEMPTS = 3  # at least, however long the robot was away
# At least: while its broker's node is replaced, a robot sends but does not receive.
ASKING_SECONDS = 60.0
HEAD = 240  # a minute of states
FIRST = 1  # number of an agent's first state
# A wider gap is a robot that counts wrongly, not a loss: no agent keeps so many.
MAX_GAP = 100_000

Range = tuple[int, int]


class Intervals:
    """A set of whole numbers, as disjoint inclusive ranges; growing at the end is cheap."""

    def __init__(self) -> None:
        self._firsts: list[int] = []
        self._lasts: list[int] = []

    def __contains__(self, number: int) -> bool:
        at = bisect_right(self._firsts, number) - 1
        return at >= 0 and number <= self._lasts[at]

    def __iter__(self) -> Iterator[Range]:
        return iter(zip(self._firsts, self._lasts, strict=True))

    def add(self, first: int, last: int) -> None:
        """Add the numbers from first to last."""
        if self._lasts and first == self._lasts[-1] + 1:
            self._lasts[-1] = last
            return
        low = bisect_right(self._lasts, first - 2)  # the first range that touches or follows
        high = bisect_right(self._firsts, last + 1)
        if low < high:
            first, last = min(first, self._firsts[low]), max(last, self._lasts[high - 1])
        self._firsts[low:high] = [first]
        self._lasts[low:high] = [last]

    def after(self, number: int) -> int | None:
        """Return the first number of the set that is larger than `number`, outside of its range."""
        at = bisect_right(self._firsts, number)
        return self._firsts[at] if at < len(self._firsts) else None

    def missing(self, first: int, last: int) -> list[Range]:
        """Return the ranges between first and last that are not in the set."""
        found, at = [], first
        for low, high in zip(self._firsts, self._lasts, strict=True):
            if high < at:
                continue
            if low > last:
                break
            if low > at:
                found.append((at, low - 1))
            at = high + 1
        if at <= last:
            found.append((at, last))
        return found


@dataclass(frozen=True)
class StoredStates:
    """The stored states of one session and run, as ranges, and the numbers of the session's first
    and last state, if the robot's events have them.
    """

    ranges: tuple[Range, ...] = ()
    begins: int | None = None
    ends: int | None = None


@dataclass
class Gap:
    """States that were not seen; `certain` when they must exist; `sessions` may lack them."""

    first: int
    last: int
    sessions: frozenset[str]
    certain: bool
    found_at: float
    asked_at: float | None = None
    attempts: int = 0


@dataclass(frozen=True)
class Loss:
    """States that are given up."""

    ranges: tuple[Range, ...]
    sessions: frozenset[str]

    @property
    def count(self) -> int:
        """The number of sequence numbers in the intervals."""
        return sum(last - first + 1 for first, last in self.ranges)


def _minute_before(number: int) -> Range:
    return max(FIRST, number - HEAD), number - 1


@dataclass
class SequenceTracker:
    """The states of one run (`boot`) of one robot's agent."""

    seen: Intervals = field(default_factory=Intervals)
    gaps: list[Gap] = field(default_factory=list)
    reached: int | None = None
    session: str | None = None

    def restore(self, session: str, stored: StoredStates, now: float) -> None:
        """Take over the stored states of a session, and suspect gaps where an earlier session
        manager may have received states and died before it stored them: between the stored ones,
        before them if the session's first number is unknown, and after them up to the next seen.
        """
        for first, last in stored.ranges:
            self.seen.add(first, last)
        numbers = [
            *(number for both in stored.ranges for number in both),
            *(number for number in (stored.begins, stored.ends) if number is not None),
        ]
        if not numbers:
            return
        first, last = min(numbers), max(numbers)
        following = self.seen.after(last)
        until = last if following is None or following - last > MAX_GAP else following - 1
        holes = self.seen.missing(first, until)
        if stored.begins is None:
            holes += self.seen.missing(*_minute_before(first))
        self._suspect(holes, session, now)
        if self.reached is None or last > self.reached:
            self.reached, self.session = last, session

    def suspect_before(self, session: str, now: float) -> None:
        """Suspect states of a session without any in the minute before the first one seen."""
        earliest = next(iter(self.seen), (FIRST, FIRST))[0]
        self._suspect(self.seen.missing(*_minute_before(earliest)), session, now)

    def _suspect(self, holes: list[Range], session: str, now: float) -> None:
        self.gaps += [
            Gap(*hole, frozenset({session}), certain=False, found_at=now) for hole in holes
        ]

    def arrive(self, seq: int, session: str | None, now: float) -> bool:
        """Note a state; False when it was seen before."""
        if seq - 1 == self.reached:  # nearly always
            self.reached, self.session = seq, session
            self.seen.add(seq, seq)
            return True
        if seq in self.seen:
            return False
        if self.reached is None and session is not None and seq > FIRST:
            self._suspect([_minute_before(seq)], session, now)
        self.seen.add(seq, seq)
        self._reach(seq, session, now, to=seq - 1)
        return True

    def begins(self, seq: int, session: str, now: float) -> None:
        """Note that the session's first state is `seq`."""
        self._reach(seq - 1, session, now, to=seq - 1)

    def ends(self, seq: int, session: str, now: float) -> None:
        """Note that the session's last state is `seq`."""
        if self.reached is None:
            self._suspect([(max(FIRST, seq - HEAD), seq)], session, now)
        self._reach(seq, session, now, to=seq)

    def _reach(self, seq: int, session: str | None, now: float, *, to: int) -> None:
        if self.reached is not None and seq <= self.reached:
            return
        if self.reached is not None and 0 < to - self.reached <= MAX_GAP:
            touched = frozenset(name for name in (self.session, session) if name is not None)
            if touched:
                self.gaps.append(Gap(self.reached + 1, to, touched, certain=True, found_at=now))
        self.reached, self.session = seq, session

    def due(self, now: float, *, present: bool, alive: bool) -> tuple[list[Range], list[Loss]]:
        """Return the states to request now, and those that are lost.

        Args:
            now: any clock in seconds.
            present: the robot has sent a state recently; otherwise requests wait.
            alive: this run of the agent is the robot's newest; the states of older runs are lost.
        """
        asks, losses, kept = [], [], []
        for gap in self.gaps:
            missing = self.seen.missing(gap.first, gap.last)
            if not missing:
                continue
            if not alive or self._is_hopeless(gap, now):
                losses += [Loss(tuple(missing), gap.sessions)] if gap.certain else []
                continue
            kept.append(gap)
            if (
                present
                and now - gap.found_at >= FIRST_REQUEST_S
                and (gap.asked_at is None or now - gap.asked_at >= REPEAT)
            ):
                gap.asked_at, gap.attempts = now, gap.attempts + 1
                asks += missing
        self.gaps = kept
        return asks, losses

    @staticmethod
    def _is_hopeless(gap: Gap, now: float) -> bool:
        return (
            gap.asked_at is not None
            and now - gap.asked_at >= REPEAT
            and gap.attempts >= ATTEMPTS
            and now - gap.found_at >= ASKING_SECONDS
        )

    def owes(self, session: str) -> bool:
        """Tell whether states of a session may still come."""
        return any(
            session in gap.sessions and self.seen.missing(gap.first, gap.last) for gap in self.gaps
        )
