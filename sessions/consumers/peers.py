"""The pages of one robot in this process, and what they show of each other."""

from collections import Counter
from typing import Protocol

from django.conf import settings

from robots.bridge.known import KnownRobot
from sessions.consumers.authorization import Authorization
from sessions.leases.policy import PAGE_SEEN_EVERY
from sessions.protocol import RoomState


class Member(Protocol):
    """A page's connection."""

    authorization: Authorization

    def replaced(self) -> None:
        """Another socket of the same page has taken this one's place."""

    def peers_changed(self) -> None:
        """A page joined or left, or has another role."""


class Peers:
    """The pages at one robot. `waiting` is the length of its queue when it was last read, and
    `pause` why it was not ready then (sessions/leases/store.py).
    """

    def __init__(self) -> None:
        self.members: set[Member] = set()
        self.waiting = 0
        self.pause = ""
        self._read_at = float("-inf")
        self._read_after: int | None = None  # the lease whose end it was read after

    @property
    def observers(self) -> int:
        """The number of pages here that watch."""
        return sum(member.authorization.watches for member in self.members)

    def is_to_be_read(self, known: KnownRobot, now: float) -> bool:
        """Tell whether to read queue and robot again, once for all pages here: after each end of a
        lease, and every PAGE_SEEN_EVERY seconds, because pages of other processes join and leave
        and the robot's readiness changes. `now` is monotonic seconds.
        """
        is_over = known.lease_at(now) is None
        is_new = is_over and self._read_after != known.epoch
        if not is_new and now - self._read_at < PAGE_SEEN_EVERY:
            return False
        self._read_at = now
        if is_over:
            self._read_after = known.epoch
        return True

    def describe(self, known: KnownRobot, now: float) -> RoomState:
        """Return who is here; `now` is monotonic seconds.

        The robot counts the viewers of all web processes, this process also those whose video has
        not started. Visitors who watch while they wait count as waiting.
        """
        lease = known.lease_at(now)
        drives = (
            lease is not None and known.state is not None and known.state.session == lease.session
        )
        viewers = max(0, known.state.viewers - drives) if known.state is not None else 0
        return RoomState(
            driver=lease.who if lease is not None else None,
            driving=drives,
            observers=max(0, max(viewers, self.observers) - self._watching_queue(viewers)),
            waiting=self.waiting,
            pause="" if lease is not None else self.pause,
        )

    def _watching_queue(self, viewers: int) -> int:
        """Return how many observers wait for the robot: those here, and at most so many of other
        processes.
        """
        here = [member.authorization for member in self.members]
        waiting = [page for page in here if page.role == "waiting"]
        direct = sum(page.watches and not page.by_sfu for page in here)
        elsewhere = min(max(0, viewers - direct), max(0, self.waiting - len(waiting)))
        return sum(page.watches for page in waiting) + elsewhere

    def has_place(self, known: KnownRobot) -> bool:
        """Tell whether one more page may watch; the robot's last place is kept for its driver."""
        return self.observers < _places(known) - 1

    def has_place_beside_sfu(self, known: KnownRobot, *, operates: bool) -> bool:
        """Tell whether one more page may connect to the robot itself although there is an SFU:
        places are kept for the driver, the SFU, and an operator.
        """
        direct = sum(
            member.authorization.watches and not member.authorization.by_sfu
            for member in self.members
        )
        if operates:
            return direct < _places(known) - 2
        return direct < min(_places(known) - 3, settings.DIRECT_WATCHERS)

    def replace(self, peer: str, by: Member) -> None:
        """Replace the old socket of a page by its new one; the old one may be dead unnoticed."""
        for member in tuple(self.members):
            if member is not by and member.authorization.peer == peer:
                member.replaced()

    def changed(self) -> None:
        """Notify every page here that its peers have changed."""
        for member in tuple(self.members):
            member.peers_changed()


def _places(known: KnownRobot) -> int:
    return known.factsheet.viewers if known.factsheet is not None else 8


_peers: dict[str, Peers] = {}
_refused_before: Counter[str] = Counter()


def peers_of(robot: str) -> Peers:
    """Return the pages at a robot."""
    return _peers.setdefault(robot, Peers())


def part(robot: str, member: Member) -> None:
    """Remove a page; with its last page the robot's entry is dropped."""
    peers = _peers.get(robot)
    if peers is not None:
        if member in peers.members:
            _refused_before.update(member.authorization.refused)
        peers.members.discard(member)
        if not peers.members:
            del _peers[robot]


def counts_by_role() -> Counter[str]:
    """Return the numbers of pages of this process that drive, wait, watch, or do neither
    (`guest`).
    """
    members = [member for peers in _peers.values() for member in peers.members]
    return Counter(
        "observer" if member.authorization.watches else member.authorization.role
        for member in members
    )


def refusals() -> Counter[str]:
    """Return how many frames of drive pages this process has refused, by reason."""
    return sum(
        (member.authorization.refused for peers in _peers.values() for member in peers.members),
        _refused_before.copy(),
    )
