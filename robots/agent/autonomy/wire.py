"""Messages between the control loop and the navigation process, framed as framing.py says."""

import numpy as np
from msgspec import Struct, msgpack

from robots.agent.autonomy.sensor_snapshot import Body, NavigationOutput, SensorSnapshot
from robots.api.geometry import Pose2D
from robots.api.messages import (
    Dock,
    FloorPlanUpdate,
    Follow,
    Goto,
    Point,
    Pose,
    Relocalize,
    Undock,
    Velocity,
)
from robots.process import framing
from robots.world.sensing import LaserScan


class NodeMessage(Struct, frozen=True, tag=True, array_like=True):
    """Base of every message on this wire."""


class Settle(NodeMessage, frozen=True):
    """Navigate this robot in this site; `seed` of everything random."""

    body: Body
    area: FloorPlanUpdate
    seed: int


class KnownPlace(NodeMessage, frozen=True):
    """The robot is here, to within metres and radians."""

    pose: Pose2D
    spread: float
    turn: float


class BeginAction(NodeMessage, frozen=True):
    """Begin an action; the answer has the same number."""

    number: int
    action: Goto | Follow | Dock | Undock | Relocalize


class CancelAction(NodeMessage, frozen=True):
    action_id: str


class FindRoute(NodeMessage, frozen=True):
    """Plan a route to a point of the map; the answer has the same number."""

    number: int
    x: float
    y: float


class ScanMessage(Struct, frozen=True, array_like=True):
    """A laser sweep; `ranges` are float32 in native byte order, `inf` where nothing came back."""

    stamp: float
    angle_min: float
    angle_increment: float
    range_max: float
    mount: Pose2D
    ranges: bytes


class Perceive(NodeMessage, frozen=True):
    """One moment; `sweep` only when it is a new one, `points` pairs of float32."""

    stamp: float
    odometry: Pose2D
    velocity: Velocity
    charger_contact: bool
    sweep: ScanMessage | None
    points: bytes
    pose: Pose | None = None


class Settled(NodeMessage, frozen=True):
    """The site is set up; or it cannot be, and why."""

    problem: str = ""


class OrderReply(NodeMessage, frozen=True):
    """An order is begun; or it cannot be, and why."""

    number: int
    problem: str = ""


class FoundRoute(NodeMessage, frozen=True):
    """The points and the reason of `messages.RoutePreview`."""

    number: int
    points: tuple[Point, ...]
    reason: str = ""


class NodeOutput(NodeMessage, frozen=True):
    """The output for the newest snapshot."""

    output: NavigationOutput


ToNode = Settle | KnownPlace | BeginAction | CancelAction | FindRoute | Perceive
FromNode = Settled | OrderReply | FoundRoute | NodeOutput

_to_node: msgpack.Decoder[ToNode] = msgpack.Decoder(ToNode)
_from_node: msgpack.Decoder[FromNode] = msgpack.Decoder(FromNode)


def unpack_order(body: bytes) -> ToNode:
    return framing.unpack(_to_node, body)


def unpack_answer(body: bytes) -> FromNode:
    return framing.unpack(_from_node, body)


def perceive(moment: SensorSnapshot, *, new: bool) -> Perceive:
    """Return a perception as a message, with its sweep when that is `new`."""
    sweep = None
    if new and moment.beams is not None:
        beams = moment.beams
        ranges = beams.ranges.astype(np.float32).tobytes()
        sweep = ScanMessage(
            beams.stamp,
            beams.angle_min,
            beams.angle_increment,
            beams.range_max,
            beams.mount,
            ranges,
        )
    return Perceive(
        moment.stamp,
        moment.odometry,
        moment.velocity,
        moment.charger_contact,
        sweep,
        moment.points.astype(np.float32).tobytes(),
        moment.pose,
    )


def perceived(message: Perceive, beams: LaserScan | None) -> SensorSnapshot:
    """Return a message's perception with the newest sweep; WireError for invalid points."""
    try:
        points = np.frombuffer(message.points, dtype=np.float32).astype(np.float64).reshape(-1, 2)
    except ValueError as error:
        raise framing.WireError(str(error)) from error
    return SensorSnapshot(
        message.stamp,
        message.odometry,
        message.velocity,
        message.charger_contact,
        beams,
        points,
        message.pose,
    )


def beams_in(sweep: ScanMessage) -> LaserScan:
    """Return the sweep of a message; raises WireError for invalid ranges."""
    try:
        ranges = np.frombuffer(sweep.ranges, dtype=np.float32).astype(np.float64)
    except ValueError as error:
        raise framing.WireError(str(error)) from error
    return LaserScan(
        sweep.stamp, sweep.angle_min, sweep.angle_increment, sweep.range_max, ranges, sweep.mount
    )
