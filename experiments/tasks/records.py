"""What the task engine is fed with: the robot's states, and inputs from the page and the server.

`at` is Unix time by the server's clock. A state's is its stamp less the robot's clock offset, with
one offset a session, so that the stored record gives the same times again; an input's is when the
server received it (a photo's: when it was taken). `id` tells an input from every other one, so that
one which comes twice counts once.
"""

from dataclasses import dataclass
from typing import Literal

from experiments.definition.schema import Outcome
from robots.api.messages import State


@dataclass(frozen=True, slots=True)
class Seen:
    """A state, as far as the task minds: metres and radians in the frame of the map, m/s and rad/s
    as measured.

    `docked` is the robot's word, `contact` whether the charging contacts meet; `released` tells
    that no command since the state before asked for any motion.
    """

    at: float
    boot: str
    seq: int
    x: float
    y: float
    theta: float
    localized: bool = True
    docked: bool = False
    contact: bool = False
    linear: float = 0.0
    angular: float = 0.0
    released: bool = True


@dataclass(frozen=True, slots=True)
class FirstFrame:
    """The visitor sees the robot's picture: from here on the time counts. Later ones (a page that
    was loaded again) change nothing.
    """

    at: float
    id: str


@dataclass(frozen=True, slots=True)
class PhotoTaken:
    """A picture has come; `id` is that of the action that asked for it."""

    at: float
    id: str


@dataclass(frozen=True, slots=True)
class PhotoFailed:
    """The picture that was asked for with the action `id` will not come."""

    at: float
    id: str


@dataclass(frozen=True, slots=True)
class PhotoAnswer:
    """What the visitor chose in the photo's window."""

    at: float
    id: str
    choice: Literal["keep", "again", "skip"]


@dataclass(frozen=True, slots=True)
class TaskEnded:
    """The session is over for a reason that the task does not know of."""

    at: float
    id: str
    outcome: Outcome


Input = FirstFrame | PhotoTaken | PhotoFailed | PhotoAnswer | TaskEnded
Record = Seen | Input
Order = tuple[float, int, str, int]

_RANK: dict[type[Record], int] = {
    FirstFrame: 0,
    Seen: 1,
    PhotoTaken: 2,
    PhotoFailed: 3,
    PhotoAnswer: 4,
    TaskEnded: 5,
}


def seen(state: State, clock_offset: float) -> Seen:
    """Return a state as the engine takes it; `clock_offset` is the robot's clock minus the
    server's, in seconds.
    """
    pose = state.pose
    at = state.stamp - clock_offset
    contact = state.docked if state.charger_contact is None else state.charger_contact
    return Seen(
        at,
        state.boot,
        state.seq,
        pose.x,
        pose.y,
        pose.theta,
        localized=pose.localized,
        docked=state.docked,
        contact=contact,
        linear=state.velocity.linear,
        angular=state.velocity.angular,
        released=not any(command.linear or command.angular for command in state.applied),
    )


def identity(record: Record) -> tuple[int, str, int]:
    """Return what two copies of one record share, and no two records do."""
    rank = _RANK[type(record)]
    return (rank, record.boot, record.seq) if isinstance(record, Seen) else (rank, record.id, 0)


def order(record: Record) -> Order:
    """Return by what records are put in order: time, then kind, so that none depends on when it
    came.
    """
    rank, name, number = identity(record)
    return record.at, rank, name, number
