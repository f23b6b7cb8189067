"""The messages of a simulated robot and its clients over TCP, framed by framing.py.

A connection has one role, given in `SimulatorHello`: the driver moves the robot and receives its
state, an observer reads the truth (tests and benchmarks), an operator injects faults (carries the
robot away, breaks it, moves doors), a camera gets the numbers of frames in shared memory, a
microphone gets sound. Each role has its own connection, so that media never delay a velocity.
"""

import asyncio
import functools
import operator
from typing import Any, Literal

import msgspec

from robots.api.floorplan import DoorState
from robots.process import framing

COMMAND_LIMIT = 64 << 10
Role = Literal["driver", "observer", "operator", "camera", "microphone"]


class SimulatorMessage(msgspec.Struct, frozen=True, tag=True, array_like=True):
    """Base of every message on this wire."""


class ToSimulator(SimulatorMessage, frozen=True):
    """Base of every message of a client; each subclass is decoded."""


class FromSimulator(SimulatorMessage, frozen=True):
    """Base of every message of the simulator; each subclass is decoded."""


class Faults(msgspec.Struct, frozen=True, kw_only=True):
    """Injected faults, to test how the system reacts. `wheels_stopped`: the motors do not turn;
    `laser`: it sends nothing, or only NaN.
    """

    wheels_stopped: bool = False
    laser: Literal["none", "silent", "nan"] = "none"


class SimulatorHello(ToSimulator, frozen=True):
    role: Role


class DriveOrder(ToSimulator, frozen=True):
    """A velocity; without another one the base brakes."""

    linear: float
    angular: float


class TiltTo(ToSimulator, frozen=True):
    angle: float


class SetDoors(ToSimulator, frozen=True):
    doors: dict[str, DoorState]


class Shutdown(ToSimulator, frozen=True):
    """The driver is done: brake, then end the process."""


class CarryTo(ToSimulator, frozen=True):
    """Put the robot elsewhere (operator); answered with `Done`, or `RoleRefused` if blocked."""

    x: float
    y: float
    theta: float


class Break(ToSimulator, frozen=True):
    """Break the robot, or repair it with no faults (operator); answered with `Done`."""

    faults: Faults


class AskTruth(ToSimulator, frozen=True):
    """Ask for one `Truth` (observer)."""


class AskHistory(ToSimulator, frozen=True):
    """Ask for the last `seconds` of `History` (observer)."""

    seconds: float


class SimulatorWelcome(FromSimulator, frozen=True):
    series: str
    map_id: str
    pid: int


class Truth(FromSimulator, frozen=True):
    """The robot as it is; `stamp` in Unix seconds, `commanded_at` that of the last velocity, 0
    before the first.

    `clearance` is measured for observers only. `people` are x, y, heading of those who walk about;
    `bumped` how often one of them walked into the robot; `bumper` the directions in which something
    is touched, in the robot's frame.
    """

    stamp: float
    x: float
    y: float
    theta: float
    odometry: tuple[float, float, float]
    linear: float
    angular: float
    commanded: tuple[float, float]
    commanded_at: float
    charge: float
    voltage: float
    docked: bool
    tilt: float
    clearance: float | None
    contacts: int
    distance: float
    doors: dict[str, DoorState]
    errors: tuple[str, ...]
    bumped: int = 0
    people: tuple[tuple[float, float, float], ...] = ()
    bumper: tuple[float, ...] = ()


class Ranges(FromSimulator, frozen=True):
    """A laser scan: float32 metres in native byte order, `inf` where nothing came back."""

    stamp: float
    ranges: bytes


class Echoes(FromSimulator, frozen=True):
    """Echoes of sonars: which, and metres from it, None for none."""

    stamp: float
    echoes: tuple[tuple[int, float | None], ...]


class History(FromSimulator, frozen=True):
    """Rows (stamp, commanded linear, angular, linear, angular, x, y, theta), one every step."""

    rows: tuple[tuple[float, float, float, float, float, float, float, float], ...]


class FrameRingOffer(FromSimulator, frozen=True):
    """The location of frames: a ring of slots in shared memory (see frame_ring.py)."""

    name: str
    slots: int
    width: int
    height: int


class FrameReady(FromSimulator, frozen=True):
    """Frame `number` is in its slot, captured at `stamp` (Unix seconds)."""

    number: int
    stamp: float


class Sound(FromSimulator, frozen=True):
    """20 ms of sound: 960 samples int16, mono, 48 kHz."""

    samples: bytes


class Done(FromSimulator, frozen=True):
    """An operator's message was carried out."""


class RoleRefused(FromSimulator, frozen=True):
    """Why a message was refused; the connection closes, unless it is an operator's."""

    reason: str


def _decoder(base: type[SimulatorMessage]) -> msgspec.msgpack.Decoder[Any]:
    return msgspec.msgpack.Decoder(functools.reduce(operator.or_, base.__subclasses__()))


_to_simulator, _from_simulator = _decoder(ToSimulator), _decoder(FromSimulator)


def unpack_command(body: bytes) -> Any:
    return framing.unpack(_to_simulator, body)


def unpack_answer(body: bytes) -> Any:
    return framing.unpack(_from_simulator, body)


async def read_answer(reader: asyncio.StreamReader) -> Any:
    """Wait for the next message of the simulator.

    Raises:
        WireError: it is no message.
        asyncio.IncompleteReadError, OSError: the connection ended.
    """
    return unpack_answer(await framing.read(reader))
