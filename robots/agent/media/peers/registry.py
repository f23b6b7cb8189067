"""Which peers are connected, and in which role: decisions only.

Only the lease makes a peer the driver: a peer that offered as driver and no longer has the lease is
an observer from that moment, and an observer who gets the lease drives without a new connection.

A connection outlives the page's socket, over which the server would end it, so it ends unless it is
confirmed: an earlier driver must offer again to watch, and the server vouches for observers
regularly.
"""

from dataclasses import dataclass

from robots.api.bucket import Bucket
from robots.api.messages import Candidate, Role

STAYS_AFTER_DRIVING = 5.0  # s in which a renewal of the lease that was late has arrived
STAYS_UNVOUCHED = 150.0  # s; the server vouches for a peer every minute
MAX_HELD_PEERS, MAX_HELD_CANDIDATES = 32, 32
MAX_LIMITED_PEERS = 256


@dataclass(frozen=True)
class PeerAdmission:
    """The answer to an offer: whether it is admitted, and the peer that must leave for it."""

    admitted: bool
    leaves: str | None = None


class PeerRegistry:
    """The peers in the order of their offers, their roles, and the driver that the lease names.

    `limit` is how many may be connected at once; at least one, because the driver always finds
    room.
    """

    def __init__(self, limit: int) -> None:
        self._limit = max(1, limit)
        self._offered: dict[str, Role] = {}
        self._driver: str | None = None
        self._vouched: dict[str, float] = {}
        self._drove: dict[str, float] = {}  # until when each peer drove that drives no more

    def admit(self, peer: str, role: Role, now: float) -> PeerAdmission:
        """Decide about an offer of `peer` and store it if it is admitted; an offer of a connected
        peer replaces its old one.

        When all places are taken, an offer of the driver, of a hidden operator, or of the robot's
        own screen replaces the newest observer. A driver replaces a screen when there is no
        observer, and an earlier driver last.
        """
        others = [other for other in self._offered if other != peer]
        leaves = None
        if len(others) >= self._limit:
            leaves = max(
                others, key=lambda other: (_EXPENDABLE[self.role(other)], others.index(other))
            )
            makes_room = (
                role == "driver"
                or peer == self._driver
                or (role in {"screen", "wizard"} and self.role(leaves) in {"screen", "observer"})
            )
            if not makes_room:
                return PeerAdmission(admitted=False)
            self.leave(leaves)
        self._offered.pop(peer, None)
        self._offered[peer] = role
        self._drove.pop(peer, None)
        self._vouched[peer] = now
        return PeerAdmission(admitted=True, leaves=leaves)

    def role(self, peer: str) -> Role:
        """Return what `peer` is now: `driver` for the lease's peer alone."""
        if peer == self._driver:
            return "driver"
        offered = self._offered.get(peer, "observer")
        return "observer" if offered == "driver" else offered

    def lease_changed(self, driver: str | None, now: float) -> None:
        """Note the driver's peer, or None. From any thread."""
        if self._driver is not None and driver != self._driver and self._driver in self._offered:
            # the lease spoke for it until now
            self._drove[self._driver] = self._vouched[self._driver] = now
        if driver is not None:
            self._drove.pop(driver, None)
        self._driver = driver

    def vouch(self, peer: str, now: float) -> None:
        """Note that the server vouches for a peer."""
        if peer in self._offered:
            self._vouched[peer] = now

    def unwelcome(self, now: float) -> dict[str, str]:
        """Return the peers that may not stay, each with the reason."""
        watching = [peer for peer in self._offered if peer != self._driver]
        found = {
            peer: "not_vouched" for peer in watching if now - self._vouched[peer] > STAYS_UNVOUCHED
        }
        return found | {
            peer: "lease_changed"
            for peer in watching
            if now - self._drove.get(peer, now) > STAYS_AFTER_DRIVING
        }

    def leave(self, peer: str) -> None:
        self._offered.pop(peer, None)
        self._vouched.pop(peer, None)
        self._drove.pop(peer, None)


_EXPENDABLE: dict[Role, int] = {"driver": 0, "wizard": 1, "screen": 2, "observer": 3}


class HeldCandidates:
    """Candidates that arrived before their offer; bounded, the oldest peer is dropped first."""

    def __init__(self) -> None:
        self._held: dict[str, list[Candidate]] = {}

    def hold(self, peer: str, candidate: Candidate) -> None:
        held = self._held.setdefault(peer, [])
        if len(held) < MAX_HELD_CANDIDATES:
            held.append(candidate)
        if len(self._held) > MAX_HELD_PEERS:
            del self._held[next(iter(self._held))]

    def release(self, peer: str) -> list[Candidate]:
        return self._held.pop(peer, [])


class OfferLimits:
    """Limits on answered offers, because each costs sockets and processor time: five of one peer
    and one more every two seconds; of all peers together twenty and two a second, except the
    driver's.
    """

    def __init__(self) -> None:
        self._all = Bucket(rate=2.0, burst=20.0)
        self._of: dict[str, Bucket] = {}

    def allow(self, peer: str, now: float, *, drives: bool) -> bool:
        """Return whether an offer may be answered, and count it."""
        own = self._of[peer] = self._of.pop(peer, Bucket(rate=0.5, burst=5.0))
        if len(self._of) > MAX_LIMITED_PEERS:
            del self._of[next(iter(self._of))]
        return own.spend(now) and (drives or self._all.spend(now))
