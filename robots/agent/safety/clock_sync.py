"""Offsets of the peers' clocks, from heartbeats and their echoes.

Uses the four stamps of the Network Time Protocol (Mills, RFC 5905, section 8): we sent a beat, the
peer received it, the peer sent one that echoes it, we received that. Half of the round trip without
the peer's pause is taken as the delay, so the offset's error is at most half the round trip; of the
last ten samples the one with the shortest round trip counts.

Our stamps are monotonic time, so that a step of this computer's clock changes no command's age.
"""

from collections import OrderedDict, deque
from collections.abc import Collection
from dataclasses import dataclass, field

from robots.api.messages import CommandHeartbeat, Echo, Heartbeat, Way


@dataclass(frozen=True)
class ClockParams:
    samples: int = 10  # of which the one with the least round trip counts
    known_after: int = 3  # samples
    longest_round_trip: float = 10.0  # s: an echo that took longer tells nothing
    stamp_noise: float = 0.001  # s by which rounded stamps may contradict each other
    peers_kept: int = 128  # the most recent, besides those that are always kept
    beats_kept: int = 64  # of ours, whose echoes may still come
    echoes_sent: int = 16  # in one heartbeat: as many as the message has room for
    echo_within: float = 5.0  # s since the last beat of a peer


CLOCK = ClockParams()
SERVER_PEER = "server"


@dataclass
class PeerClock:
    """The clock of one peer. A sample is (round trip, offset) in seconds; the offset is its Unix
    time minus our monotonic time.
    """

    samples: deque[tuple[float, float]] = field(default_factory=lambda: deque(maxlen=CLOCK.samples))

    def add(self, *, sent: float, peer_received: float, peer_sent: float, received: float) -> bool:
        """Take the four stamps of one echo, in seconds; return False when they contradict each
        other.
        """
        pause = peer_sent - peer_received
        round_trip = (received - sent) - pause
        if pause < 0.0 or not -CLOCK.stamp_noise <= round_trip <= CLOCK.longest_round_trip:
            return False
        self.samples.append(
            (max(0.0, round_trip), ((peer_received - sent) + (peer_sent - received)) / 2)
        )
        return True

    @property
    def known(self) -> bool:
        """Tell whether there are enough samples to judge ages."""
        return len(self.samples) >= CLOCK.known_after

    @property
    def round_trip(self) -> float:
        """The shortest round trip of the samples, in seconds: twice the largest error of the
        offset.
        """
        return min(self.samples)[0] if self.samples else CLOCK.longest_round_trip

    def age(self, stamp: float, now: float) -> float:
        """Return the seconds from `stamp` (the peer's Unix time) to `now` (monotonic); needs a
        sample.
        """
        return now - (stamp - min(self.samples)[1])


@dataclass
class _Peer:
    """One peer's clock, and its last beat on each transport: (n, its stamp, our Unix time).

    `delays` are the last differences between our monotonic time and its stamps: its offset plus the
    time that a beat takes. `echoed_in` is the number of our last beat with an echo of it.
    """

    last_beat_at: float
    delays: deque[float] = field(default_factory=lambda: deque(maxlen=CLOCK.samples))
    clock: PeerClock = field(default_factory=PeerClock)
    beats: dict[Way, tuple[int, float, float]] = field(default_factory=dict)
    echoed_in: int = 0


class PeerClocks:
    """The clocks of all peers, and our own beats.

    The server and the pages of a live lease always have a clock, however many others beat: each of
    our beats echoes them, and they are never evicted. The others share the remaining room in turn.
    """

    def __init__(self) -> None:
        self._peers: OrderedDict[str, _Peer] = OrderedDict()  # the most recent is the last
        self._first: frozenset[str] = frozenset({SERVER_PEER})
        self._sent: OrderedDict[int, float] = OrderedDict()
        self._n = 0

    def beat(self, now: float, unix: float, *, first: Collection[str] = ()) -> Heartbeat:
        """Return the next heartbeat of this robot, with an echo for each transport of a peer.

        `now` is monotonic, `unix` this computer's Unix time; `first` are the peers of the lease,
        echoed first and kept until the next call.
        """
        self._first = frozenset({SERVER_PEER, *first})
        self._n += 1
        self._sent[self._n] = now
        while len(self._sent) > CLOCK.beats_kept:
            self._sent.popitem(last=False)
        return Heartbeat(n=self._n, stamp=unix, echoes=self._echoes(now))

    def on_heartbeat(
        self, peer: str, transport: Way, beat: CommandHeartbeat, *, now: float, unix: float
    ) -> None:
        """Take a peer's heartbeat that arrived at `now` (monotonic), `unix` by our clock."""
        entry = self._peers.pop(peer, None) or _Peer(now)
        self._peers[peer] = entry
        self._evict()
        entry.last_beat_at, entry.beats[transport] = now, (beat.n, beat.stamp, unix)
        entry.delays.append(now - beat.stamp)
        # Our own record of when beat n left is what counts, not the stamp that the peer says it
        # had.
        if beat.echo is not None and (sent := self._sent.get(beat.echo.n)) is not None:
            entry.clock.add(
                sent=sent, peer_received=beat.echo.received, peer_sent=beat.stamp, received=now
            )

    def of(self, peer: str) -> PeerClock | None:
        """Return the clock of a peer once it is known, else None."""
        entry = self._peers.get(peer)
        return entry.clock if entry and entry.clock.known else None

    def rough_age(self, peer: str, stamp: float, now: float) -> float | None:
        """Return a stamp's age in seconds even if the peer never echoed us, too young by the time
        of its fastest beat: good enough for limits of seconds. None for an unknown peer.
        """
        entry = self._peers.get(peer)
        if entry is None:
            return None
        return entry.clock.age(stamp, now) if entry.clock.known else now - stamp - min(entry.delays)

    def _evict(self) -> None:
        while len(self._peers) > CLOCK.peers_kept + len(self._first):
            del self._peers[next(name for name in self._peers if name not in self._first)]

    def _echoes(self, now: float) -> tuple[Echo, ...]:
        """Return echoes of the lease's peers first, then of those that have waited longest."""
        lately = [
            (name, peer)
            for name, peer in self._peers.items()
            if now - peer.last_beat_at <= CLOCK.echo_within
        ]
        lately.sort(key=lambda entry: (entry[0] not in self._first, entry[1].echoed_in))
        echoes: list[Echo] = []
        for name, peer in lately:
            if len(echoes) + len(peer.beats) <= CLOCK.echoes_sent:
                peer.echoed_in = self._n
                echoes += (
                    Echo(peer=name, n=n, stamp=stamp, received=received)
                    for n, stamp, received in peer.beats.values()
                )
        return tuple(echoes)
