"""What a bot at the wheel knows: what the server and the robot have told its page, and nothing
else.
"""

import math
import statistics
from collections import deque
from dataclasses import dataclass, field
from typing import Any

import msgspec

from robots.api import codec, topics
from robots.api import picture as pictures
from robots.api.errors import Rejection
from robots.api.geometry import Pose2D
from robots.api.messages import ActionStatus, Heartbeat, PoseUpdate, Scan, State
from robots.api.messages import Pose as RobotPose
from sessions import protocol

TRIPS = 7
AT_CENTRE = Pose2D(0.0, 0.0, 0.0)


NO_TASK = protocol.Task(session="none", stamp=0.0)


@dataclass
class View:
    """The newest of everything. Times are Unix seconds of this computer, but for `frame`, which the
    robot's clock made.
    """

    session: str | None = None
    epoch: int = 0
    peer: str | None = None
    granted: bool = False
    interface: str = ""  # the profile of the page that the terms of the visit fix
    assist: str = ""  # the assistance that they fix
    queued: bool = False
    turn: bool = False
    refused: str = ""
    ended: protocol.Ended | None = None
    online: bool = True
    pose: Pose2D | None = None
    localized: bool = False
    docked: bool = False
    contact: bool = False  # the charging contacts meet
    tilt: float | None = None
    state: State | None = None
    states: int = 0
    scan: Scan | None = None
    scan_pose: Pose2D | None = None
    laser: Pose2D = AT_CENTRE  # where it sits on the robot, as the factsheet says
    frame: float | None = None
    frames: int = 0
    awaiting_picture: bool = False
    task: protocol.Task = NO_TASK
    task_frames: int = 0
    actions: dict[str, ActionStatus] = field(default_factory=dict)
    denied: dict[str, int] = field(default_factory=dict)
    assists: set[str] = field(default_factory=set)
    # the robot's newest: n, its stamp, when it came
    beats: list[tuple[int, float, float]] = field(default_factory=list)
    trips: deque[float] = field(default_factory=lambda: deque(maxlen=TRIPS))

    def take(self, frame: str | bytes, now: float) -> None:
        """Take a frame of the WebSocket; what is no frame that this bot reads is left alone."""
        try:
            suffix, message = _read(frame)
        except (Rejection, msgspec.DecodeError):
            return
        self._take(suffix, message, now)

    def _take(self, suffix: str, message: Any, now: float) -> None:  # noqa: C901, PLR0912 -- table
        match message:
            case State():
                self._state(message)
            case PoseUpdate():
                self._pose(message.pose, message.tilt)
            case Scan():
                self.scan, self.scan_pose = message, self.pose
            case Heartbeat():
                self._beat(message, now)
            case ActionStatus():
                self.actions[message.action_id] = message
            case protocol.Task():
                self.task, self.task_frames = message, self.task_frames + 1
            case protocol.Granted():
                self.session, self.epoch, self.peer, self.granted, self.queued = (
                    message.session,
                    message.epoch,
                    message.peer,
                    True,
                    False,
                )
                terms = message.terms
                self.interface = terms.interface if terms is not None else ""
                self.assist = (terms.assist or "") if terms is not None else ""
            case protocol.Queued():
                self.session, self.queued, self.turn = message.session, True, False
            case protocol.Offered():
                self.turn = True
            case protocol.Refused():
                self.refused = message.reason
            case protocol.Ended():
                self.ended = message
            case protocol.RobotPresence():
                self.online = message.online
            case protocol.Denied():
                self.denied[message.reason] = self.denied.get(message.reason, 0) + 1
            case (stamp, _jpeg) if suffix == pictures.SUFFIX:
                self.frame, self.frames, self.awaiting_picture = stamp, self.frames + 1, False

    def _state(self, state: State) -> None:
        self._pose(state.pose, state.tilt)
        self.state, self.states, self.docked = state, self.states + 1, state.docked
        self.contact = state.docked if state.charger_contact is None else state.charger_contact
        if state.session == self.session:
            self.assists.add(state.assist)

    def _pose(self, pose: RobotPose, tilt: float | None) -> None:
        self.pose, self.localized, self.tilt = (
            Pose2D(pose.x, pose.y, pose.theta),
            pose.localized,
            tilt,
        )

    def _beat(self, beat: Heartbeat, now: float) -> None:
        self.beats = [(beat.n, beat.stamp, now)]
        for echo in beat.echoes:
            if echo.peer == self.peer:
                trip = now - echo.stamp - (beat.stamp - echo.received)
                self.trips.append(max(0.0, trip))

    @property
    def round_trip(self) -> float | None:
        """Return the median of the last round trips to the robot, in seconds; None before there is
        one.
        """
        return statistics.median(self.trips) if self.trips else None

    def points(self) -> list[tuple[float, float]]:
        """Return what the laser saw last, in metres on the map."""
        if self.scan is None or self.scan_pose is None:
            return []
        found, world_from_laser = [], self.scan_pose.compose(self.laser)
        for number, distance in enumerate(self.scan.ranges):
            if distance is not None and distance < self.scan.range_max:
                angle = self.scan.angle_min + number * self.scan.angle_increment
                found.append(
                    world_from_laser.apply(distance * math.cos(angle), distance * math.sin(angle))
                )
        return found


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
