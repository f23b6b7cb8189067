"""Who may point on the picture that the driver shares, and how often. Pure.

A dot moves nothing and is only worth showing while it is new, so a refused dot is dropped and
counted without an answer. The kernel's counters are separate, because studies read them as commands
that did not reach the wheels.
"""

from collections import Counter
from dataclasses import dataclass
from typing import Literal

import structlog

from robots.agent.safety.permissions import CommandSender, forbidden, mismatch, role_of
from robots.api.bucket import Bucket
from robots.api.messages import Lease, PointCommand

log = structlog.stdlib.get_logger(__name__)

RATE = 20.0  # dots a second of one peer, a third more than our pages send
BURST = 10.0
PEERS = 16  # remembered; a robot has one driver and few displays
FORGOTTEN = 5.0  # s without dots, after which a peer's stamps may start again: its clock was set


@dataclass
class Hand:
    """One peer: its newest stamp by its own clock, and the dots that it may still send at once."""

    bucket: Bucket
    stamp: float = float("-inf")


class Pointing:
    """Decides which dots pass; `refused` counts the others by reason. Times are monotonic."""

    def __init__(self) -> None:
        self._hands: dict[str, Hand] = {}
        self.refused: Counter[str] = Counter()

    def take(
        self,
        peer: str,
        command: PointCommand,
        sender: CommandSender,
        lease: Lease | None,
        *,
        shown: bool,
        now: float,
    ) -> Literal["driver", "screen"] | None:
        """Return whose dot it is, None when it is dropped.

        `peer` is from signalling or stamped by the server, `lease` the live one, and `shown` tells
        whether the people at the robot see what the driver shares.
        """
        role = role_of(command, sender, lease)
        reason = self._refusal(role, command, sender, lease, shown=shown) or self._staleness(
            peer, command.stamp, now
        )
        if reason is None:
            return "driver" if role == "driver" else "screen"
        self.refused[reason] += 1
        if self.refused[reason] == 1:
            log.info("point_refused", reason=str(reason), role=role, transport=sender.transport)
        return None

    def _refusal(
        self,
        role: str,
        command: PointCommand,
        sender: CommandSender,
        lease: Lease | None,
        *,
        shown: bool,
    ) -> str | None:
        if lease is None:
            return "no_lease"
        if role == "driver":
            reason = mismatch(command.session, command.epoch, sender, lease) or (
                "not_allowed" if forbidden(lease, sender) else None
            )
        else:
            reason = None if role == "screen" else "observer"
        return reason or (None if shown else "not_shown")

    def _staleness(self, peer: str, stamp: float, now: float) -> str | None:
        """Return why a permitted peer's dot is too old or too frequent, or remember it."""
        hand = self._hands.pop(peer, None)
        if hand is None or now - hand.bucket.at > FORGOTTEN:
            hand = Hand(Bucket(RATE, BURST))
        # at the end, so that the first is the peer that has not pointed for longest
        self._hands[peer] = hand
        if len(self._hands) > PEERS:
            del self._hands[next(iter(self._hands))]
        if stamp <= hand.stamp:
            return "old"
        if not hand.bucket.spend(now):
            return "rate"
        hand.stamp = stamp
        return None
