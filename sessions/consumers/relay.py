"""What a page hears of its robot: messages of the bridge turned into frames, pure."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import msgspec

from robots.api import topics
from robots.api.codec import encode_frame
from robots.api.messages import Heartbeat, Lease, Message, Pointer, Words
from robots.bridge.delivery import LINK, ReceivedMessage
from robots.bridge.known import KnownRobot
from robots.bridge.server_watch import ROBOT
from sessions import protocol

# Newest wins: an older one may be dropped on the way to a slow page.
TELEMETRY = frozenset({"state", "pose", "path", "scan", "heartbeat"})
KEPT = frozenset({"event", "action"})
# What a page that hears its robot directly is spared; of states it gets one now and then, in case
# the direct way falls silent.
SPARED = frozenset({"pose", "scan", "pointer"})
# What pages that watch through the SFU are spared besides: there may be a thousand of them.
SPARED_BY_SFU = SPARED | {"heartbeat"}
STATE_SECONDS = 1.9  # states come four times a second: every eighth
# Why a robot is not there, in `robot`.
BROKER_AWAY = "server"
HARMLESS = frozenset({"disk_low", "disk_full"})  # leases are renewed and the record waits in memory


@dataclass(frozen=True)
class Outgoing:
    """A frame for the page, and whether a newer one makes it worthless."""

    frame: str
    droppable: bool = False


class Sparing:
    """What of a robot's telemetry goes to one page: all of it, or little while the page says that
    it hears the robot directly.
    """

    def __init__(self) -> None:
        self.direct = False
        self._state_at = float("-inf")

    def passes(self, suffix: str, now: float, *, by_sfu: bool = False) -> bool:
        """Tell whether a message goes to the page; `now` is monotonic."""
        if suffix == "state":
            if (self.direct or by_sfu) and now - self._state_at < STATE_SECONDS:
                return False
            self._state_at = now
        if by_sfu:
            return suffix not in SPARED_BY_SFU
        return not (self.direct and suffix in SPARED)


def outgoing(suffix: str, message: Message) -> Outgoing:
    """Return a message of the server's own as a frame that is never dropped."""
    return Outgoing(encode_frame(suffix, message))


def relayed(inbound: ReceivedMessage, peer: str) -> Outgoing | None:
    """Return the frame of a robot's message for a page with this peer id; None when it is not for
    that page.

    Peer ids are secret to their pages: a heartbeat keeps the echo of this page alone, and a reply
    goes to its own peer.
    """
    match inbound:
        case ReceivedMessage(suffix="heartbeat", message=Heartbeat() as beat):
            own = tuple(echo for echo in beat.echoes if echo.peer == peer)
            return Outgoing(
                encode_frame("heartbeat", msgspec.structs.replace(beat, echoes=own)), droppable=True
            )
        case ReceivedMessage(suffix=suffix) if suffix in TELEMETRY or suffix in KEPT:
            assert isinstance(inbound.frame, str)
            return Outgoing(inbound.frame, droppable=suffix in TELEMETRY)
        case ReceivedMessage(suffix=suffix) if suffix == f"{protocol.SIGNAL}/{peer}/reply":
            return outgoing("signal/reply", inbound.message)
    return None


def for_driver(inbound: ReceivedMessage, lease: Lease | None) -> Outgoing | None:
    """Return what a robot says to whoever has it alone: words and what became of them, and where
    somebody at its display points; None for all the rest, and for what the robot says in the voice
    of its own, which a hidden operator gives it.
    """
    match inbound:
        case ReceivedMessage(message=Words(by="driver", who="")) if (
            lease is not None and lease.kind == "wizard"
        ):
            return None
        case ReceivedMessage(suffix="words" | "receipt", frame=str() as frame):
            return Outgoing(frame)
        case ReceivedMessage(message=Pointer(by="screen"), frame=str() as frame):
            return Outgoing(frame, droppable=True)
    return None


def for_screen(inbound: ReceivedMessage) -> Outgoing | None:
    """Return what a robot says to its own display, where the driver points among it; None for what
    is none of its business.
    """
    match inbound:
        case ReceivedMessage(suffix="state" | "action" | "words" as suffix, frame=str() as frame):
            return Outgoing(frame, droppable=suffix == "state")
        case ReceivedMessage(message=Pointer(by="driver"), frame=str() as frame):
            return Outgoing(frame, droppable=True)
    return None


def presence(known: KnownRobot, *, link: bool) -> protocol.RobotPresence | None:
    """Return whether the robot is there, as far as this process can tell; None before the robot has
    said anything.
    """
    if not link:
        return protocol.RobotPresence(online=False, reason=BROKER_AWAY)
    if known.connection is None:
        return None
    return protocol.RobotPresence(
        online=known.connection.state == "ONLINE", reason=known.connection.reason
    )


def status(faults: Iterable[str], known: KnownRobot, now: float) -> Outgoing:
    """Return what the pages of a robot are told of parts that fail; `now` is monotonic. Worthless
    once the next one is there.
    """
    return Outgoing(
        encode_frame(
            "server/status",
            protocol.ServerStatus(faults=tuple(_fault(part, known, now) for part in faults)),
        ),
        droppable=True,
    )


def _fault(part: Any, known: KnownRobot, now: float) -> protocol.Fault:
    """Say what follows: without these parts nobody renews a lease, and a robot whose lease has run
    out stands.
    """
    if part in HARMLESS:
        return protocol.Fault(part=part, then="goes_on")
    if known.lease is None:
        return protocol.Fault(part=part, then="waits")
    left = known.renewed_at + known.lease.ttl - now
    if part == ROBOT or left <= 0.0:
        return protocol.Fault(part=part, then="stopped")
    return protocol.Fault(part=part, then="stops", seconds=left)


assert {*TELEMETRY, *KEPT, "media"} == set(topics.TO_PAGE)
assert LINK not in topics.TO_PAGE
