"""A simulated network line on an event loop."""

import asyncio
import time
from collections.abc import Callable

from robots.agent.lab.line import Deliver, NetworkLine
from robots.api.messages import LabReport, NetworkLab


class TimedLine:
    """Belongs to the loop that it is made on, except `report`; `now` gives monotonic seconds."""

    def __init__(self, lab: NetworkLab, now: Callable[[], float] = time.monotonic) -> None:
        self._line, self._now = NetworkLine(lab), now
        self._loop = asyncio.get_running_loop()
        self._timer: asyncio.TimerHandle | None = None
        self._rings_at = float("inf")
        self._closed = False

    def offer(self, size: int, deliver: Deliver) -> None:
        """Send a packet of `size` bytes; `deliver` is called now, later, or never."""
        if not self._closed:
            self._line.offer(deliver, size, self._now())
            self._let_out()

    def close(self) -> None:
        self._closed = True
        if self._timer is not None:
            self._timer.cancel()

    def report(self) -> LabReport:
        """Return the network and the fates of its packets; from any thread."""
        counts = self._line.counts
        return LabReport(
            lab=self._line.lab,
            taken=counts.taken,
            lost=counts.lost,
            overflowed=counts.overflowed,
            reordered=counts.reordered,
            waiting=self._line.waiting,
            held=counts.held / counts.out if counts.out else 0.0,
        )

    def _let_out(self) -> None:
        # each by the loop itself, so that one that raises does not hold up the others
        for deliver in self._line.due(self._now()):
            self._loop.call_soon(self._deliver, deliver)
        at = self._line.next()
        if at is None or at >= self._rings_at or self._closed:
            return
        if self._timer is not None:
            self._timer.cancel()
        self._rings_at = at
        self._timer = self._loop.call_later(max(0.0, at - self._now()), self._ring)

    def _deliver(self, deliver: Deliver) -> None:
        if not self._closed:
            deliver()

    def _ring(self) -> None:
        self._timer, self._rings_at = None, float("inf")
        self._let_out()
