"""Violations that no crash may cause, from the records of robots, bases and database. Pure; times
are Unix time.

Every function returns a sentence for each violation.
"""

from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

# s from the end of a drive until the robot receives it or its deadman stops the robot, on a busy
# computer
LEAVE_SECONDS = 1.0


@dataclass(frozen=True)
class DrivePeriod:
    """A session that had its robot, from when to when; `until` is None while it has it. `outcome`
    is empty until it has ended.
    """

    session: str
    robot: str
    since: float
    until: float | None
    outcome: str = ""


@dataclass(frozen=True)
class NumberedState:
    """A state by robot, boot and number, and the session and epoch that it belongs to."""

    robot: str
    boot: str
    seq: int
    session: str
    epoch: int


def two_at_once(drives: Sequence[DrivePeriod]) -> list[str]:
    wrong = []
    for robot in {drive.robot for drive in drives}:
        own = sorted(
            (drive for drive in drives if drive.robot == robot), key=lambda drive: drive.since
        )
        for earlier, later in pairwise(own):
            if earlier.until is None or earlier.until > later.since:
                ended = (
                    "never ended"
                    if earlier.until is None
                    else f"ended {earlier.until - later.since:.3f} s later, {earlier.outcome}"
                )
                wrong.append(
                    f"{robot}: {later.session} began while somebody had it: {earlier.session}"
                    f" {ended}"
                )
    return wrong


def shared_epochs(
    states: Sequence[NumberedState], grants: Sequence[tuple[str, int, str]]
) -> list[str]:
    """Find epochs of a robot that two sessions had, in its states or in the leases that it
    received, given as (robot, epoch, session).
    """
    sessions: defaultdict[tuple[str, int], set[str]] = defaultdict(set)
    for state in states:
        sessions[state.robot, state.epoch].add(state.session)
    for robot, epoch, session in grants:
        sessions[robot, epoch].add(session)
    return [
        f"{robot}: epoch {epoch} is that of {len(found)} sessions"
        for (robot, epoch), found in sessions.items()
        if len(found) > 1
    ]


def lost(
    numbered: Mapping[str, int], states: Sequence[NumberedState], missing: Mapping[str, int]
) -> list[str]:
    """Find states that robots numbered, by session, and the record lacks, or that it has twice, or
    knows to be missing.
    """
    stored = Counter(state.session for state in states)
    wrong = [
        f"{session}: {count} numbered, {stored[session]} stored"
        for session, count in numbered.items()
        if stored[session] != count
    ]
    copies = Counter((state.robot, state.boot, state.seq) for state in states)
    wrong += [
        f"{robot}: state {seq} is stored {count} times"
        for (robot, _, seq), count in copies.items()
        if count > 1
    ]
    return wrong + [f"{session}: {count} states are missing" for session, count in missing.items()]


def moved_alone(
    moves: Mapping[str, Sequence[tuple[float, float]]],
    drives: Sequence[DrivePeriod],
    late: float = 0.0,
) -> list[str]:
    """Find motion outside of all drives of a robot; `late` is by how many seconds more the computer
    itself held things up.
    """
    wrong = []
    for robot, spans in moves.items():
        allowed = merged(
            [(drive.since, drive.until or float("inf")) for drive in drives if drive.robot == robot]
        )
        for since, until in spans:
            if not any(
                begin <= since and until <= end + LEAVE_SECONDS + late for begin, end in allowed
            ):
                wrong.append(f"{robot} moved from {since:.2f} to {until:.2f} while nobody had it")
    return wrong


def longest_pause(moments: Iterable[Sequence[float]], since: float, until: float) -> float:
    """Return the longest time between two consecutive moments of one list that ends in a span."""
    return max(
        (
            later - earlier
            for own in moments
            for earlier, later in pairwise(sorted(own))
            if since <= later <= until
        ),
        default=0.0,
    )


def merged(spans: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
    """Return spans in order, those that follow each other so soon that a robot need not stop
    between them as one.
    """
    found: list[tuple[float, float]] = []
    for since, until in sorted(spans):
        if found and since <= found[-1][1] + LEAVE_SECONDS:
            found[-1] = (found[-1][0], max(until, found[-1][1]))
        else:
            found.append((since, until))
    return found
