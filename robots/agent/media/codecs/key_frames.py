"""When to make a key frame: at once for a new viewer, rarely for the rest.

A key frame costs ten times a delta frame and every viewer of a shared encoder pays for it, so a
request waits until its kind's gap since the last key frame is over. It is never forgotten: a viewer
without a key frame sees nothing.
"""

from typing import Literal

Reason = Literal["joined", "lost", "behind"]

# Seconds since the last key frame: a new viewer; a PLI or FIR after packet loss; a viewer that
# could not keep up.
GAPS: dict[Reason, float] = {"joined": 0.0, "lost": 0.3, "behind": 2.0}


class KeyFrames:
    """Requests for a key frame and the time of the last; `now` is monotonic seconds."""

    def __init__(self) -> None:
        self._pending: set[Reason] = set()
        self._last = float("-inf")

    def ask(self, reason: Reason) -> None:
        self._pending.add(reason)

    def ask_now(self, reason: Reason, now: float) -> bool:
        """Ask for a key frame; when it is due, count it as made and return True."""
        self.ask(reason)
        if not self.is_due(now):
            return False
        self.made(now)
        return True

    def is_due(self, now: float) -> bool:
        return bool(self._pending) and now - self._last >= min(
            GAPS[reason] for reason in self._pending
        )

    def made(self, now: float) -> None:
        """Note that a key frame was made, asked for or not: it serves everyone."""
        self._pending.clear()
        self._last = now
