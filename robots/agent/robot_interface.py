"""What an adapter is: the one place where this project meets a robot control architecture (RCA).

An adapter only translates. It never decides on safety (the safety kernel has done so before
`apply`), and never sees MQTT or WebRTC. To connect a new robot, write one class with these
members: docs/howto/write-an-adapter.md says how.

Times: `stamp` is Unix time in seconds of the robot's computer. Lengths in metres, angles in
radians, x forward, y left.
"""

from collections.abc import AsyncIterator
from dataclasses import dataclass, field
from typing import Any, Literal, Protocol, runtime_checkable

import numpy as np
import numpy.typing as npt
from msgspec import Struct

from robots.api.floorplan import ChargingDock as Station
from robots.api.geometry import Pose2D
from robots.api.messages import (
    Action,
    ActionState,
    Battery,
    Camera,
    Capability,
    FloorPlanUpdate,
    Laser,
    Limits,
    Point,
    Pose,
    Scan,
    TiltRange,
    Velocity,
)

UNKNOWN_BATTERY = Battery(charging=None)  # of a robot that has not reported it
# the pose of a robot that has no localization
NOWHERE = Pose(x=0.0, y=0.0, theta=0.0, localized=False, score=0.0)


class AdapterError(Exception):
    """The RCA cannot be reached, or refused; the message is one sentence for the owner."""


class ActionRefusedError(AdapterError):
    """The RCA has certainly not taken the action. After any other error of `start` it may run."""


# What stops the RCA's own navigation when the agent, its link or its lease is lost: the agent,
# which passes on each of its velocities; a guard process on the RCA's side; or nothing.
NavigationControl = Literal["agent", "guarded", "unguarded"]


class Sonar(Struct, frozen=True, forbid_unknown_fields=True):
    """A sensor that measures the distance of the nearest thing in a cone: ultrasound, or infrared.

    It sits at `x`, `y` in the robot's frame and looks along `theta`; `width` is the whole angle of
    its cone, in radians. It measures nothing beyond `farthest` metres, and `nearest` for
    anything nearer.
    """

    x: float
    y: float
    theta: float
    width: float = 0.52
    nearest: float = 0.0
    farthest: float = 4.0


class DepthCamera(Struct, frozen=True, forbid_unknown_fields=True):
    """The view of `RcaState.points`, as `Sonar`: its middle, whole angle and reach."""

    x: float = 0.0
    y: float = 0.0
    theta: float = 0.0
    width: float = 1.0
    farthest: float = 4.0


@dataclass(frozen=True)
class Profile:
    """A robot's fixed data, known before `connect()`: the adapter's share of the factsheet.

    `footprint` is a convex polygon of (x, y) in the robot's frame; `watchdog` the seconds after
    which the base stops by itself when the agent is dead or stuck. An adapter without a watchdog is
    refused.

    Sensors for obstacles, with their fields of a reading: `laser` (`scan`), `sonars` (`sonar`),
    `bumper` (`bumper`) and `depth` (`points`). With one, a robot gets a collision monitor and
    assistance (obstacle_sources.py), with a `laser` also the localization and the navigation that
    it lacks (navigation_layer/). `plan` is the robot's site, by name or folder, and `start` its
    pose at the first connection; both are empty when unknown.

    A robot whose measured speeds do not exceed `standstill_linear` (m/s) and `standstill_angular`
    (rad/s) is at rest. `navigation_control` is None for a robot whose RCA does not move it by
    itself. `driver` is the software of its base with its version, empty when unknown.
    """

    series: str
    rca: str
    capabilities: tuple[Capability, ...]
    limits: Limits
    footprint: tuple[tuple[float, float], ...]
    watchdog: float
    camera: Camera | None = None
    tilt: TiltRange | None = None
    laser: Laser | None = None
    sonars: tuple[Sonar, ...] = ()
    bumper: bool = False
    depth: DepthCamera | None = None
    map_id: str = ""
    plan: str = ""
    start: Pose2D | None = None
    standstill_linear: float = 0.02
    standstill_angular: float = 0.05
    navigation_control: NavigationControl | None = None
    driver: str = ""

    @property
    def standstill(self) -> Velocity:
        """The largest velocity that counts as rest."""
        return Velocity(linear=self.standstill_linear, angular=self.standstill_angular)


@dataclass(frozen=True)
class SonarEcho:
    """A measurement of a sonar (index in `Profile.sonars`): metres, None for no echo."""

    sonar: int
    stamp: float
    distance: float | None


@dataclass(frozen=True, eq=False)
class ObstaclePoints:
    """Obstacles at `stamp`: (n, 2) in the robot's frame, metres, without floor and overhead."""

    stamp: float
    points: npt.NDArray[np.float64]


@dataclass(frozen=True)
class RcaState:
    """One reading of everything the RCA reports.

    `charger_contact` is true while the charging contacts meet, or the robot charges;
    robots/api/docked.py decides whether it is docked. `pose` is `NOWHERE` when the RCA does not
    localize itself; `odometry` is dead reckoning, in a frame with any origin, of `odometry_stamp`
    where that is older than `stamp`. `clearance` is the distance in metres from the footprint to
    the nearest obstacle, None when unknown. `contacts` counts the collisions since connect(),
    `distance` the metres driven since then. `is_measured` is false when `velocity` only repeats an
    earlier measurement, which does not show that the robot is still at rest. `estop` is true while
    the robot's own emergency button is pressed, None until that is reported. `path` is what the
    robot follows by itself, in map metres, () when it follows none, None when unknown. `scan`,
    `sonar` and `points` are new since the last reading. `bumper` has the directions, in radians in
    the robot's frame, in which something touches the robot now: () for none, None when unknown.
    `assist_why` and `assist_point` are those of an RCA's own assistance, as in `messages.State`.
    `battery` and `tilt` are None when unknown, never guessed.
    """

    stamp: float
    pose: Pose
    velocity: Velocity
    battery: Battery
    charger_contact: bool = False
    tilt: float | None = None
    clearance: float | None = None
    contacts: int = 0
    distance: float = 0.0
    scan: Scan | None = None
    errors: tuple[str, ...] = ()
    estop: bool | None = None
    odometry: Pose2D | None = None
    path: tuple[Point, ...] | None = None
    assist_why: str = ""
    assist_point: Point | None = None
    sonar: tuple[SonarEcho, ...] = ()
    bumper: tuple[float, ...] | None = None
    points: ObstaclePoints | None = None
    is_measured: bool = True
    odometry_stamp: float | None = None


@dataclass(frozen=True)
class ActionProgress:
    """`reason` is a code of robots/api/reasons.py, or a sentence of the RCA."""

    action_id: str
    status: ActionState
    reason: str = ""
    result: dict[str, float | str | bool | None] = field(default_factory=dict)


@dataclass(frozen=True)
class Frame:
    """An image; `stamp` is when the camera captured it.

    `image` is uint8: (height, width, 3) RGB, or for `yuv420p` (height * 3 / 2, width), the rows of
    Y, then U and V at half the size in both directions: BT.601, 16 to 235, which the encoder needs.
    """

    image: npt.NDArray[np.uint8]
    stamp: float
    format: Literal["rgb24", "yuv420p"] = "rgb24"

    @property
    def width(self) -> int:
        return int(self.image.shape[1])

    @property
    def height(self) -> int:
        rows = int(self.image.shape[0])
        return rows if self.format == "rgb24" else rows * 2 // 3


class VideoSource(Protocol):
    """A camera. All methods are called from the media side, never from the control loop."""

    def start(self) -> None:
        """Begin to capture; idempotent."""

    def stop(self) -> None:
        """Stop capturing; called without viewers, idempotent."""

    def read(self, timeout: float) -> Frame | None:
        """Block for the next frame, at most `timeout` s; None without one, or AdapterError."""


class AudioSource(Protocol):
    """A microphone: mono, 48 kHz, 16 bit."""

    def start(self) -> None:
        """Begin to capture; idempotent."""

    def stop(self) -> None:
        """Stop capturing; idempotent."""

    def read(self, timeout: float) -> npt.NDArray[np.int16] | None:
        """Block for the next 20 ms (960 samples), at most `timeout` seconds."""


class Speaker(Protocol):
    """The robot's loudspeaker; called from one thread of the media side, and may block."""

    def start(self) -> None:
        """Get ready to play; idempotent. Raises AdapterError when it is gone."""

    def stop(self) -> None:
        """Be silent; idempotent."""

    def play(self, samples: npt.NDArray[np.int16]) -> None:
        """Play samples, (n,): mono, 48 kHz. Raises AdapterError when it is gone."""


class Display(Protocol):
    """A display that is not a browser; called like a Speaker."""

    def start(self) -> None:
        """Get ready to show; idempotent. Raises AdapterError when it is gone."""

    def stop(self) -> None:
        """Show no visitor; idempotent."""

    def show(self, image: npt.NDArray[np.uint8]) -> None:
        """Show the visitor, (height, width, 3) RGB. Raises AdapterError when it is gone."""


class Adapter(Protocol):
    """A robot control architecture for the agent; called on the control loop, never blocks."""

    profile: Profile

    async def connect(self) -> None:
        """Reach the RCA, and cancel every action that an earlier connection or an earlier run of
        the agent has left there. Called again, without a `close()` between, whenever it was lost.

        Raises AdapterError when it cannot be reached; the agent retries without end.
        """

    def apply(self, velocity: Velocity) -> Velocity:
        """Send a velocity to the base at once, and return the one that was sent last: another one
        where velocities wait or are lowered.

        Called on every accepted command and on every tick (50 Hz) while the robot moves; the kernel
        sends zeros to brake, then nothing, so as not to compete with a planner. Must not block.
        Raises AdapterError when the RCA is lost; the agent then reconnects.
        """

    async def start(self, action: Action) -> None:
        """Begin an action named in `profile.capabilities`; progress comes from `progress()`.

        The agent owns an action that may move the robot until a terminal status arrives: after
        any error but `ActionRefusedError` it cancels the action, because it may run.

        Raises:
            ActionRefusedError: the RCA has certainly not taken it, with the reason.
            AdapterError: the RCA did not confirm it.
        """

    async def cancel(self, action_id: str) -> bool:
        """Ask the RCA to end an action, also one that it has not accepted yet or has ended.

        Return True when the action certainly does not run any more, and never will; the RCA has
        then confirmed it, or does not know the action. The agent calls again every 0.5 s until
        then, or until `progress()` yields a terminal status.
        """

    def states(self) -> AsyncIterator[RcaState]:
        """Yield the RCA's state at 10 Hz or more; ends or raises AdapterError when it is gone."""

    def progress(self) -> AsyncIterator[ActionProgress]:
        """Yield news of started actions."""

    def video(self) -> VideoSource | None:
        """Return the driving camera, or None when the robot's own page provides the picture."""

    def audio(self) -> AudioSource | None:
        """Return the microphone, or None."""

    def configure(self, config: Any) -> None:
        """Take a `Config` message; what does not concern the RCA is ignored."""

    async def close(self) -> None:
        """Leave the robot at rest and disconnect."""


@runtime_checkable
class PassesVelocities(Protocol):
    """Optional: velocities of the RCA's own navigation pass through the agent."""

    def wanted(self) -> Velocity | None:
        """Return what the navigation wants, None without an action; zero after 0.3 s."""


@runtime_checkable
class WithLock(Protocol):
    """Optional: the robot has a lock of its own against velocities."""

    def set_lock(self, *, locked: bool) -> None:
        """Lock or release the base; called at each change and after each connection.

        Raises AdapterError when the lock cannot be reached.
        """


@runtime_checkable
class LimitsSpeed(Protocol):
    """Optional: the RCA's own navigation takes a speed limit."""

    def limit_speed(self, linear: float) -> None:
        """Set the largest speed of the RCA's navigation, in m/s."""


@runtime_checkable
class Severable(Protocol):
    """Optional: lets `--check` show what the navigation does when the agent is lost."""

    def sever(self) -> None:
        """Drop the connection as the death of the agent's process would: no zero velocity, no
        cancel, no further heartbeat. `states()` then raises AdapterError; `connect()` reconnects.
        """


@runtime_checkable
class Navigating(Protocol):
    """Optional: localization or navigation run in the agent, under the safety kernel."""

    @property
    def dock(self) -> Station | None:
        """This robot's own dock on the map, None when there is not exactly one."""

    def wanted(self) -> Velocity | None:
        """Return the running action's velocity, None without one; an old one becomes zero."""

    def located(self, reading: RcaState, points: npt.NDArray[np.float64]) -> RcaState:
        """Take a reading of `states()`, and (n, 2) points of obstacles in the robot's frame; return
        it with pose, path and errors. Raises AdapterError when navigation cannot be restarted.
        """

    def take_floorplan(self, update: FloorPlanUpdate) -> None:
        """Take the map of the site from the server."""


@runtime_checkable
class PreviewsRoutes(Protocol):
    """Optional: the navigation plans a route before it is asked to drive it."""

    async def preview(self, x: float, y: float) -> tuple[tuple[Point, ...], str]:
        """Return the points and the reason of `messages.RoutePreview` for a `goto` to that point of
        the map. Raises AdapterError.
        """


@runtime_checkable
class WithOutputs(Protocol):
    """Optional: a loudspeaker or a display that the agent may use."""

    def speaker(self) -> Speaker | None:
        """Return the loudspeaker, always the same one, or None."""

    def display(self) -> Display | None:
        """Return the display, always the same one, or None."""


FromPage = Literal["page"]
FROM_PAGE: FromPage = "page"  # instead of a source: the page on the robot's own screen provides it

Outputs = tuple[Speaker | None, Display | None]


def outputs_of(adapter: Adapter) -> Outputs:
    """Return the robot's loudspeaker and display, None for each that it does not have."""
    return (
        (adapter.speaker(), adapter.display()) if isinstance(adapter, WithOutputs) else (None, None)
    )
