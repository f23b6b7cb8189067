"""The topics: telepresence/v1/<robot>/<suffix>. Sockets and data channels use the same suffixes."""

import re
from dataclasses import dataclass
from functools import partial
from typing import Any, Literal

from robots.api import messages as m

ROOT = "telepresence/v1"
SERVER = f"{ROOT}/server"
MANAGER_STATUS = f"{SERVER}/manager"
PROBE = f"{SERVER}/probe"  # without subscribers: a web process tests that the broker acknowledges
Direction = Literal["from_robot", "to_robot"]
KIB = 1024

ROBOT_NAME = re.compile(r"^[a-z0-9][a-z0-9-]{0,62}$")
RESERVED_NAMES = frozenset({"server"})
_WORD = r"[A-Za-z0-9_-]{1,64}"


@dataclass(frozen=True)
class Topic:
    """One line of the topic table: what travels where, how, and how large it may be (bytes)."""

    direction: Direction
    suffix: str
    content: Any
    limit: int
    doc: str
    qos: int = 0
    retained: bool = False

    def matches(self, suffix: str) -> bool:
        """Tell whether a concrete suffix, such as `signal/p1/reply`, belongs to this line."""
        return re.fullmatch(self.suffix.replace("+", _WORD), suffix) is not None


_from_robot, _to_robot = partial(Topic, "from_robot"), partial(Topic, "to_robot")
TABLE: tuple[Topic, ...] = (
    _from_robot(
        "connection", m.Connection, KIB, "presence, and the agent's last will", qos=1, retained=True
    ),
    _from_robot(
        "factsheet", m.Factsheet, 16 * KIB, "what the robot is and can do", qos=1, retained=True
    ),
    _from_robot("state", m.State, 32 * KIB, "the record, 4 Hz", qos=1),
    _from_robot(
        "pose",
        m.PoseUpdate,
        KIB,
        "pose for the page, at most 15 Hz while driven and 30 Hz while the head tilts",
    ),
    _from_robot("scan", m.Scan, 32 * KIB, "laser ranges"),
    _from_robot("path", m.Path, 64 * KIB, "the path being followed"),
    _from_robot("route", m.RoutePreview, 16 * KIB, "where a goto would lead, for the driver"),
    _from_robot("event", m.Event, 4 * KIB, "what happened once", qos=1),
    _from_robot("action", m.ActionStatus, 4 * KIB, "the progress of an action", qos=1),
    _from_robot(
        "words", m.Words, 4 * KIB, "messages between the visitor and the people at the robot", qos=1
    ),
    _from_robot(
        "receipt",
        m.Receipt,
        KIB,
        "what happened to the driver's words at the robot, for the driver",
        qos=1,
    ),
    _from_robot(
        "pointer",
        m.Pointer,
        KIB,
        "where one side points on the screen that the driver shares, for the other",
    ),
    _from_robot("heartbeat", m.Heartbeat, 4 * KIB, "5 Hz, with the echo of each peer"),
    _from_robot("signal/+/reply", m.SignalReply, 128 * KIB, "WebRTC answer, candidate, bye", qos=1),
    _from_robot("photo/+", bytes, 512 * KIB, "a JPEG", qos=1),
    _from_robot(
        "picture",
        bytes,
        48 * KIB,
        "capture stamp (8 bytes, float64, big-endian) and a JPEG; at most one a request",
    ),
    _from_robot(
        "picture/+",
        bytes,
        48 * KIB,
        "the same, for the page of one peer alone: while a network lab impairs its driver",
    ),
    _to_robot("lease", m.Lease, 4 * KIB, "who drives; empty means nobody", qos=1, retained=True),
    _to_robot(
        "config",
        m.Config,
        8 * KIB,
        "assist level, network lab, simulator's doors",
        qos=1,
        retained=True,
    ),
    _to_robot("floorplan", m.FloorPlanUpdate, 1024 * KIB, "the map", qos=1, retained=True),
    _to_robot("command/velocity", m.VelocityCommand, KIB, "10 to 20 Hz while driving"),
    _to_robot(
        "command/heartbeat",
        m.CommandHeartbeat,
        KIB,
        "5 Hz from the driver's page and from the server",
    ),
    _to_robot(
        "command/action",
        m.AnyAction,
        64 * KIB,
        "everything else that a robot can be asked to do",
        qos=1,
    ),
    _to_robot(
        "command/picture",
        m.PictureRequest,
        KIB,
        "one more JPEG frame, for a page that WebRTC does not reach",
    ),
    _to_robot(
        "command/point", m.PointCommand, KIB, "where a hand is on the screen that the driver shares"
    ),
    _to_robot("command/route", m.RouteRequest, KIB, "where a goto would lead"),
    _to_robot(
        "signal/+",
        m.Signal,
        128 * KIB,
        "WebRTC offer, candidate, bye, and the server's confirmation that a page may stay",
        qos=1,
    ),
)

# On the data channel a frame is the suffix, a newline, and the message. These travel there besides
# the broker's own.
DATA_CHANNEL_ONLY: tuple[Topic, ...] = (
    _from_robot("media", m.MediaClock, KIB, "RTP timestamp to capture stamp"),
)
FROM_PAGE = (
    "command/velocity",
    "command/heartbeat",
    "command/action",
    "command/picture",
    "command/point",
    "command/route",
)
# To every page; `pointer` goes to one side alone, and is none of these.
TO_PAGE = ("state", "pose", "path", "scan", "route", "event", "action", "heartbeat", "media")


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


def subscriptions(robot: str) -> tuple[str, ...]:
    """Return the filters that an agent subscribes to at QoS 0: its inputs and its connection.

    QoS 1 would only add acknowledgements, as the session ends with the connection. NATS creates a
    queue for each subscription at QoS 1, and can lose messages of others while it does.
    """
    inputs = (of(robot, topic.suffix) for topic in TABLE if topic.direction == "to_robot")
    return (*inputs, of(robot, "connection"))


def session_notices(session: str) -> str:
    """Return the topic on which servers tell each other about one session."""
    return f"{SERVER}/session/{session}"
