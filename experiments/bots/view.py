"""A driving bot's knowledge: the messages of the server and the robot to its page."""

import cmath
import contextlib
import statistics
from collections import Counter, deque
from dataclasses import dataclass, field
from typing import Any

import msgspec

from robots.api import codec, picture as pictures, topics
from robots.api.errors import Rejection
from robots.api.geometry import Pose2D
from robots.api.messages import ActionStatus, Heartbeat, Pose as RobotPose, PoseUpdate, Scan, State
from sessions import protocol

RECENT = 7  # measurements of which the median is taken
AT_CENTRE = Pose2D(0.0, 0.0, 0.0)
NO_TASK = protocol.Task(session="none", stamp=0.0)


@dataclass
class View:
    """The newest of everything. Times are Unix seconds of this computer, but for `frame`, the stamp
    of the newest image, which is the robot's.
    """

    session: str | None = None
    epoch: int = 0
    peer: str | None = None
    granted: bool = False
    interface: str = ""  # the profile of the page that the session's terms fix
    assist: str = ""  # the assistance that they fix
    queued: bool = False
    turn: bool = False
    refused: str = ""
    ended: protocol.Ended | None = None
    pose: Pose2D | None = None
    localized: bool = False
    docked: bool = False
    contact: bool = False  # the charging contacts meet
    state: State | None = None
    scan: Scan | None = None
    scan_pose: Pose2D | None = None
    laser: Pose2D = AT_CENTRE  # on the robot, from the factsheet
    frame: float | None = None
    frames: int = 0
    awaiting_picture: bool = False
    task: protocol.Task = NO_TASK
    actions: dict[str, ActionStatus] = field(default_factory=dict)
    denied: Counter[str] = field(default_factory=Counter)
    assists: set[str] = field(default_factory=set)
    beat: tuple[int, float, float] | None = None  # the robot's newest: n, stamp, when it arrived
    trips: deque[float] = field(default_factory=lambda: deque(maxlen=RECENT))
    ages: deque[float] = field(default_factory=lambda: deque(maxlen=RECENT))

    def take(self, frame: str | bytes, now: float) -> None:
        """Take a frame of the WebSocket; one that bots do not read is ignored."""
        with contextlib.suppress(Rejection, msgspec.DecodeError):
            self._take(*_read(frame), now)

    def _take(self, suffix: str, message: Any, now: float) -> None:  # noqa: C901, PLR0912 -- a table
        match message:
            case State():
                self._take_pose(message.pose)
                self.state, self.docked, contact = message, message.docked, message.charger_contact
                self.contact = message.docked if contact is None else contact
                if message.session == self.session:
                    self.assists.add(message.assist)
            case PoseUpdate():
                self._take_pose(message.pose)
            case Scan():
                self.scan, self.scan_pose = message, self.pose
            case Heartbeat():
                self._take_beat(message, now)
            case ActionStatus():
                self.actions[message.action_id] = message
            case protocol.Task():
                self.task = message
            case protocol.Granted():
                self.session, self.epoch, self.peer = message.session, message.epoch, message.peer
                self.granted, self.queued = True, False
                terms = message.terms or protocol.GrantedTerms()
                self.interface, self.assist = terms.interface, terms.assist or ""
            case protocol.Queued():
                self.session, self.queued, self.turn = message.session, True, False
            case protocol.Offered():
                self.turn = True
            case protocol.Refused():
                self.refused = message.reason
            case protocol.Ended():
                self.ended = message
            case protocol.Denied():
                self.denied[message.reason] += 1
            case (stamp, _jpeg) if suffix == pictures.SUFFIX:
                if self.frame is not None:
                    self.ages.append(now - self.frame)
                self.frame, self.frames, self.awaiting_picture = stamp, self.frames + 1, False

    def _take_pose(self, pose: RobotPose) -> None:
        self.pose, self.localized = Pose2D(pose.x, pose.y, pose.theta), pose.localized

    def _take_beat(self, beat: Heartbeat, now: float) -> None:
        self.beat = (beat.n, beat.stamp, now)
        for echo in beat.echoes:
            if echo.peer == self.peer:
                trip = now - echo.stamp - (beat.stamp - echo.received)
                self.trips.append(max(0.0, trip))

    @property
    def round_trip(self) -> float | None:
        """The median of the last round trips to the robot, in seconds; None before the first."""
        return statistics.median(self.trips) if self.trips else None

    @property
    def image_age(self) -> float | None:
        """The age of an image when the next one arrives, in seconds; None before the second."""
        return statistics.median(self.ages) if self.ages else None

    def points(self) -> list[tuple[float, float]]:
        """Return the points of the last sweep of the laser, in metres on the map."""
        if self.scan is None or self.scan_pose is None:
            return []
        world_from_laser, scan, points = self.scan_pose.compose(self.laser), self.scan, []
        for number, distance in enumerate(scan.ranges):
            if distance is not None and distance < scan.range_max:
                beam = cmath.rect(distance, scan.angle_min + number * scan.angle_increment)
                points.append(world_from_laser.apply(beam.real, beam.imag))
        return points


def _read(frame: str | bytes) -> tuple[str, Any]:
    if isinstance(frame, bytes):
        name, _, payload = frame.partition(b"\n")
        return name.decode("ascii", "replace"), pictures.unpack(payload)
    suffix, _, text = frame.partition("\n")
    kind = protocol.TO_PAGE.get(suffix)
    if kind is not None:
        return suffix, msgspec.json.decode(text, type=kind)
    if suffix in topics.TO_PAGE:
        return suffix, codec.decode(suffix, text, "from_robot")
    raise Rejection("unknown_topic", suffix[:80])
