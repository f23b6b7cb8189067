"""The runs of robots' agents, and which of their states were seen and are owed."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

from robots.api.messages import Event, State
from sessions.recording.items import CloseItem
from sessions.recording.sequence_tracker import Loss, SequenceTracker, StoredStates
from sessions.recording.store import RecordStore

PRESENT_SECONDS = 5.0
RUNS = 3  # of a robot that are kept


@dataclass
class _LastState:
    """A robot's newest run, when its last state came, and the session that the newest one named."""

    boot: str
    at: float
    session: str | None = None
    session_at: float = 0.0


class RobotRuns:
    """The runs of all robots. Belongs to the recorder's thread.

    Args:
        store: has the states that earlier session managers stored; counts those `asked` for.
        ask: called with (robot, boot, first, last) to request lost states.
    """

    def __init__(self, store: RecordStore, ask: Callable[[str, str, int, int], None]) -> None:
        self._store = store
        self._ask = ask
        self._trackers: dict[str, dict[str, SequenceTracker]] = {}
        self._restored: set[tuple[str, str]] = set()
        self._audited: set[str] = set()
        self._last: dict[str, _LastState] = {}

    def take(self, robot: str, state: State, session: str | None, now: float) -> bool:
        """Note a state of this robot's `session`; False when it was seen before."""
        tracker = self._tracker(robot, state.boot, session, now)
        last = self._last.setdefault(robot, _LastState(state.boot, now))
        last.at = now
        if tracker.reached is None or state.seq > tracker.reached:
            last.boot, last.session, last.session_at = state.boot, session, now
        return tracker.arrive(state.seq, session, now)

    def on_event(self, robot: str, event: Event, session: str, now: float) -> None:
        """Note a session's first or last state number, so that lost states there are noticed."""
        if event.type == "lease_taken":
            self._tracker(robot, event.boot, session, now).begins(event.seq, session, now)
        elif event.type == "session_closed" and event.last_seq is not None:
            self._tracker(robot, event.boot, session, now).ends(event.last_seq, session, now)

    def _tracker(self, robot: str, boot: str, session: str | None, now: float) -> SequenceTracker:
        """Return the tracker of a run. The first time that the run names a session, the stored
        states of that session are read, before anything changes.
        """
        stored = (
            None
            if session is None or (session, boot) in self._restored
            else self._store.stored_of(session, boot)
        )
        tracker = self._run(robot, boot)
        if session is not None and stored is not None:
            self._restored.add((session, boot))
            tracker.restore(session, stored, now)
        return tracker

    def _run(self, robot: str, boot: str) -> SequenceTracker:
        runs = self._trackers.setdefault(robot, {})
        tracker = runs.setdefault(boot, SequenceTracker())
        for oldest in list(runs)[: max(0, len(runs) - RUNS)]:
            del runs[oldest]
        return tracker

    def audit(self, ended: Iterable[CloseItem], now: float) -> None:
        """Find states of ended sessions that an earlier session manager received and did not store:
        perhaps no later message shows that they are missing.
        """
        for item in ended:
            known = self._last.get(item.robot)
            if item.session in self._audited or known is None:
                continue
            stored = self._store.stored_of(item.session, known.boot)
            tracker = self._run(item.robot, known.boot)
            tracker.restore(item.session, stored, now)
            if stored == StoredStates() and item.granted:
                tracker.suspect_before(item.session, now)
            self._restored.add((item.session, known.boot))
            self._audited.add(item.session)

    def settle(self, now: float) -> Iterator[tuple[str, Loss]]:
        """Request the lost states that are due, and yield those that are given up, with their
        run.
        """
        for robot, runs in self._trackers.items():
            for boot, tracker in runs.items():
                # nearly none of thousands of robots owe states
                if not tracker.gaps or (known := self._last.get(robot)) is None:
                    continue
                present = now - known.at < PRESENT_SECONDS
                asks, losses = tracker.due(now, present=present, alive=known.boot == boot)
                for first, last in asks:
                    self._store.counts["asked"] += last - first + 1
                    self._ask(robot, boot, first, last)
                yield from ((boot, loss) for loss in losses)

    def is_over(self, item: CloseItem) -> bool:
        """Tell whether the robot has left the session since its end, and owes no states of it."""
        known = self._last.get(item.robot)
        return (
            known is not None
            and known.session != item.session
            and known.session_at > item.ended_at
            and not any(
                tracker.owes(item.session)
                for tracker in self._trackers.get(item.robot, {}).values()
            )
        )

    def closed(self, session: str) -> None:
        """Forget a closed session; if its record is reopened, it is read again."""
        self._audited.discard(session)
        self._restored = {pair for pair in self._restored if pair[0] != session}

    def forget(self, has: Callable[[str], bool]) -> None:
        """Forget the robots that `has` names; if they return, their record is read again."""
        left = list(filter(has, self._last))
        boots = {boot for robot in left for boot in self._trackers.pop(robot, {})}
        self._restored = {pair for pair in self._restored if pair[1] not in boots}
        for robot in left:
            del self._last[robot]
