"""What the control loop and a mind in a process of its own say to each other, on a socket of this computer.

Framed as framing.py says. First of all the mind says the token that it was started with, so that nobody else is taken for it.
"""

import numpy as np
from msgspec import Struct, msgpack

from robots.agent import framing
from robots.agent.autonomy.sensor_snapshot import Body, NavigationOutput, SensorSnapshot
from robots.api.geometry import Pose2D
from robots.api.messages import Dock, FloorPlanUpdate, Follow, Goto, Pose, Relocalize, Undock, Velocity
from robots.world.sensing import LaserScan


class Word(Struct, frozen=True, tag=True, array_like=True):
    """Base of every message on this wire."""


class Settle(Word, frozen=True):
    """Begin to be the mind of this robot in this site; `seed` of everything random."""

    body: Body
    area: FloorPlanUpdate
    seed: int


class Place(Word, frozen=True):
    """The robot is here, give or take metres and radians."""

    pose: Pose2D
    spread: float
    turn: float


class Order(Word, frozen=True):
    """Begin an action; the answer has the same number."""

    number: int
    action: Goto | Follow | Dock | Undock | Relocalize


class Drop(Word, frozen=True):
    """Cancel an action."""

    action_id: str


class Sweep(Struct, frozen=True, array_like=True):
    """A sweep of the laser; `ranges` float32 in the byte order of the machine, `inf` where nothing came back."""

    stamp: float
    angle_min: float
    angle_increment: float
    range_max: float
    mount: Pose2D
    ranges: bytes


class Perceive(Word, frozen=True):
    """One moment; `sweep` only when it is a new one, `points` pairs of float32."""

    stamp: float
    odometry: Pose2D
    velocity: Velocity
    charger_contact: bool
    sweep: Sweep | None
    points: bytes
    pose: Pose | None = None


class Token(Word, frozen=True):
    """First word of a mind."""

    token: str


class Settled(Word, frozen=True):
    """The mind thinks; or it cannot, and why."""

    problem: str = ""


class Answer(Word, frozen=True):
    """An order is begun; or it cannot be, and why."""

    number: int
    problem: str = ""


class Thinks(Word, frozen=True):
    """What followed from the newest perception."""

    thought: NavigationOutput


ToMind = Settle | Place | Order | Drop | Perceive
FromMind = Token | Settled | Answer | Thinks

_to_mind: msgpack.Decoder[ToMind] = msgpack.Decoder(ToMind)
_from_mind: msgpack.Decoder[FromMind] = msgpack.Decoder(FromMind)


def unpack_order(body: bytes) -> ToMind:
    """Return what the control loop said.

    Raises:
        WireError: it is no message.
    """
    return framing.unpack(_to_mind, body)


def unpack_answer(body: bytes) -> FromMind:
    """Return what a mind said.

    Raises:
        WireError: it is no message.
    """
    return framing.unpack(_from_mind, body)


def perceive(moment: SensorSnapshot, *, new: bool) -> Perceive:
    """Return a perception as a message, with its sweep when that is `new`."""
    sweep = None
    if new and moment.beams is not None:
        beams = moment.beams
        ranges = beams.ranges.astype(np.float32).tobytes()
        sweep = Sweep(beams.stamp, beams.angle_min, beams.angle_increment, beams.range_max, beams.mount, ranges)
    return Perceive(
        moment.stamp, moment.odometry, moment.velocity, moment.charger_contact, sweep, moment.points.astype(np.float32).tobytes(), moment.pose
    )


def perceived(message: Perceive, beams: LaserScan | None) -> SensorSnapshot:
    """Return the perception of a message; `beams` is the newest sweep, its own or an earlier one.

    Raises:
        WireError: its bytes are no points.
    """
    try:
        points = np.frombuffer(message.points, dtype=np.float32).astype(np.float64).reshape(-1, 2)
    except ValueError as error:
        raise framing.WireError(str(error)) from error
    return SensorSnapshot(message.stamp, message.odometry, message.velocity, message.charger_contact, beams, points, message.pose)


def beams_in(sweep: Sweep) -> LaserScan:
    """Return the sweep of a message.

    Raises:
        WireError: its bytes are no ranges.
    """
    try:
        ranges = np.frombuffer(sweep.ranges, dtype=np.float32).astype(np.float64)
    except ValueError as error:
        raise framing.WireError(str(error)) from error
    return LaserScan(sweep.stamp, sweep.angle_min, sweep.angle_increment, sweep.range_max, ranges, sweep.mount)
