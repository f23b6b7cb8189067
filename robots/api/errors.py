"""The refusal of a malformed, oversized or misdirected message."""

from typing import Literal

RejectionReason = Literal[
    "oversized", "malformed", "unknown_topic", "wrong_direction", "not_from_server"
]


class Rejection(ValueError):
    """A message that was refused before it had any effect.

    Args:
        reason: under which it is counted.
        detail: for the log; never shown to a visitor, and never the payload itself.
    """

    def __init__(self, reason: RejectionReason, detail: str = "") -> None:
        super().__init__(f"{reason}: {detail}" if detail else reason)
        self.reason = reason
        self.detail = detail
