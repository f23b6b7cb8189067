"""What the robot says about itself: states, events, poses, scans; and the states of the last
minutes, to be said again.

Whoever records a session notices a gap in (boot, seq) and asks for it again, so the record is
complete without a perfect network.
"""

from collections import deque
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import msgspec

from robots.agent.ramp import ZERO, is_within
from robots.agent.robot_interface import NOWHERE, UNKNOWN_BATTERY, RcaState
from robots.agent.safety.kernel import Kernel
from robots.agent.timing import Cadence, TimeSource
from robots.api import docked
from robots.api.docked import DockReading, DockState
from robots.api.idle import IDLE_STATE_SECONDS, is_news
from robots.api.messages import (
    AppliedCommand,
    CallState,
    CameraStatus,
    Event,
    KnockState,
    LabReport,
    Lease,
    Message,
    Mode,
    Path,
    Point,
    PoseUpdate,
    Safety,
    State,
)

STATE_PERIOD = 0.25
STATES_KEPT = 9600  # ten minutes, also of a robot that is stopped sixteen times a second
APPLIED_AT_ONCE = 64
HURRIED_PERIOD = 0.05
POSE_PERIOD = 1 / 15
POSE_PERIOD_TILTING = 1 / 30
SCAN_PERIOD = 0.2
PATH_PERIOD = 1.0  # a path is said again so often while it is followed, for pages that came later
PATH_POINTS = 2000
# poses go on for so long after the last motion, so that the page sees the robot come to rest
STILL_MOVING = 0.5
ERRORS_KEPT = 16
TILT_MOTION = 1e-4

UNKNOWN = RcaState(stamp=0.0, pose=NOWHERE, velocity=ZERO, battery=UNKNOWN_BATTERY)

Send = Callable[[str, Message], None]


class Reports:
    """Gathers since the last state what one state says, and sends.

    Args:
        boot: the id of this run of the agent.
        kernel: what safety says.
        send: puts a message on every way out.
        viewers: how many pages watch.
        times: the clocks.
        screens: how many of the robot's own displays are connected.
        call: how the driver's call stands.
        knock: whether the driver may knock, and how their knock stands.
        networks: what is put on the driver's network, for commands and for the picture.
        devices: how the camera is when it gives no video, and why devices do not work.
        is_needed: whether somebody needs the robot; else states come when something changes, and
            every IDLE_STATE_SECONDS.
    """

    def __init__(
        self,
        boot: str,
        kernel: Kernel,
        send: Send,
        viewers: Callable[[], int],
        times: TimeSource,
        *,
        screens: Callable[[], int] = int,
        call: Callable[[], CallState | None] = lambda: None,
        knock: Callable[[], tuple[bool, KnockState | None]] = lambda: (False, None),
        networks: Callable[[], tuple[LabReport | None, LabReport | None]] = lambda: (None, None),
        devices: Callable[[], tuple[CameraStatus | None, tuple[str, ...]]] = lambda: (None, ()),
        is_needed: Callable[[], bool] = lambda: True,
    ) -> None:
        self.boot, self._kernel, self._send, self._viewers, self._times = (
            boot,
            kernel,
            send,
            viewers,
            times,
        )
        self._screens, self._call, self._networks = screens, call, networks
        self._knock = knock
        self._devices = devices
        self._is_needed = is_needed
        self._last: State | None = None
        self._said_at = float("-inf")
        self.reading = UNKNOWN
        self._dock = DockState()
        self.errors: dict[str, str] = {}
        self._seq = 0
        self._kept: deque[tuple[int, bytes]] = deque(maxlen=STATES_KEPT)
        self._encoder = msgspec.json.Encoder()
        self._state_due, self._hurried_due = Cadence(STATE_PERIOD), Cadence(HURRIED_PERIOD)
        self._pose_due, self._tilt_due, self._scan_due = (
            Cadence(POSE_PERIOD),
            Cadence(POSE_PERIOD_TILTING),
            Cadence(SCAN_PERIOD),
        )
        self._path: tuple[Point, ...] = ()
        self._path_due = Cadence(PATH_PERIOD)
        self._hurry = False
        self._moved_at = float("-inf")
        self._applied: list[AppliedCommand] = []
        self._clearance: float | None = None
        self._contacts = 0
        self._distance = 0.0

    # --- gathering --------------------------------------------------------------------------------

    def connected(self) -> None:
        """The RCA was reached anew: what it counts begins anew."""
        self.reading = replace(self.reading, distance=0.0, contacts=0)

    def say_again(self) -> None:
        """Have a state sent soon, whether or not anything has changed: the broker is new."""
        self._last = None

    def take(self, reading: RcaState) -> None:
        """Take a reading, and send the pose and the scan when they are due."""
        now = self._times.now()
        before, self.reading = self.reading, reading
        velocity, released = reading.velocity, self._kernel.commanded == ZERO
        self._dock = docked.follow(
            docked.DOCKED,
            self._dock,
            DockReading(
                at=now,
                contact=reading.charger_contact,
                linear=velocity.linear,
                angular=velocity.angular,
                released=released,
            ),
        )
        self._distance += max(0.0, reading.distance - before.distance)
        self._contacts += max(0, reading.contacts - before.contacts)
        if reading.clearance is not None:
            self._clearance = (
                reading.clearance
                if self._clearance is None
                else min(self._clearance, reading.clearance)
            )
        tilting = (
            before.tilt is not None
            and reading.tilt is not None
            and abs(reading.tilt - before.tilt) > TILT_MOTION
        )
        if tilting or self.is_moving:
            self._moved_at = now
        if now - self._moved_at < STILL_MOVING and (
            self._tilt_due.due(now) if tilting else self._pose_due.due(now)
        ):
            self._send("pose", _pose_update(reading))
        if reading.scan is not None and self._scan_due.due(now):
            self._send("scan", reading.scan)
        if reading.path is not None:
            self._follow(reading.stamp, reading.path[:PATH_POINTS], now)

    def applied(self, command: AppliedCommand) -> None:
        """Take a command that reached the wheels."""
        self._applied.append(command)
        if len(self._applied) >= APPLIED_AT_ONCE:
            self.state()

    def hurry(self) -> None:
        """Send a state at once, or very soon: a stop waits for its echo."""
        self._hurry = True
        self._hurried()

    @property
    def docked(self) -> bool:
        """Tell whether the robot is docked (robots/api/docked.py)."""
        return self._dock.docked

    @property
    def is_moving(self) -> bool:
        """Tell whether the robot is measured moving, or was sent a velocity other than zero."""
        kernel = self._kernel
        return kernel.commanded != ZERO or not is_within(self.reading.velocity, kernel.standstill)

    # --- saying -----------------------------------------------------------------------------------

    def tick(self) -> None:
        """Send what is due."""
        now = self._times.now()
        if self._state_due.due(now):
            if self._is_needed() or self._is_worth_saying(now):
                self.state()
        elif self._hurry:
            self._hurried()

    def state(self, lease: Lease | None = None) -> int:
        """Send a state of the announced session, or of `lease` when that has just ended; return its
        seq.
        """
        self._seq += 1
        now = self._times.now()
        state = self._build(now, lease or self._kernel.leases.announced(now))
        self._last, self._said_at = state, now
        self._hurry, self._applied, self._contacts, self._clearance = (
            False,
            [],
            0,
            self.reading.clearance,
        )
        self._kernel.refused.clear()
        self._kept.append((self._seq, self._encoder.encode(state)))
        self._send("state", state)
        return self._seq

    def event(self, kind: Any, lease: Lease | None = None, **fields: Any) -> None:
        """Send an event of the announced session, or of `lease`; its seq is that
        of the next state.
        """
        of = lease or self._kernel.leases.announced(self._times.now())
        session, epoch = (of.session, of.epoch) if of else (None, 0)
        detail = str(fields.pop("detail", ""))[:300]
        event = Event(
            stamp=self._times.unix(),
            boot=self.boot,
            seq=self._seq + 1,
            session=session,
            epoch=epoch,
            type=kind,
            detail=detail,
            **fields,
        )
        self._send("event", event)

    def kept(self, first: int, last: int) -> list[bytes]:
        """Return the states `first` to `last` of this boot that are still here,
        as they were sent.
        """
        return [payload for seq, payload in self._kept if first <= seq <= last]

    # --- inside -----------------------------------------------------------------------------------

    def _follow(self, stamp: float, path: tuple[Point, ...], now: float) -> None:
        if path != self._path or (path and self._path_due.due(now)):
            self._path = path
            self._send("path", Path(stamp=stamp, points=path))

    def _is_worth_saying(self, now: float) -> bool:
        """Tell whether an idle robot sends a state now."""
        if self._last is None or now - self._said_at >= IDLE_STATE_SECONDS:
            return True
        return is_news(self._last, self._build(now, self._kernel.leases.announced(now)))

    def _hurried(self) -> None:
        if self._hurried_due.due(self._times.now()):
            self.state()

    def _build(self, now: float, lease: Lease | None) -> State:
        reading, kernel = self.reading, self._kernel
        knockable, knock = self._knock()
        control_network, video_network = self._networks()
        camera_status, device_errors = self._devices()
        return State(
            stamp=self._times.unix(),
            boot=self.boot,
            seq=self._seq,
            session=lease.session if lease else None,
            epoch=lease.epoch if lease else 0,
            pose=reading.pose,
            velocity=reading.velocity,
            battery=reading.battery,
            docked=self._dock.docked,
            charger_contact=reading.charger_contact,
            tilt=reading.tilt,
            mode=_mode(kernel),
            assist=kernel.assist.level,
            safety=self._safety(now),
            errors=(*self.errors.values(), *reading.errors, *device_errors)[:ERRORS_KEPT],
            clearance=self._clearance,
            contacts=self._contacts,
            distance=self._distance,
            visitor_silence=kernel.visitor_silence(now),
            viewers=self._viewers(),
            applied=tuple(self._applied),
            refused=dict(kernel.refused),
            assist_why=reading.assist_why,
            assist_point=reading.assist_point,
            call=self._call(),
            screens=self._screens(),
            knockable=knockable,
            knock=knock,
            control_network=control_network,
            video_network=video_network,
            camera_status=camera_status,
            distance_by_position=reading.odometry is None,
        )

    def _safety(self, now: float) -> Safety:
        kernel, latch = self._kernel, self._kernel.latch
        return Safety(
            estop=latch is not None,
            estop_source=latch.label[:120] if latch else None,
            collision=self._contacts > 0
            or bool(self.reading.bumper)
            or (self.reading.clearance is not None and self.reading.clearance <= 0.0),
            inhibited=kernel.inhibited(now),
            stop_seq=kernel.stop_seq,
            stop_id=kernel.stop_id,
            touched=kernel.contacts.sides,
            button=self.reading.estop,
        )


def _pose_update(reading: RcaState) -> PoseUpdate:
    return PoseUpdate(
        stamp=reading.stamp,
        pose=reading.pose,
        velocity=reading.velocity,
        tilt=reading.tilt,
        assist_why=reading.assist_why,
        assist_point=reading.assist_point,
    )


def _mode(kernel: Kernel) -> Mode:
    if kernel.latch or kernel.fault or kernel.held:
        return "stopped"
    if kernel.navigation:
        return kernel.navigation.mode
    return "manual" if kernel.assist.level == "off" else "assisted"
