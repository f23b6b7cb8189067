"""The input of the task engine: the robot's states, and inputs from the page and the server.

`at` is Unix time by the server's clock. That of a state is its stamp minus the robot's clock
offset, with one offset a session, so that the stored record gives the same times again; that of an
input is when the server received it (of a photo, when it was taken). `id` identifies an input, so
that one that is received twice counts once.
"""

from dataclasses import dataclass
from typing import Literal

from experiments.definition.schema import Outcome
from robots.api.messages import State


@dataclass(frozen=True, slots=True)
class Seen:
    """The part of a state that matters to a task: metres and radians in the frame of the map, m/s
    and rad/s as measured.

    `docked` is reported by the robot, `contact` tells whether the charging contacts meet,
    `released` that no command since the previous state asked for any motion.
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


@dataclass(frozen=True)
class _Input:
    at: float
    id: str


class FirstFrame(_Input):
    """The visitor sees the robot's video: the time begins. Later ones change nothing."""


class PhotoTaken(_Input):
    """A photo was received; `id` is that of the action that requested it."""


class PhotoFailed(_Input):
    """The photo that was requested by the action `id` failed."""


@dataclass(frozen=True)
class PhotoAnswer(_Input):
    """The visitor's choice in the photo's window."""

    choice: Literal["keep", "again", "skip"]


@dataclass(frozen=True)
class TaskEnded(_Input):
    """The session has ended for a reason outside the task."""

    outcome: Outcome


Input = FirstFrame | PhotoTaken | PhotoFailed | PhotoAnswer | TaskEnded
Record = Seen | Input

# the order of records with the same time
_ORDER = (FirstFrame, Seen, PhotoTaken, PhotoFailed, PhotoAnswer, TaskEnded)


def seen(state: State, clock_offset: float) -> Seen:
    """Return a state as an input; `clock_offset` is the robot's clock minus the server's (s)."""
    pose = state.pose
    return Seen(
        state.stamp - clock_offset,
        state.boot,
        state.seq,
        pose.x,
        pose.y,
        pose.theta,
        localized=pose.localized,
        docked=state.docked,
        contact=state.docked if state.charger_contact is None else state.charger_contact,
        linear=state.velocity.linear,
        angular=state.velocity.angular,
        released=not any(command.linear or command.angular for command in state.applied),
    )


def identity(record: Record) -> tuple[int, str, int]:
    """Return what copies of one record share, and no two records do."""
    rank = _ORDER.index(type(record))
    return (rank, record.boot, record.seq) if isinstance(record, Seen) else (rank, record.id, 0)


def order(record: Record) -> tuple[float, int, str, int]:
    """Return the key by which records are sorted: time, then kind, whenever they arrive."""
    return record.at, *identity(record)
