"""Turns messages of the robot into frames for pages: pure."""

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

# Messages that a newer one replaces: they may be dropped for a slow page.
TELEMETRY = frozenset({"state", "pose", "path", "scan", "heartbeat"})
KEPT = frozenset({"event", "action", "route"})
# Not sent to a page that receives the robot's messages directly. It still gets every eighth state,
# in case the direct connection fails.
SKIPPED_IF_DIRECT = frozenset({"pose", "scan", "pointer"})
# Not sent to pages that watch through the SFU: there may be a thousand of them.
SKIPPED_WITH_SFU = SKIPPED_IF_DIRECT | {"heartbeat"}
# s between two messages: of a direct page, states come four times a second and heartbeats five;
# of others, which would fill a narrow network at their own pace
DIRECT_SECONDS = {"state": 1.9, "heartbeat": 0.9}
RELAYED_SECONDS = {"scan": 0.95, "pose": 0.19}
# The reason in `robot` for a robot that is offline to this process.
BROKER_AWAY = "server"
HARMLESS = frozenset({"disk_low", "disk_full"})  # leases are renewed and the record waits in memory


@dataclass(frozen=True)
class Outgoing:
    """A frame for the page; a `droppable` one is worthless once there is a newer one."""

    frame: str
    droppable: bool = False


class TelemetryFilter:
    """Decides which telemetry one page receives: all, with few scans and poses, or little while
    `direct`, which is when the page receives the robot's messages over the data channel.
    """

    def __init__(self) -> None:
        self.direct = False
        self._passed_at: dict[str, float] = {}

    def passes(self, suffix: str, now: float, *, by_sfu: bool = False) -> bool:
        """Tell whether to send a message to the page; `now` is monotonic seconds."""
        skipped = SKIPPED_IF_DIRECT if self.direct else frozenset()
        if suffix in (SKIPPED_WITH_SFU if by_sfu else skipped):
            return False
        periods = DIRECT_SECONDS if self.direct or by_sfu else RELAYED_SECONDS
        if now - self._passed_at.get(suffix, float("-inf")) < periods.get(suffix, 0.0):
            return False
        self._passed_at[suffix] = now
        return True


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
    """Return the frame of a message for the driver alone: chat, its receipts, and where a person at
    the robot's display points. None for all other messages, and in a hidden operator's session for
    the operator's lines, which the robot speaks as its own.
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
    """Return the frame of a message for the robot's own display, including where the driver points;
    None for other messages.
    """
    match inbound:
        case ReceivedMessage(suffix="state" | "action" | "words" as suffix, frame=str() as frame):
            return Outgoing(frame, droppable=suffix == "state")
        case ReceivedMessage(message=Pointer(by="driver"), frame=str() as frame):
            return Outgoing(frame, droppable=True)
    return None


def presence(known: KnownRobot, *, link: bool) -> protocol.RobotPresence | None:
    """Return whether the robot is online as far as this process knows; None before its first
    message.
    """
    if not link:
        return protocol.RobotPresence(online=False, reason=BROKER_AWAY)
    if known.connection is None:
        return None
    return protocol.RobotPresence(
        online=known.connection.state == "ONLINE", reason=known.connection.reason
    )


def status(faults: Iterable[str], known: KnownRobot, now: float) -> Outgoing:
    """Return the frame of the present faults, for pages of a robot; `now` is monotonic seconds."""
    return Outgoing(
        encode_frame(
            "server/status",
            protocol.ServerStatus(faults=tuple(_fault(part, known, now) for part in faults)),
        ),
        droppable=True,
    )


def _fault(part: Any, known: KnownRobot, now: float) -> protocol.Fault:
    """Return a fault with its effect: most faults keep the lease from being renewed, and a robot
    stops when its lease expires.
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
