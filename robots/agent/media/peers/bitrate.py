"""Which layer of quality one viewer gets: lower at once when the network takes less, up by trial.

Pure. The measure is how long packets take to the viewer (webrtc/feedback.py): when more is sent
than arrives, they wait before the bottleneck. Loss counts only where it is too much for
retransmission, because radio loses packets at any rate.

To try a higher layer, copies of sent packets are added for a moment, to see whether packets become
slower. That costs no frame, whereas a trial of the layer itself starts with a large key frame.
"""

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

from robots.agent.media.webrtc.feedback import ArrivalReport


@dataclass(frozen=True)
class BitrateParams:
    """The conditions for changing a viewer's layer.

    Lateness is (s slower than at its best, reports in a row).
    """

    # the first packet of a frame can wait for a key frame before it
    late: tuple[float, int] = (0.15, 3)
    very_late: tuple[float, int] = (0.3, 2)
    late_in_trial: tuple[float, int] = (0.07, 2)
    best_delay_for: float = 60.0  # s for which the best delay counts
    picture_share: float = 0.8  # of the network's rate; sound and messages need the rest
    beside: float = 60_000.0  # bit/s, what these need at least
    lossy: float = 0.2  # share of the packets lost, in two counts in a row
    very_lossy: float = 0.35  # the same, in one count
    few_packets: int = 10  # in a report that is also very late
    count_for: float = 1.0  # s of packets at least that are counted together
    count_packets: int = 30  # the same, packets
    # (s, frames) without a report, as when all packets are lost; after it no trial begins
    silence: tuple[float, int] = (1.0, 5)
    same: float = 0.02  # s between the times of two packets that were sent together
    steady: float = 0.8  # share of the sent data that arrives, above which no queue grows
    full_queue: float = 0.5  # share that is assumed to arrive through a full queue
    least_share: float = 0.05  # of the same; so few packets tell no less
    settling: float = 1.0  # s after a step down in which nothing new is learned
    drained: float = 3.0  # s, the same while the delay falls
    # s without a picture, so that the queue can drain; after 1 s the robot would stop
    longest_pause: float = 0.5
    first_hold: float = 1.5  # s without lateness before a trial; doubled by each that fails
    longest_hold: float = 6.0  # s, the same at most
    next_hold: float = 0.3  # s, after a successful trial
    probe: float = 0.35  # s of sending more
    watch: float = 0.65  # s after it in which packets may still become slower
    regret: float = 4.0  # s in which a step up still counts as a trial


BITRATE = BitrateParams()


class BitrateAdapter:
    """One viewer's layer, at first the best; `rates` are in bit/s, times monotonic seconds."""

    def __init__(self, rates: Sequence[int], now: float, params: BitrateParams = BITRATE) -> None:
        self._params = params
        self.layer = 0
        self.probes = 0
        self._rates = tuple(rates)
        self._delays: deque[tuple[float, float]] = deque()  # the least of each second, at most
        # when reported, and how much slower than at its best
        self._late: deque[tuple[float, float]] = deque(maxlen=3)
        self._reports: deque[ArrivalReport] = deque(maxlen=3)
        self._counted_from, self._expected, self._lost = now, 0, 0
        self._unreported = 0  # frames since the last report
        self._lossy = 0
        self._calm_since = self._down_at = now
        self._up_at = float("-inf")
        self._hold = self._patience = self._params.first_hold
        self._probe_at: float | None = None
        self._silent_until = float("-inf")

    def pauses(self, now: float) -> bool:
        """Tell whether to send no picture, because too many are queued in the network."""
        return now < self._silent_until

    def delivered(self, now: float, delivery: ArrivalReport, sent: float) -> None:
        """Take a report of the viewer, and what it is sent (bit/s)."""
        params, delay = self._params, delivery.delay
        self._unreported = 0
        self._remember(now, delay)
        self._late.append((now, delay - min(delay for _, delay in self._delays)))
        self._reports.append(delivery)
        falls = len(self._late) > 1 and self._late[-1][1] < self._late[-2][1]
        settles = now - self._down_at < params.settling or (
            falls and now - self._down_at < params.drained
        )
        signs = (
            (params.late, params.very_late) if self._probe_at is None else (params.late_in_trial,)
        )
        is_late = any(self._is_late(limit, often) for limit, often in signs)
        if not settles and (is_late or self._is_queue_full()):
            self._step_down(now, self._share() * sent, waits=self._late[-1][1])
        self._count(now, delivery.expected, delivery.lost)

    def _share(self) -> float:
        """Return the share of the sent data that arrives: while a queue grows, what was sent in a
        second takes longer than one to arrive. A full queue hides that, but loses packets.
        """
        params, first, last = self._params, self._reports[0], self._reports[-1]
        sent_in = last.sent_at - first.sent_at
        arrived_in = sent_in + last.delay - first.delay
        kept = 1.0 - sum(one.lost for one in self._reports) / max(
            1, sum(one.expected for one in self._reports)
        )
        share = min(kept, sent_in / max(0.1, arrived_in)) if sent_in > params.same else kept
        if share < params.steady:
            return max(share, params.least_share)
        return params.full_queue if self._late[-1][1] > params.very_late[0] else 1.0

    def _is_late(self, limit: float, often: int) -> bool:
        return len(self._late) >= often and all(
            late > limit for _, late in list(self._late)[-often:]
        )

    def _is_queue_full(self) -> bool:
        """Tell whether one report shows both signs of it; a second one would come too late for the
        messages that share the queue.
        """
        params, report = self._params, self._reports[-1]
        return (
            self._late[-1][1] > params.very_late[0]
            and report.expected >= params.few_packets
            and report.lost >= params.very_lossy * report.expected
        )

    def _count(self, now: float, expected: int, lost: int) -> None:
        """Count lost packets; a report alone has too few to tell what share is lost."""
        params = self._params
        if now - self._down_at < params.settling:
            self._counted_from, self._expected, self._lost = now, 0, 0
            return
        self._expected, self._lost = self._expected + expected, self._lost + lost
        if now - self._counted_from < params.count_for or self._expected < params.count_packets:
            return
        share = self._lost / self._expected
        self._counted_from, self._expected, self._lost = now, 0, 0
        self._lossy = 0 if share < params.lossy else self._lossy + 1
        if share >= params.very_lossy or self._lossy > 1:
            self._step_down(now, None)

    def look(self, now: float) -> float:
        """Let time pass before a frame; return bit/s to reach by sending packets again, 0 without a
        trial.
        """
        params = self._params
        self._unreported += 1
        if self._is_silent(now) and now - self._down_at >= params.settling:
            self._step_down(now, None)
        if self._probe_at is not None and now - self._probe_at > params.probe + params.watch:
            self._probe_at, self._calm_since, self._up_at = None, now, now
            self._patience, self._hold = self._hold, params.next_hold
            self.layer = max(0, self.layer - 1)
        if (
            self.layer > 0
            and self._probe_at is None
            and now - self._calm_since > self._hold
            and self._is_quick(now)
        ):
            self._probe_at = now
            self.probes += 1
        probing = self._probe_at is not None and now - self._probe_at <= params.probe
        return self._rates[self.layer - 1] / params.picture_share if probing else 0.0

    def _is_silent(self, now: float) -> bool:
        seconds, frames = self._params.silence
        return bool(self._late) and self._unreported > frames and now - self._late[-1][0] > seconds

    def _remember(self, now: float, delay: float) -> None:
        if self._delays and now - self._delays[-1][0] < 1.0:
            when, least = self._delays.pop()
            delay, now = min(delay, least), when
        self._delays.append((now, delay))
        while now - self._delays[0][0] > self._params.best_delay_for:
            self._delays.popleft()

    def _is_quick(self, now: float) -> bool:
        """Tell whether packets arrive as fast as they can; without reports, it is unknown."""
        if not self._late:
            return False
        at, late = self._late[-1]
        return now - at < self._params.silence[0] and late < self._params.late[0]

    def _step_down(self, now: float, capacity: float | None, *, waits: float = 0.0) -> None:
        params = self._params
        self._calm_since, self._lossy = now, 0
        if self._probe_at is not None:  # only the trial was too much
            self._probe_at = None
            self._hold = min(2.0 * max(self._hold, params.first_hold), params.longest_hold)
            self._down_at = now  # packets are late until the copies have left the queue
            return
        self._hold = params.first_hold
        if now - self._up_at < params.regret:
            self._hold = min(2.0 * max(self._patience, params.first_hold), params.longest_hold)
        most = math.inf if capacity is None else params.picture_share * capacity - params.beside
        lowest = len(self._rates) - 1
        fits = next((n for n, rate in enumerate(self._rates) if rate <= most), lowest)
        self._silent_until = now + min(waits, params.longest_pause)
        self._down_at, self.layer = self._silent_until, min(lowest, max(self.layer + 1, fits))
