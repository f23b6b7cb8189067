"""Data channels over a network that loses packets: how often FORWARD TSN is sent.

A message that is not sent again leaves a gap, and a FORWARD TSN (RFC 3758) tells the receiver to
step over it. aiortc sends one in answer to every SACK that does not know it yet, and the receiver
answers every one with a SACK: where a full queue makes the path half a second long, some hundred of
each are under way at any moment, more with each message, and they are what fills the queue.
"""

import time
from typing import Any

SAY_AGAIN = 0.25  # s; unordered messages are handed over as they come, so nothing waits for it


def limit_forward_tsn(transport: Any) -> None:
    """Let an `RTCSctpTransport` send FORWARD TSN at most every `SAY_AGAIN` s."""
    update = transport._update_advanced_peer_ack_point
    sent_at = float("-inf")

    def update_seldom() -> None:
        nonlocal sent_at
        update()
        if transport._forward_tsn_chunk is not None:
            now = time.monotonic()
            if now - sent_at < SAY_AGAIN:
                transport._forward_tsn_chunk = None
            else:
                sent_at = now

    transport._update_advanced_peer_ack_point = update_seldom
