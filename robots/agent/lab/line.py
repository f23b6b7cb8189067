"""A bad line, as decisions: losses, delays, and the order of the rest.
`now` is any monotonic clock in seconds.

Each packet draws three numbers from the seeded generator, whatever becomes of it, so that one
packet's fate does not shift another's: the same seed and the same arrivals (moments and sizes) end
in the same fates.

- *Loss* and *reordering* are independent from packet to packet.
- *Bitrate* is a queue in front of a transmitter: a packet leaves when all before it have, and takes
  its size to do so. What would wait longer than `QUEUE` seconds for its turn is dropped, as at the
  tail of a router's queue.
- *Delay* comes after that; *jitter* changes it evenly by up to so much either way, never below
  nothing, and never changes the order.
- A *reordered* packet waits until the next one has come out, and at most `HOLD` seconds longer than
  its own time.
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
    """Counts of packets; `held` is the sum of seconds over those that came out."""

    taken: int = 0
    lost: int = 0
    overflowed: int = 0
    reordered: int = 0
    out: int = 0
    held: float = 0.0


@dataclass(frozen=True, order=True)
class _Packet:
    """A packet under way: when it comes out, its order, since when it is held, its delivery."""

    at: float
    place: int
    since: float
    deliver: Deliver


class NetworkLine:
    """One direction of a network. What goes in by `offer` comes out by `due`, or never."""

    def __init__(self, lab: NetworkLab) -> None:
        self.lab = lab
        self.counts = Counts()
        self._rng = random.Random(lab.seed)
        self._under_way: list[_Packet] = []
        self._overtaken: list[_Packet] = []  # each comes out after the next packet that is offered
        self._place = 0
        self._free = float("-inf")
        self._last = float("-inf")

    @property
    def waiting(self) -> int:
        return len(self._under_way) + len(self._overtaken)

    def offer(self, deliver: Deliver, size: int, now: float) -> None:
        """Put a packet of `size` bytes in; calling `deliver` is what it is good for."""
        lost, late, reordered = self._rng.random(), self._rng.random(), self._rng.random()
        self.counts.taken += 1
        if lost < self.lab.loss:
            self.counts.lost += 1
            return
        leaves = self._transmitted(size, now)
        if leaves is None or self.waiting >= MOST_WAITING:
            self.counts.overflowed += 1
            return
        at = max(
            self._last, leaves + max(0.0, self.lab.delay + self.lab.jitter * (2.0 * late - 1.0))
        )
        if reordered < self.lab.reorder:
            self._overtaken.append(self._packet(at + HOLD, now, deliver))
        else:
            self._last = at
            heapq.heappush(self._under_way, self._packet(at, now, deliver))
            self._overtake(at)

    def due(self, now: float) -> list[Deliver]:
        """Take out what has come through by now, in its order."""
        self._give_up_waiting(now)
        found = []
        while self._under_way and self._under_way[0].at <= now:
            packet = heapq.heappop(self._under_way)
            self.counts.out += 1
            self.counts.held += now - packet.since
            found.append(packet.deliver)
        return found

    def next(self) -> float | None:
        """Return when the next packet comes out, None while none is on its way."""
        moments = [packets[0].at for packets in (self._under_way, self._overtaken) if packets]
        return min(moments, default=None)

    # --- inside -----------------------------------------------------------------------------------

    def _transmitted(self, size: int, now: float) -> float | None:
        """Return when a packet's last bit has left, None when the transmitter's queue is full."""
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
        """Release the packets that waited to be overtaken by one that comes out at `at`."""
        for packet in self._overtaken:
            self.counts.reordered += packet.at > at
            heapq.heappush(
                self._under_way, self._packet(min(packet.at, at), packet.since, packet.deliver)
            )
        self._overtaken.clear()

    def _give_up_waiting(self, now: float) -> None:
        while self._overtaken and self._overtaken[0].at <= now:
            heapq.heappush(self._under_way, self._overtaken.pop(0))
