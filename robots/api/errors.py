"""What can be wrong with bytes that claim to be a message."""

from typing import Literal

RejectionReason = Literal[
    "oversized", "malformed", "unknown_topic", "wrong_direction", "not_from_server"
]


class Rejection(ValueError):
    """A message that was refused before anybody acted on it.

    Args:
        reason: one of `oversized`, `malformed`, `unknown_topic`, `wrong_direction`,
            `not_from_server`; the key under which it is counted.
        detail: what exactly was wrong, for the log; never shown to a visitor and never the payload
            itself.
    """

    def __init__(self, reason: RejectionReason, detail: str = "") -> None:
        super().__init__(f"{reason}: {detail}" if detail else reason)
        self.reason = reason
        self.detail = detail
