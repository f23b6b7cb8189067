"""What a simulated robot and its clients say to each other over TCP, framed as framing.py says.

A connection has one role, given in `SimulatorHello`: the driver moves the robot and receives its
state, an observer only looks (tests and benchmarks read the truth there), an operator injects
faults (carries the robot away, breaks it, moves doors), a camera gets the numbers of frames in
shared memory, a microphone gets sound. Each is a connection of its own, so that media never wait
before a velocity.
"""

import asyncio
from typing import Any, Literal

import msgspec
from msgspec import Struct

from robots.agent import framing
from robots.agent.simulator.faults import Faults
from robots.api.floorplan import DoorState

COMMAND_LIMIT = 64 << 10
Role = Literal["driver", "observer", "operator", "camera", "microphone"]


class SimulatorMessage(Struct, frozen=True, tag=True, array_like=True):
    """Base of every message on this wire."""


class SimulatorHello(SimulatorMessage, frozen=True):
    role: Role


class DriveOrder(SimulatorMessage, frozen=True):
    """A velocity; silence afterwards brakes."""

    linear: float
    angular: float


class TiltTo(SimulatorMessage, frozen=True):
    angle: float


class SetDoors(SimulatorMessage, frozen=True):
    doors: dict[str, DoorState]


class Shutdown(SimulatorMessage, frozen=True):
    """The driver is done: brake, then end the process."""


class CarryTo(SimulatorMessage, frozen=True):
    """Put the robot elsewhere (operator); answered with `Done`, or `RoleRefused` if blocked."""

    x: float
    y: float
    theta: float


class Break(SimulatorMessage, frozen=True):
    """An operator breaks the robot, or mends it with no faults; answered with `Done`."""

    faults: Faults


class AskTruth(SimulatorMessage, frozen=True):
    """An observer wants one `Truth`."""


class AskHistory(SimulatorMessage, frozen=True):
    """An observer wants the last seconds of `History`."""

    seconds: float


class SimulatorWelcome(SimulatorMessage, frozen=True):
    series: str
    map_id: str
    pid: int


class Truth(SimulatorMessage, frozen=True):
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


class Ranges(SimulatorMessage, frozen=True):
    """A laser scan: float32 metres in native byte order, `inf` where nothing came back."""

    stamp: float
    ranges: bytes


class Echoes(SimulatorMessage, frozen=True):
    """Echoes of sonars: which, and metres from it, None for none."""

    stamp: float
    echoes: tuple[tuple[int, float | None], ...]


class History(SimulatorMessage, frozen=True):
    """Rows (stamp, commanded linear, angular, linear, angular, x, y, theta), one every step."""

    rows: tuple[tuple[float, float, float, float, float, float, float, float], ...]


class FrameRingOffer(SimulatorMessage, frozen=True):
    """Where the pictures will be: a ring of slots in shared memory (see frame_ring.py)."""

    name: str
    slots: int
    width: int
    height: int


class FrameReady(SimulatorMessage, frozen=True):
    """Picture `number` is in its slot, sampled at `stamp` (Unix seconds)."""

    number: int
    stamp: float


class Sound(SimulatorMessage, frozen=True):
    """20 ms of sound: 960 samples int16, mono, 48 kHz."""

    samples: bytes


class Done(SimulatorMessage, frozen=True):
    """An operator's wish is done."""


class RoleRefused(SimulatorMessage, frozen=True):
    """Why something was refused; the connection closes, unless to an operator."""

    reason: str


ToSimulator = (
    SimulatorHello
    | DriveOrder
    | TiltTo
    | SetDoors
    | Shutdown
    | AskTruth
    | AskHistory
    | CarryTo
    | Break
)
FromSimulator = (
    SimulatorWelcome
    | Truth
    | Ranges
    | Echoes
    | History
    | FrameRingOffer
    | FrameReady
    | Sound
    | Done
    | RoleRefused
)

_to_simulator: msgspec.msgpack.Decoder[Any] = msgspec.msgpack.Decoder(ToSimulator)
_from_simulator: msgspec.msgpack.Decoder[Any] = msgspec.msgpack.Decoder(FromSimulator)


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
