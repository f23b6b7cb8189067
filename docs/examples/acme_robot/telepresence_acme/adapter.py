"""An adapter for a blocking SDK with callbacks on threads of its own.

Nothing on the agent's control loop may block, because the safety kernel runs there fifty times a
second. A separate thread therefore talks to the robot. Velocities reach it through `LatestValue`,
which keeps only the latest; data from it and from the SDK's own threads reaches the loop through
`call_soon_threadsafe`. A call that hangs blocks only that thread: the agent notices the silence,
drops the connection and makes a new one.
"""

import asyncio
import contextlib
import threading
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from msgspec import Struct

from robots.agent.adapters.common.remote_adapter import RemoteAdapter, profile_of
from robots.agent.adapters.common.robot_profile import RobotProfile, load_profile, settings_of
from robots.agent.devices.latest_value import LatestValue
from robots.agent.robot_interface import AdapterError, Frame, VideoSource
from robots.api.geometry import Pose2D
from robots.api.messages import Velocity
from telepresence_acme import acme_sdk

PROFILES = Path(__file__).parent / "profiles"
PERIOD = 0.04  # s between two status requests while no velocity arrives
ENDING = 1.0  # s that the thread may take to disconnect from the robot


class Options(Struct, frozen=True, kw_only=True):
    """`timeout` in seconds to connect."""

    watchdog: float
    address: str = "192.168.1.50"
    timeout: float = 3.0


def create(profile_name: str, options: Mapping[str, Any]) -> "AcmeAdapter":
    """Return an adapter, not connected yet; the agent finds this function by the entry point."""
    robot = load_profile(profile_name, PROFILES)
    return AcmeAdapter(robot, settings_of(Options, "acme", robot, options))


class AcmeAdapter(RemoteAdapter):
    """Runs on the control loop, except for `SdkThread` and `AcmeCamera`."""

    vital = "its odometry"

    def __init__(self, robot: RobotProfile, options: Options) -> None:
        profile = profile_of(robot, "Acme", options.watchdog, own=("video",), sensors=("bumper",))
        super().__init__(profile, robot.battery)
        self.place = f"Acme at {options.address}"
        self._options = options
        self._camera = AcmeCamera()
        self._thread: SdkThread | None = None
        self._answered = asyncio.Event()

    async def _open(self) -> None:
        try:  # a call that always ends, by its own timeout, may go to a thread of asyncio's pool
            robot = await asyncio.to_thread(
                acme_sdk.connect, self._options.address, timeout=self._options.timeout
            )
        except acme_sdk.AcmeError as error:
            raise AdapterError(f"{self.place} cannot be reached: {error}") from error
        self.readings.bumped(touching=False, bearings=())
        self._thread = thread = SdkThread(robot, asyncio.get_running_loop())
        thread.begin(self._on_status, self._bumped, lambda why: self._lose(f"{self.place}: {why}"))
        await asyncio.to_thread(self._camera.connected, robot)

    async def _shut(self) -> None:
        thread, self._thread = self._thread, None
        if thread is not None:
            thread.end()
            await asyncio.to_thread(self._camera.connected, None)
            await asyncio.to_thread(thread.wait, ENDING)

    def _cut(self) -> None:
        if self._thread is not None:
            self._thread.end()

    def _drive(self, velocity: Velocity) -> None:
        if self._thread is None:
            raise AdapterError(f"{self.place} is not connected")
        self._thread.velocities.put(velocity)

    async def _ask(self) -> None:
        """Wait for the robot's next answer, so that a robot that hangs gets no velocity."""
        self._answered.clear()
        await self._answered.wait()

    def video(self) -> VideoSource:
        """Return the robot's camera."""
        return self._camera

    def _on_status(self, status: acme_sdk.Status) -> None:
        self._answered.set()
        self.readings.charged(voltage=status.volts)
        self.readings.moved(
            Pose2D(status.x, status.y, status.theta),
            Velocity(linear=status.linear, angular=status.angular),
            time.time(),
            time.monotonic(),
        )
        self._received()

    def _bumped(self, pressed: bool) -> None:
        self.readings.bumped(touching=pressed, bearings=(0.0,) if pressed else ())


class SdkThread:
    """The only thread that talks to the robot, because few SDKs are thread-safe. It is a daemon, so
    that a call that hangs does not keep the agent from exiting, as asyncio's thread pool would.
    """

    def __init__(self, robot: acme_sdk.Robot, loop: asyncio.AbstractEventLoop) -> None:
        self.velocities: LatestValue[Velocity] = LatestValue()
        self._robot = robot
        self._loop = loop
        self._ending = threading.Event()
        self._thread: threading.Thread | None = None

    def begin(
        self,
        on_status: Callable[[acme_sdk.Status], None],
        bumped: Callable[[bool], None],
        lost: Callable[[str], None],
    ) -> None:
        """Talk to the robot until `end`; all three are called on the loop."""
        self._robot.on_bumper(lambda pressed: self._call(bumped, pressed))
        self._thread = threading.Thread(
            target=self._run, args=[on_status, lost], name="acme", daemon=True
        )
        self._thread.start()

    def end(self) -> None:
        """Send nothing more to the robot; returns at once."""
        self._ending.set()

    def wait(self, seconds: float) -> None:
        """Block until the robot is disconnected, at most `seconds`."""
        if self._thread is not None:
            self._thread.join(seconds)

    def _run(
        self, on_status: Callable[[acme_sdk.Status], None], lost: Callable[[str], None]
    ) -> None:
        try:
            while not self._ending.is_set():
                velocity = self.velocities.take(PERIOD)
                if velocity is not None and not self._ending.is_set():
                    self._robot.set_speed(velocity.linear, velocity.angular)
                self._call(on_status, self._robot.get_status())
            self._robot.disconnect()
        except acme_sdk.AcmeError as error:
            self._call(lost, str(error))

    def _call(self, function: Callable[[Any], None], argument: Any) -> None:
        """Call a function on the loop, unless the connection is closing."""
        with contextlib.suppress(RuntimeError):  # the loop was closed in between
            if not self._ending.is_set():
                self._loop.call_soon_threadsafe(function, argument)


class AcmeCamera:
    """See robot_interface.VideoSource: the agent's media thread, which may block, calls `start`,
    `stop` and `read`; a thread of the SDK delivers frames.
    """

    def __init__(self) -> None:
        self._newest: LatestValue[Frame] = LatestValue()
        self._lock = threading.Lock()
        self._robot: acme_sdk.Robot | None = None
        self._wanted = False

    def connected(self, robot: acme_sdk.Robot | None) -> None:
        """Use a new connection, None when it is closed; capturing continues on it."""
        with self._lock:
            self._robot = robot
            if robot is not None and self._wanted:
                robot.start_camera(self._take)

    def start(self) -> None:
        """Begin to capture; idempotent."""
        with self._lock:
            if not self._wanted and self._robot is not None:
                self._robot.start_camera(self._take)
            self._wanted = True

    def stop(self) -> None:
        """Stop capturing; idempotent."""
        with self._lock:
            self._wanted = False
            if self._robot is not None:
                self._robot.stop_camera()
        self._newest.put(None)

    def read(self, timeout: float) -> Frame | None:
        """Block for the next picture, at most `timeout` seconds; None when there was none.

        Raises:
            AdapterError: the camera is gone.
        """
        frame = self._newest.take(timeout)
        if frame is None and self._wanted and self._robot is None:
            raise AdapterError("the camera is not connected")
        return frame

    def _take(self, bgr: np.ndarray, stamp: float) -> None:
        """Store a frame as RGB, as the agent expects, and as a copy, because the SDK reuses its
        buffer.
        """
        if self._wanted:
            self._newest.put(Frame(np.ascontiguousarray(bgr[:, :, ::-1]), stamp))
