"""Which layer of quality one viewer gets: lower at once when the network takes less, up by trial.

Pure. The measure is the age of the frame on the screen, which the page reports five times a second,
and ten times while it grows: when more is sent than arrives, frames wait before the bottleneck.
Browsers' own estimates (REMB) would show it too, but Chromium sends none on a connection on which
it may send video as well.

To try a higher layer, copies of sent packets are added for a moment, to see whether frames become
older. That costs no frame, whereas a trial of the layer itself starts with a large key frame.
"""

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class BitrateParams:
    """The conditions for changing a viewer's layer.

    Lateness is (s older than at its best, reports in a row).
    """

    # a busy computer also delays single pictures, and at 15 a second the one on the screen is up to
    # 0.07 s old anyway
    late: tuple[float, int] = (0.15, 3)
    very_late: tuple[float, int] = (0.3, 2)
    late_in_trial: tuple[float, int] = (0.1, 2)
    best_age_for: float = 60.0  # s for which the best age counts
    picture_share: float = 0.8  # of the network's rate; sound and messages need the rest
    lossy: float = 0.1  # share of the packets lost, in two reports in a row
    very_lossy: float = 0.3  # the same, in one report
    same: float = 0.02  # s between the times of two pictures that are the same
    unseen: float = 1.0  # s of the same frame, after which the page counts as hidden
    steady: float = 0.8  # share of the sent data that arrives, above which no queue grows
    full_queue: float = 0.5  # share that is assumed to arrive through a full queue
    settling: float = 1.0  # s after a step down in which nothing new is learned
    drained: float = 3.0  # s, the same while the age falls
    # s without a picture, so that the queue can drain; after 1 s the robot would stop
    longest_pause: float = 0.5
    first_hold: float = 1.5  # s without lateness before a trial; doubled by each that fails
    longest_hold: float = 6.0  # s, the same at most
    next_hold: float = 0.3  # s, after a successful trial
    probe: float = 0.35  # s of sending more
    watch: float = 0.65  # s after it in which pictures may still become older
    regret: float = 4.0  # s in which a step up still counts as a trial


BITRATE = BitrateParams()


class BitrateAdapter:
    """One viewer's layer, at first the best; `rates` are in bit/s, times monotonic seconds."""

    def __init__(self, rates: Sequence[int], now: float, params: BitrateParams = BITRATE) -> None:
        self._params = params
        self.layer = 0
        self.probes = 0
        self._rates = tuple(rates)
        self._ages: deque[tuple[float, float]] = deque()  # the least of each second, at most
        # when reported, and how much older than at its best
        self._late: deque[tuple[float, float]] = deque(maxlen=3)
        # when reported, and when the picture on the screen was captured
        self._shown: deque[tuple[float, float]] = deque(maxlen=3)
        # when the picture on the screen was first reported, and when it was captured
        self._taken: tuple[float, float] | None = None
        self._lossy = 0
        self._calm_since = self._down_at = now
        self._up_at = float("-inf")
        self._hold = self._patience = self._params.first_hold
        self._probe_at: float | None = None
        self._silent_until = float("-inf")

    def pauses(self, now: float) -> bool:
        """Tell whether to send no picture, because too many are queued in the network."""
        return now < self._silent_until

    def aged(self, now: float, age: float, sent: float) -> None:
        """Take the age of the frame on the screen (s), and what the viewer is sent (bit/s)."""
        params = self._params
        taken = now - age
        if self._taken is None or taken - self._taken[1] > params.same:
            self._taken = now, taken
        elif now - self._taken[0] > params.unseen:
            self._late.clear()
            # no trial on a page that shows no new frame
            self._calm_since, self._probe_at = now, None
            return
        self._remember(now, age)
        self._late.append((now, age - min(age for _, age in self._ages)))
        self._shown.append((now, taken))
        falls = len(self._late) > 1 and self._late[-1][1] < self._late[-2][1]
        settles = now - self._down_at < params.settling or (
            falls and now - self._down_at < params.drained
        )
        signs = (
            (params.late, params.very_late) if self._probe_at is None else (params.late_in_trial,)
        )
        if not settles and any(self._is_late(limit, often) for limit, often in signs):
            self._step_down(now, self._share() * sent, waits=self._late[-1][1])

    def _share(self) -> float:
        """Return the share of the sent data that arrives: while a queue grows, a second on the
        screen takes longer than one before the camera. Half for a full queue, which hides it.
        """
        params = self._params
        (then, first), *_, (now, last) = self._shown
        share = (last - first) / max(0.1, now - then)
        if last - first > params.same and share < params.steady:
            return share
        return params.full_queue if self._late[-1][1] > params.very_late[0] else 1.0

    def _is_late(self, limit: float, often: int) -> bool:
        return len(self._late) >= often and all(
            late > limit for _, late in list(self._late)[-often:]
        )

    def lost(self, now: float, share: float) -> None:
        params = self._params
        self._lossy = 0 if share < params.lossy else self._lossy + 1
        if (
            share >= params.very_lossy or self._lossy > 1
        ) and now - self._down_at >= params.settling:
            self._step_down(now, None)

    def look(self, now: float) -> float:
        """Let time pass; return bit/s to reach by sending packets again, 0 without a trial."""
        params = self._params
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

    def _remember(self, now: float, age: float) -> None:
        if self._ages and now - self._ages[-1][0] < 1.0:
            when, least = self._ages.pop()
            age, now = min(age, least), when
        self._ages.append((now, age))
        while now - self._ages[0][0] > self._params.best_age_for:
            self._ages.popleft()

    def _is_quick(self, now: float) -> bool:
        """Tell whether frames arrive as fast as they can; without any ages, it is assumed."""
        params = self._params
        if not self._late:
            return self._taken is None
        return now - self._late[-1][0] < params.unseen and self._late[-1][1] < params.late[0]

    def _step_down(self, now: float, capacity: float | None, *, waits: float = 0.0) -> None:
        params = self._params
        self._calm_since, self._lossy = now, 0
        if self._probe_at is not None:  # only the trial was too much
            self._probe_at = None
            self._hold = min(2.0 * max(self._hold, params.first_hold), params.longest_hold)
            self._down_at = now  # pictures are late until the copies have left the queue
            return
        self._hold = params.first_hold
        if now - self._up_at < params.regret:
            self._hold = min(2.0 * max(self._patience, params.first_hold), params.longest_hold)
        most = math.inf if capacity is None else params.picture_share * capacity
        lowest = len(self._rates) - 1
        fits = next((n for n, rate in enumerate(self._rates) if rate <= most), lowest)
        self._silent_until = now + min(waits, params.longest_pause)
        self._down_at, self.layer = self._silent_until, min(lowest, max(self.layer + 1, fits))
