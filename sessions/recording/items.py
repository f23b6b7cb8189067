"""The recorder's input: messages with the time of their receipt, Unix seconds."""

from collections.abc import Callable
from dataclasses import dataclass

from robots.api.messages import ActionStatus, Event, State
from sessions.protocol import PageReport


@dataclass(frozen=True, slots=True)
class StateItem:
    """A state, decoded and as `payload`; `clock_offset` is the robot's clock minus ours then, in
    seconds. A `late` one is not the newest.
    """

    robot: str
    state: State
    payload: bytes
    received_at: float
    clock_offset: float | None
    late: bool = False


@dataclass(frozen=True, slots=True)
class EventItem:
    """An event of a robot."""

    robot: str
    event: Event
    received_at: float


@dataclass(frozen=True, slots=True)
class ActionItem:
    """The end of an action; `session` is the one that the robot was in."""

    robot: str
    session: str
    status: ActionStatus
    received_at: float


@dataclass(frozen=True, slots=True)
class PhotoItem:
    """A JPEG; its event has the SHA-256 and arrives separately."""

    robot: str
    action_id: str
    jpeg: bytes
    received_at: float


@dataclass(frozen=True, slots=True)
class PageItem:
    """A page's report for the record."""

    report: PageReport
    received_at: float


@dataclass(frozen=True, slots=True)
class CloseItem:
    """The session ended at `ended_at`: close its record when no states are owed any more. Repeated
    until `closed_at` is set. `granted`: it had the robot.
    """

    robot: str
    session: str
    ended_at: float
    granted: bool = True


@dataclass(frozen=True, slots=True)
class ReleaseItem:
    """Write and forget everything about the robots that `has` names, and call `done`."""

    has: Callable[[str], bool]
    done: Callable[[], object]


# Bytes of memory for each byte of a message, and for each item.
DECODED, OVERHEAD = 3, 512


def memory_of(item: "Item") -> tuple[str, int]:
    """Return the robot or session that an item's memory is charged to, and about how many bytes."""
    match item:
        case StateItem():
            return item.robot, OVERHEAD + DECODED * len(item.payload)
        case PhotoItem():
            return item.robot, OVERHEAD + len(item.jpeg)
        case PageItem():
            return item.report.session, OVERHEAD + DECODED * len(bytes(item.report.message))
        case EventItem() | ActionItem():
            return item.robot, OVERHEAD + DECODED * 1024
    return "", OVERHEAD


Item = StateItem | EventItem | ActionItem | PhotoItem | PageItem | CloseItem | ReleaseItem
