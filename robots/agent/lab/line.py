"""An emulated bad network: losses, delays and reordering. Pure; `now` is monotonic seconds.

Each packet draws three numbers from the seeded generator whatever its fate, so that one packet's
fate does not shift another's: the same seed and the same arrivals (moments and sizes) have the same
fates.

- *Loss* and *reordering* are independent from packet to packet.
- *Bitrate* is a queue in front of a transmitter, which needs a packet's size to send it. A packet
that would wait longer than `QUEUE` seconds is dropped, as at the tail of a router's queue.
- *Delay* follows; *jitter* changes it evenly by up to so much in both directions, never below zero,
and never changes the order.
- A *reordered* packet waits until the next one has left, at most `HOLD` seconds beyond its time.
"""

import heapq
import random
from collections.abc import Callable
from dataclasses import dataclass

from robots.api.messages import NetworkLab

QUEUE = 0.5  # s of transmission; a home router's is about as deep
HOLD = 0.1  # s
# packets; twice what a camera's best tier has under way in the longest delay of a study
MOST_WAITING = 4096
BITS = 8.0

Deliver = Callable[[], None]


@dataclass
class Counts:
    """Counts of packets; `held` is the sum of seconds of those that were delivered."""

    taken: int = 0
    lost: int = 0
    overflowed: int = 0
    reordered: int = 0
    out: int = 0
    held: float = 0.0


@dataclass(frozen=True, order=True)
class _Packet:
    """A packet in transit: when it is delivered, its order, since when it is held, its delivery."""

    at: float
    place: int
    since: float
    deliver: Deliver


class NetworkLine:
    """One direction of a network: packets enter by `offer` and leave by `due`, or never."""

    def __init__(self, lab: NetworkLab) -> None:
        self.lab = lab
        self.counts = Counts()
        self._rng = random.Random(lab.seed)
        self._in_transit: list[_Packet] = []
        self._overtaken: list[_Packet] = []  # each comes out after the next packet that is offered
        self._place = 0
        self._free = float("-inf")
        self._last = float("-inf")

    @property
    def waiting(self) -> int:
        return len(self._in_transit) + len(self._overtaken)

    def offer(self, deliver: Deliver, size: int, now: float) -> None:
        """Send a packet of `size` bytes, delivered by `deliver`."""
        lost, late, reordered = self._rng.random(), self._rng.random(), self._rng.random()
        self.counts.taken += 1
        if lost < self.lab.loss:
            self.counts.lost += 1
            return
        leaves = self._transmitted(size, now)
        if leaves is None or self.waiting >= MOST_WAITING:
            self.counts.overflowed += 1
            return
        delay = self.lab.delay + self.lab.jitter * (2.0 * late - 1.0)
        at = max(self._last, leaves + max(0.0, delay))
        if reordered < self.lab.reorder:
            self._overtaken.append(self._packet(at + HOLD, now, deliver))
        else:
            self._last = at
            heapq.heappush(self._in_transit, self._packet(at, now, deliver))
            self._overtake(at)

    def due(self, now: float) -> list[Deliver]:
        """Remove and return the deliveries that are due, in order."""
        self._give_up_waiting(now)
        found = []
        while self._in_transit and self._in_transit[0].at <= now:
            packet = heapq.heappop(self._in_transit)
            self.counts.out += 1
            self.counts.held += now - packet.since
            found.append(packet.deliver)
        return found

    def next(self) -> float | None:
        """Return when the next packet is due, None without packets in transit."""
        moments = [packets[0].at for packets in (self._in_transit, self._overtaken) if packets]
        return min(moments, default=None)

    # --- inside -----------------------------------------------------------------------------------

    def _transmitted(self, size: int, now: float) -> float | None:
        """Return when a packet's last bit has left, None when the queue is full."""
        if self.lab.bitrate is None:
            return now
        begins = max(now, self._free)
        if begins - now > QUEUE:
            return None
        self._free = begins + size * BITS / self.lab.bitrate
        return self._free

    def _packet(self, at: float, since: float, deliver: Deliver) -> _Packet:
        self._place += 1
        return _Packet(at, self._place, since, deliver)

    def _overtake(self, at: float) -> None:
        """Release the packets that waited for the one that is delivered at `at`."""
        for packet in self._overtaken:
            self.counts.reordered += packet.at > at
            moved = self._packet(min(packet.at, at), packet.since, packet.deliver)
            heapq.heappush(self._in_transit, moved)
        self._overtaken.clear()

    def _give_up_waiting(self, now: float) -> None:
        while self._overtaken and self._overtaken[0].at <= now:
            heapq.heappush(self._in_transit, self._overtaken.pop(0))
