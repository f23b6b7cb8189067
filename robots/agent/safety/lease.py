"""Who may drive, as far as this robot knows: one lease, counted from its receipt by monotonic time.

Copies overtake each other: a server that reconnects repeats what it last knew, a broker delivers
what it has stored. So only a newer renewal of the same grant, or a higher epoch, changes anything;
and a stored copy (`retained`) tells who is about to drive but never lets anybody. One thing needs
no newer renewal: to lower a limit. That holds from its receipt on, and prolongs nothing.
"""

from dataclasses import dataclass

import msgspec

from robots.api.messages import Lease, LeaseLimits


@dataclass(frozen=True)
class Remembered:
    """The newest grant this robot has seen; what survives a restart of the agent, so that an older
    one cannot come back.
    """

    session: str
    epoch: int
    renewal: int
    stamp: float


class LeaseKeeper:
    """The lease in force, the one announced, and the newest ever seen. `now` is monotonic time in
    seconds.
    """

    def __init__(self, newest: Remembered | None = None) -> None:
        self.newest = newest
        self._lease: Lease | None = None
        self._received = 0.0
        self._permits = False

    def take(self, lease: Lease, *, retained: bool, now: float) -> bool:
        """Take a lease from the server; return False when it is older than what is known, and
        changes nothing.
        """
        if not self._is_news(lease, retained=retained, now=now):
            return not retained and self._lowers(lease)
        repeats_live_grant = retained and self._same_grant(lease) and self.live(now) is not None
        if not repeats_live_grant:
            self._lease, self._received, self._permits = lease, now, not retained
        self.newest = Remembered(lease.session, lease.epoch, lease.renewal, lease.stamp)
        return True

    def clear(self) -> None:
        """Nobody drives: the server has emptied the lease."""
        self._lease, self._permits = None, False

    def live(self, now: float) -> Lease | None:
        """Return the lease that permits driving now, or None."""
        return self._lease if self._permits and self.announced(now) else None

    def announced(self, now: float) -> Lease | None:
        """Return the lease whose session the robot's states belong to: the live one, or one known
        from a stored copy.
        """
        return self._lease if self._lease and now - self._received < self._lease.ttl else None

    def lapse(self, now: float) -> Lease | None:
        """Forget a lease whose time is over, and return it: once."""
        if self._lease is None or self.announced(now) is not None:
            return None
        lapsed = self._lease
        self.clear()
        return lapsed

    def _lowers(self, lease: Lease) -> bool:
        """Take over the limits of a repetition of the lease where they are stricter; return whether
        any was.
        """
        held = self._lease
        if held is None or not self._same_grant(lease) or lease.renewal != held.renewal:
            return False
        strictest = stricter_of(held.limits, lease.limits)
        changed = strictest != held.limits
        self._lease = msgspec.structs.replace(held, limits=strictest)
        return changed

    def _same_grant(self, lease: Lease) -> bool:
        return self._lease is not None and (self._lease.session, self._lease.epoch) == (
            lease.session,
            lease.epoch,
        )

    def _is_news(self, lease: Lease, *, retained: bool, now: float) -> bool:
        newest = self.newest
        if newest is None or lease.epoch > newest.epoch:
            return True
        if (lease.session, lease.epoch) == (newest.session, newest.epoch):
            # A stored copy of what lapsed, or of what a restarted agent remembers, tells the
            # session again but permits nothing.
            return lease.renewal > newest.renewal or (
                retained and lease.renewal == newest.renewal and self.live(now) is None
            )
        # A lower epoch: late, unless the server's counter began anew, which its own clock then
        # shows.
        return self.live(now) is None and lease.stamp > newest.stamp


def stricter_of(one: LeaseLimits, other: LeaseLimits) -> LeaseLimits:
    """Return the smaller of each limit; None is no limit."""
    smaller = {}
    for name in LeaseLimits.__struct_fields__:
        stated = [
            limit for limit in (getattr(one, name), getattr(other, name)) if limit is not None
        ]
        smaller[name] = min(stated, default=None)
    return LeaseLimits(**smaller)
