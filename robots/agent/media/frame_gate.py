"""How much a page may say on its data channel before anybody decodes it."""

from collections import Counter
from typing import Literal

Verdict = Literal["accepted", "oversized", "too_fast"]

MAX_BYTES = 64 * 1024
RATE = 200.0  # frames a second, four times what a driving page sends
BURST = 200.0


class FrameGate:
    """A token bucket for one peer, and what it let through or not; `now` is any monotonic clock in seconds.

    A frame that may be a stop passes a bucket that is empty: a page that floods must still be able to stop its robot.
    """

    def __init__(self, now: float) -> None:
        self._tokens = BURST
        self._filled = now
        self.counts: Counter[Verdict] = Counter()

    def judge(self, frame: str | bytes, now: float) -> Verdict:
        """Return what to do with a frame, and count it."""
        verdict = self._verdict(frame, now)
        self.counts[verdict] += 1
        return verdict

    def _verdict(self, frame: str | bytes, now: float) -> Verdict:
        if len(frame) > MAX_BYTES:
            return "oversized"
        self._tokens = min(BURST, self._tokens + (now - self._filled) * RATE)
        self._filled = now
        if self._tokens < 1.0:
            return "accepted" if _may_be_a_stop(frame) else "too_fast"
        self._tokens -= 1.0
        return "accepted"


def _may_be_a_stop(frame: str | bytes) -> bool:
    """Tell whether a frame could hold a stop or an e-stop, without decoding it."""
    return "stop" in frame if isinstance(frame, str) else b"stop" in frame
