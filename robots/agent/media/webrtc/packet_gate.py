"""Rate limits of a page's data channel; each frame is decoded here, once."""

from collections import Counter
from typing import Literal

from robots.api.bucket import Bucket
from robots.api.codec import decode_frame
from robots.api.errors import Rejection
from robots.api.messages import (
    Action,
    CommandHeartbeat,
    EStop,
    PointCommand,
    RouteRequest,
    Stop,
    VelocityCommand,
)

Command = VelocityCommand | Action | CommandHeartbeat | PointCommand | RouteRequest
ReceivedPacket = Command | Rejection
Verdict = Literal["accepted", "oversized", "too_fast"]
Kind = Literal["velocity", "stop", "heartbeat", "point", "route", "action", "nonsense"]

MAX_BYTES = 64 * 1024


class PacketGate:
    """The token buckets of one peer, and counts of their verdicts. Times are monotonic seconds.

    Each kind of message has a bucket of its own, so that other messages of a page cannot use up
    that of its stops. A page that drives sends 20 to 50 velocities a second, 20 stops until one is
    confirmed, five heartbeats, at most as many pointers as are shown, and five route requests.
    Refused messages count towards a flood: no page of ours is ever refused here.
    """

    def __init__(self) -> None:
        self._buckets: dict[Kind, Bucket] = {
            "velocity": Bucket(rate=100.0, burst=100.0),
            "stop": Bucket(rate=60.0, burst=60.0),
            "heartbeat": Bucket(rate=20.0, burst=20.0),
            "point": Bucket(rate=30.0, burst=30.0),
            "route": Bucket(rate=10.0, burst=10.0),
            "action": Bucket(rate=30.0, burst=60.0),
            "nonsense": Bucket(rate=50.0, burst=50.0),
        }
        self._refusals = Bucket(rate=50.0, burst=500.0)
        self.floods = False
        self.counts: Counter[Verdict] = Counter()

    def take(self, frame: str | bytes, now: float) -> ReceivedPacket | None:
        """Return a frame's message or its rejection; None when too large or one too many."""
        packet = None if len(frame) > MAX_BYTES else decoded(frame)
        verdict: Verdict = "oversized" if packet is None else "accepted"
        if packet is not None and not self._buckets[_kind(packet)].spend(now):
            verdict = "too_fast"
        self.counts[verdict] += 1
        if verdict == "accepted":
            return packet
        self.floods = self.floods or not self._refusals.spend(now)
        return None


def decoded(frame: str | bytes) -> ReceivedPacket:
    """Return the command that a frame of a data channel holds, or why it holds none."""
    try:
        suffix, message = decode_frame(frame, "to_robot")
    except Rejection as rejection:
        return rejection
    return message if isinstance(message, Command) else Rejection("not_from_server", suffix)


def _kind(packet: ReceivedPacket) -> Kind:
    match packet:
        case Stop() | EStop():
            return "stop"
        case VelocityCommand():
            return "velocity"
        case CommandHeartbeat():
            return "heartbeat"
        case PointCommand():
            return "point"
        case RouteRequest():
            return "route"
        case Action():
            return "action"
    return "nonsense"
