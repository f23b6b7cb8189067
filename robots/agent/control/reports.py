"""What the robot reports: states, events, poses and scans.

The states of the last ten minutes are kept. A recorder that notices a gap in (boot, seq) requests
them again, so that a record is complete without a perfect network.
"""

from collections import deque
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import msgspec

from robots.agent.control.calls import CallControl
from robots.agent.control.publisher import Media
from robots.agent.ramp import ZERO, is_within
from robots.agent.robot_interface import NOWHERE, UNKNOWN_BATTERY, RcaState
from robots.agent.safety.kernel import Kernel
from robots.agent.timing import Cadence, TimeSource
from robots.api import docked
from robots.api.docked import DockReading, DockState
from robots.api.idle import IDLE_STATE_SECONDS, is_news
from robots.api.messages import (
    AppliedCommand,
    Event,
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
SOON_PERIOD = 0.05
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


class Reports:
    """Gathers what happens between two states, and sends.

    `boot` identifies this run, `send` puts a message on all its transports, and `knock` returns
    whether the driver may knock and the state of their knock. `networks` are those emulated for
    commands and for video, `devices` the state of a camera without video and errors of devices. A
    robot that is not needed sends states on changes and every IDLE_STATE_SECONDS.
    """

    def __init__(
        self,
        boot: str,
        kernel: Kernel,
        send: Callable[[str, Message], None],
        media: Media,
        times: TimeSource,
        *,
        calls: CallControl,
        control_network: Callable[[], LabReport | None],
        is_needed: Callable[[], bool],
    ) -> None:
        self.boot, self._kernel, self._send, self._media = boot, kernel, send, media
        self._times, self._calls, self._control_network = times, calls, control_network
        self._is_needed = is_needed
        self._last: State | None = None
        self._sent_at = float("-inf")
        self.reading = UNKNOWN
        self._dock = DockState()
        self.errors: dict[str, str] = {}
        self.shortage: tuple[str, ...] = ()  # errors of a disk that is nearly full
        self._seq = 0
        self._kept: deque[tuple[int, bytes]] = deque(maxlen=STATES_KEPT)
        self._encoder = msgspec.json.Encoder()
        self._state_due, self._soon_due = Cadence(STATE_PERIOD), Cadence(SOON_PERIOD)
        self._pose_due, self._tilt_due = Cadence(POSE_PERIOD), Cadence(POSE_PERIOD_TILTING)
        self._scan_due, self._path_due = Cadence(SCAN_PERIOD), Cadence(PATH_PERIOD)
        self._path: tuple[Point, ...] = ()
        self._is_soon = False
        self._moved_at = float("-inf")
        self._applied: list[AppliedCommand] = []
        self._clearance: float | None = None
        self._contacts = 0
        self._distance = 0.0

    # --- gathering --------------------------------------------------------------------------------

    def connected(self) -> None:
        """Start counting distance and contacts again, as a reconnected RCA does."""
        self.reading = replace(self.reading, distance=0.0, contacts=0)

    def republish(self) -> None:
        """Have a state sent soon even if nothing has changed, because the broker is new."""
        self._last = None

    def take(self, reading: RcaState) -> None:
        """Take a reading, and send the pose and the scan when they are due."""
        now = self._times.now()
        before, self.reading = self.reading, reading
        at_dock = DockReading(
            at=now,
            contact=reading.charger_contact,
            linear=reading.velocity.linear,
            angular=reading.velocity.angular,
            released=self._kernel.commanded == ZERO,
        )
        self._dock = docked.follow(docked.DOCKED, self._dock, at_dock)
        self._distance += max(0.0, reading.distance - before.distance)
        self._contacts += max(0, reading.contacts - before.contacts)
        clearances = (self._clearance, reading.clearance)
        self._clearance = min((one for one in clearances if one is not None), default=None)
        self._send_pose(before, reading, now)
        if reading.scan is not None and self._scan_due.due(now):
            self._send("scan", reading.scan)
        if reading.path is not None:
            self._follow(reading.stamp, reading.path[:PATH_POINTS], now)

    def _send_pose(self, before: RcaState, reading: RcaState, now: float) -> None:
        """Send the pose while the robot moves and for `STILL_MOVING` seconds after that; more often
        while the head tilts, because the overlay on the video depends on it.
        """
        tilting = (
            before.tilt is not None
            and reading.tilt is not None
            and abs(reading.tilt - before.tilt) > TILT_MOTION
        )
        if tilting or self.is_moving:
            self._moved_at = now
        if now - self._moved_at >= STILL_MOVING:
            return
        if self._tilt_due.due(now) if tilting else self._pose_due.due(now):
            update = PoseUpdate(
                stamp=reading.stamp,
                pose=reading.pose,
                velocity=reading.velocity,
                tilt=reading.tilt,
                assist_why=reading.assist_why,
                assist_point=reading.assist_point,
            )
            self._send("pose", update)

    def applied(self, command: AppliedCommand) -> None:
        self._applied.append(command)
        if len(self._applied) >= APPLIED_AT_ONCE:
            self.state()

    def send_soon(self) -> None:
        """Send a state at once, or very soon: a stop waits for its echo."""
        self._is_soon = True
        self._send_soon()

    @property
    def docked(self) -> bool:
        return self._dock.docked

    @property
    def is_moving(self) -> bool:
        """Tell whether the robot is measured moving, or was sent a velocity other than zero."""
        kernel = self._kernel
        return kernel.commanded != ZERO or not is_within(self.reading.velocity, kernel.standstill)

    # --- saying -----------------------------------------------------------------------------------

    def tick(self) -> None:
        now = self._times.now()
        if self._state_due.due(now):
            if self._is_needed() or self._has_news(now):
                self.state()
        elif self._is_soon:
            self._send_soon()

    def state(self, lease: Lease | None = None) -> int:
        """Send a state of the announced session, or of the ended `lease`; return its seq."""
        self._seq += 1
        now = self._times.now()
        state = self._build(now, lease or self._kernel.leases.announced(now))
        self._last, self._sent_at = state, now
        self._is_soon, self._applied, self._contacts = False, [], 0
        self._clearance = self.reading.clearance
        self._kernel.refused.clear()
        self._kept.append((self._seq, self._encoder.encode(state)))
        self._send("state", state)
        return self._seq

    def event(self, kind: Any, lease: Lease | None = None, **fields: Any) -> None:
        """Send an event of the announced session, or of `lease`, with the seq of the next state."""
        of = lease or self._kernel.leases.announced(self._times.now())
        session, epoch = (of.session, of.epoch) if of else (None, 0)
        fields["detail"] = str(fields.get("detail", ""))[:300]
        event = Event(
            stamp=self._times.unix(),
            boot=self.boot,
            seq=self._seq + 1,
            session=session,
            epoch=epoch,
            type=kind,
            **fields,
        )
        self._send("event", event)

    def kept(self, first: int, last: int) -> list[bytes]:
        """Return the stored states `first` to `last` of this boot, as they were sent."""
        return [payload for seq, payload in self._kept if first <= seq <= last]

    # --- inside -----------------------------------------------------------------------------------

    def _follow(self, stamp: float, path: tuple[Point, ...], now: float) -> None:
        if path != self._path or (path and self._path_due.due(now)):
            self._path = path
            self._send("path", Path(stamp=stamp, points=path))

    def _has_news(self, now: float) -> bool:
        """Tell whether an idle robot sends a state now."""
        if self._last is None or now - self._sent_at >= IDLE_STATE_SECONDS:
            return True
        return is_news(self._last, self._build(now, self._kernel.leases.announced(now)))

    def _send_soon(self) -> None:
        if self._soon_due.due(self._times.now()):
            self.state()

    def _build(self, now: float, lease: Lease | None) -> State:
        reading, kernel, media, calls = self.reading, self._kernel, self._media, self._calls
        driver = kernel.leases.live(now)
        errors = (*self.errors.values(), *reading.errors, *media.errors, *self.shortage)
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
            errors=errors[:ERRORS_KEPT],
            clearance=self._clearance,
            contacts=self._contacts,
            distance=self._distance,
            visitor_silence=kernel.visitor_silence(now),
            viewers=media.connected,
            applied=tuple(self._applied),
            refused=dict(kernel.refused),
            assist_why=reading.assist_why,
            assist_point=reading.assist_point,
            call=media.confirm(calls.state(driver, now)),
            screens=media.screens,
            knockable=calls.knockable(driver, audible=media.audible),
            knock=calls.knocking(driver, now),
            control_network=self._control_network(),
            video_network=media.network,
            camera_status=media.camera_status,
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


def _mode(kernel: Kernel) -> Mode:
    if kernel.latch or kernel.fault or kernel.held:
        return "stopped"
    if kernel.navigation:
        return kernel.navigation.mode
    return "manual" if kernel.assist.level == "off" else "assisted"
