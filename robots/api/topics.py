"""The topic tree: telepresence/v1/<robot>/<suffix>, and the same suffixes in front of messages on
sockets and data channels.
"""

import re
from dataclasses import dataclass
from typing import Any, Literal

from robots.api import messages as m

ROOT = "telepresence/v1"
SERVER = f"{ROOT}/server"
MANAGER_STATUS = f"{SERVER}/manager"
PROBE = f"{SERVER}/probe"  # nobody listens: a web process asks the broker for its acknowledgement
Direction = Literal["from_robot", "to_robot"]
KIB = 1024

ROBOT_NAME = re.compile(r"^[a-z0-9][a-z0-9-]{0,62}$")
RESERVED_NAMES = frozenset({"server"})
_WORD = r"[A-Za-z0-9_-]{1,64}"


@dataclass(frozen=True)
class Topic:
    """One line of the topic table: what travels where, how, and how large it may be (bytes)."""

    suffix: str
    direction: Direction
    content: Any
    qos: int
    retained: bool
    limit: int
    doc: str

    def matches(self, suffix: str) -> bool:
        """Tell whether a concrete suffix, such as `signal/p1/reply`, belongs to this line."""
        return re.fullmatch(self.suffix.replace("+", _WORD), suffix) is not None


TABLE: tuple[Topic, ...] = (
    Topic(
        "connection",
        "from_robot",
        m.Connection,
        1,
        True,
        KIB,
        "presence, and the agent's last will",
    ),
    Topic(
        "factsheet", "from_robot", m.Factsheet, 1, True, 16 * KIB, "what the robot is and can do"
    ),
    Topic("state", "from_robot", m.State, 1, False, 32 * KIB, "the record, 4 Hz"),
    Topic(
        "pose",
        "from_robot",
        m.PoseUpdate,
        0,
        False,
        KIB,
        "pose for the page, at most 15 Hz while driven and 30 Hz while the head tilts",
    ),
    Topic("scan", "from_robot", m.Scan, 0, False, 32 * KIB, "laser ranges"),
    Topic("path", "from_robot", m.Path, 0, False, 64 * KIB, "the path being followed"),
    Topic("event", "from_robot", m.Event, 1, False, 4 * KIB, "what happened once"),
    Topic("action", "from_robot", m.ActionStatus, 1, False, 4 * KIB, "the progress of an action"),
    Topic(
        "words",
        "from_robot",
        m.Words,
        1,
        False,
        4 * KIB,
        "messages between the visitor and the people at the robot",
    ),
    Topic(
        "receipt",
        "from_robot",
        m.Receipt,
        1,
        False,
        KIB,
        "what happened to the driver's words at the robot, for the driver",
    ),
    Topic(
        "pointer",
        "from_robot",
        m.Pointer,
        0,
        False,
        KIB,
        "where one side points on the screen that the driver shares, for the other",
    ),
    Topic(
        "heartbeat",
        "from_robot",
        m.Heartbeat,
        0,
        False,
        4 * KIB,
        "5 Hz, with the echo of each peer",
    ),
    Topic(
        "signal/+/reply",
        "from_robot",
        m.SignalReply,
        1,
        False,
        128 * KIB,
        "WebRTC answer, candidate, bye",
    ),
    Topic("photo/+", "from_robot", bytes, 1, False, 512 * KIB, "a JPEG"),
    Topic(
        "picture",
        "from_robot",
        bytes,
        0,
        False,
        48 * KIB,
        "capture stamp (8 bytes, float64, big-endian) and a JPEG; at most one a request",
    ),
    Topic(
        "picture/+",
        "from_robot",
        bytes,
        0,
        False,
        48 * KIB,
        "the same, for the page of one peer alone: while a network lab impairs its driver",
    ),
    Topic("lease", "to_robot", m.Lease, 1, True, 4 * KIB, "who drives; empty means nobody"),
    Topic(
        "config",
        "to_robot",
        m.Config,
        1,
        True,
        8 * KIB,
        "assist level, network lab, simulator's doors",
    ),
    Topic("floorplan", "to_robot", m.FloorPlanUpdate, 1, True, 1024 * KIB, "the map"),
    Topic(
        "command/velocity",
        "to_robot",
        m.VelocityCommand,
        0,
        False,
        KIB,
        "10 to 20 Hz while driving",
    ),
    Topic(
        "command/heartbeat",
        "to_robot",
        m.CommandHeartbeat,
        0,
        False,
        KIB,
        "5 Hz from the driver's page and from the server",
    ),
    Topic(
        "command/action",
        "to_robot",
        m.AnyAction,
        1,
        False,
        64 * KIB,
        "everything else that a robot can be asked to do",
    ),
    Topic(
        "command/picture",
        "to_robot",
        m.PictureRequest,
        0,
        False,
        KIB,
        "one more JPEG frame, for a page that WebRTC does not reach",
    ),
    Topic(
        "command/point",
        "to_robot",
        m.PointCommand,
        0,
        False,
        KIB,
        "where a hand is on the screen that the driver shares",
    ),
    Topic(
        "signal/+",
        "to_robot",
        m.Signal,
        1,
        False,
        128 * KIB,
        "WebRTC offer, candidate, bye, and the server's confirmation that a page may stay",
    ),
)

# On the data channel a frame is the suffix, a newline, and the message. These travel there besides
# the broker's own.
DATA_CHANNEL_ONLY: tuple[Topic, ...] = (
    Topic("media", "from_robot", m.MediaClock, 0, False, KIB, "RTP timestamp to capture stamp"),
)
FROM_PAGE = (
    "command/velocity",
    "command/heartbeat",
    "command/action",
    "command/picture",
    "command/point",
)
# To every page; `pointer` goes to one side alone, and is none of these.
TO_PAGE = ("state", "pose", "path", "scan", "event", "action", "heartbeat", "media")


_PLAIN = {topic.suffix: topic for topic in (*TABLE, *DATA_CHANNEL_ONLY) if "+" not in topic.suffix}


def find(suffix: str) -> Topic | None:
    """Return the line of the table that a concrete suffix belongs to, or None."""
    plain = _PLAIN.get(suffix)
    return plain or next(
        (topic for topic in (*TABLE, *DATA_CHANNEL_ONLY) if topic.matches(suffix)), None
    )


def of(robot: str, suffix: str) -> str:
    """Return the full topic of a robot's suffix."""
    return f"{ROOT}/{robot}/{suffix}"


def parse(topic: str) -> tuple[str, str] | None:
    """Return (robot, suffix) of a full topic, or None when it is not one of ours."""
    if not topic.startswith(ROOT + "/"):
        return None
    robot, _, suffix = topic[len(ROOT) + 1 :].partition("/")
    return (robot, suffix) if suffix and ROBOT_NAME.match(robot) else None


def subscriptions(robot: str) -> tuple[tuple[str, int], ...]:
    """Return the (filter, QoS) pairs that an agent subscribes to: its own inputs, and its presence
    (see Connection).
    """
    inputs = tuple((of(robot, t.suffix), t.qos) for t in TABLE if t.direction == "to_robot")
    return (*inputs, (of(robot, "connection"), 1))


def robot_permissions(robot: str) -> dict[str, tuple[str, ...]]:
    """Return the filters a robot's own user may `write` and `read`; everything else is refused by
    the broker.
    """
    return {
        "write": tuple(of(robot, t.suffix) for t in TABLE if t.direction == "from_robot"),
        "read": tuple(topic for topic, _ in subscriptions(robot)),
    }


def session_notices(session: str) -> str:
    """Return the topic on which servers tell each other about one session."""
    return f"{SERVER}/session/{session}"
