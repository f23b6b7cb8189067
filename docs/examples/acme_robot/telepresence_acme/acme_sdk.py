"""A test double of a robot vendor's Python SDK, with the usual habits: every call blocks, and hangs
for as long as the robot does; callbacks run on threads of the SDK; a frame is BGR, in a buffer that
the SDK reuses.

`devices` simulates the network: robots by address. Connecting to an unknown address creates a robot
in an open room.
"""

import math
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

CALL = 0.005  # s that a call takes
STEP = 0.01  # s between two steps of the simulated base
CAMERA = (240, 320)  # rows, columns


class AcmeError(Exception):
    """The robot does not answer."""


@dataclass(frozen=True)
class Status:
    """Odometry in metres and radians, speeds in m/s and rad/s, volts, and whether the bumper is
    pressed.
    """

    x: float
    y: float
    theta: float
    linear: float
    angular: float
    volts: float
    bumper: bool


class Device:
    """The robot itself. It follows the last velocity for `watchdog` seconds, or until its bumper
    touches a wall `wall` metres ahead of its start.
    """

    watchdog = 0.4
    acceleration = 0.8  # m/s², and rad/s² for turns
    nose = 0.255  # m from the centre to the bumper

    def __init__(self, wall: float = math.inf) -> None:
        self.wall = wall
        self.is_disconnected = False
        self._frozen = threading.Event()
        self._lock = threading.Lock()
        self._velocity, self._velocity_at = (0.0, 0.0), -math.inf
        self._at = time.monotonic()
        self._pose = [0.0, 0.0, 0.0]
        self._speed = [0.0, 0.0]
        self._pressed = False

    def freeze(self, *, on: bool) -> None:
        """Make every call hang, or end that."""
        if on:
            self._frozen.set()
        else:
            self._frozen.clear()

    def answer(self, timeout: float = math.inf) -> None:
        """Block for as long as a call takes.

        Raises:
            AcmeError: the robot does not answer.
        """
        time.sleep(CALL)
        began = time.monotonic()
        while self._frozen.is_set():
            if time.monotonic() - began > timeout:
                raise AcmeError("no answer")
            time.sleep(CALL)
        if self.is_disconnected:
            raise AcmeError("the connection was lost")

    def drive(self, linear: float, angular: float) -> None:
        """Follow a velocity for `watchdog` seconds."""
        with self._lock:
            self._advance()
            self._velocity, self._velocity_at = (linear, angular), self._at

    def status(self) -> Status:
        """Return odometry, battery voltage and bumper at this moment."""
        with self._lock:
            self._advance()
            return Status(*self._pose, *self._speed, volts=25.4, bumper=self._pressed)

    def _advance(self) -> None:
        now = time.monotonic()
        while self._at + STEP <= now:
            self._at += STEP
            is_recent = self._at - self._velocity_at < self.watchdog
            wanted = self._velocity if is_recent else (0.0, 0.0)
            for axis in (0, 1):
                change = wanted[axis] - self._speed[axis]
                most = self.acceleration * STEP
                self._speed[axis] += min(max(change, -most), most)
            heading = self._pose[2]
            ahead = self._pose[0] + self._speed[0] * STEP * math.cos(heading)
            self._pressed = ahead + self.nose >= self.wall and self._speed[0] >= 0.0
            if self._pressed:
                self._speed[0] = 0.0
            else:
                self._pose[0] = ahead
            self._pose[1] += self._speed[0] * STEP * math.sin(heading)
            self._pose[2] += self._speed[1] * STEP


devices: dict[str, Device] = {}


def connect(address: str, *, timeout: float) -> "Robot":
    """Connect to a robot; blocks for `timeout` seconds at most.

    Raises:
        AcmeError: it does not answer.
    """
    device = devices.setdefault(address, Device())
    device.answer(timeout)
    return Robot(device)


class Robot:
    """A connection. Every method blocks until the robot has answered."""

    def __init__(self, device: Device) -> None:
        self._device = device
        self._connected = threading.Event()
        self._connected.set()
        self._camera: Callable[[np.ndarray, float], None] | None = None

    def set_speed(self, linear: float, angular: float) -> None:
        """Drive; m/s ahead and rad/s to the left."""
        self._device.answer()
        self._device.drive(linear, angular)

    def get_status(self) -> Status:
        """Request the status; blocks until the robot answers."""
        self._device.answer()
        return self._device.status()

    def on_bumper(self, callback: Callable[[bool], None]) -> None:
        """Call back, on a thread of the SDK, whenever the bumper is pressed or released."""
        threading.Thread(target=self._feel, args=[callback], name="sdk-bumper", daemon=True).start()

    def start_camera(self, callback: Callable[[np.ndarray, float], None]) -> None:
        """Call back, on a thread of the SDK, with (rows, columns, 3) uint8 BGR and the Unix time of
        each frame. The array is valid only until the callback returns.
        """
        self._camera = callback
        threading.Thread(target=self._film, args=[callback], name="sdk-camera", daemon=True).start()

    def stop_camera(self) -> None:
        """End the camera's thread after its present frame."""
        self._camera = None

    def disconnect(self) -> None:
        """End the threads of this connection."""
        self._connected.clear()
        self._camera = None

    def _feel(self, callback: Callable[[bool], None]) -> None:
        pressed = False
        while self._connected.is_set() and not self._device.is_disconnected:
            if self._device.status().bumper != pressed:
                pressed = not pressed
                callback(pressed)
            time.sleep(STEP)

    def _film(self, callback: Callable[[np.ndarray, float], None]) -> None:
        buffer = np.empty((*CAMERA, 3), dtype=np.uint8)
        count = 0
        while (
            self._connected.is_set()
            and self._camera is callback
            and not self._device.is_disconnected
        ):
            buffer[:] = (20, 30, 200)  # blue, green, red: a red room
            buffer[:, (4 * count) % CAMERA[1] :][:, :40] = 60  # with a dark bar that moves
            callback(buffer, time.time())
            count += 1
            time.sleep(1.0 / 15.0)
