"""The lease that names the driver, counted from its receipt by monotonic time.

Copies overtake each other: a reconnecting server repeats its last one, and a broker delivers a
stored one. So only a newer renewal of the same grant, or a higher epoch, changes the lease, and a
stored copy (`retained`) announces the driver but permits nothing. Only lower limits need no newer
renewal: they apply from their receipt on, and prolong nothing.
"""

from dataclasses import dataclass

import msgspec

from robots.api.messages import Lease, LeaseLimits


@dataclass(frozen=True)
class Remembered:
    """The newest grant seen, stored so that an older one cannot return after a restart."""

    session: str
    epoch: int
    renewal: int
    stamp: float


class LeaseKeeper:
    """The current lease and the newest ever seen. `now` is monotonic time in seconds."""

    def __init__(self, newest: Remembered | None = None) -> None:
        self.newest = newest
        self._lease: Lease | None = None
        self._received = 0.0
        self._permits = False

    def take(self, lease: Lease, *, retained: bool, now: float) -> bool:
        """Take a lease of the server; return False when it is old and changes nothing."""
        if not self._is_news(lease, retained=retained, now=now):
            return not retained and self._lowers(lease)
        repeats_live_grant = retained and self._same_grant(lease) and self.live(now) is not None
        if not repeats_live_grant:
            self._lease, self._received, self._permits = lease, now, not retained
        self.newest = Remembered(lease.session, lease.epoch, lease.renewal, lease.stamp)
        return True

    def clear(self) -> None:
        """Take that the server has withdrawn the lease."""
        self._lease, self._permits = None, False

    def live(self, now: float) -> Lease | None:
        """Return the lease that permits driving now, or None."""
        return self._lease if self._permits and self.announced(now) else None

    def announced(self, now: float) -> Lease | None:
        """Return the lease to whose session states belong: the live one, or a stored copy's."""
        return self._lease if self._lease and now - self._received < self._lease.ttl else None

    def lapse(self, now: float) -> Lease | None:
        """Remove an expired lease and return it, once."""
        if self._lease is None or self.announced(now) is not None:
            return None
        lapsed = self._lease
        self.clear()
        return lapsed

    def _lowers(self, lease: Lease) -> bool:
        """Apply stricter limits in a repetition of the lease; return whether there were any."""
        held = self._lease
        if held is None or not self._same_grant(lease) or lease.renewal != held.renewal:
            return False
        strictest = stricter_of(held.limits, lease.limits)
        changed = strictest != held.limits
        self._lease = msgspec.structs.replace(held, limits=strictest)
        return changed

    def _same_grant(self, lease: Lease) -> bool:
        held = self._lease
        return held is not None and (held.session, held.epoch) == (lease.session, lease.epoch)

    def _is_news(self, lease: Lease, *, retained: bool, now: float) -> bool:
        newest = self.newest
        if newest is None or lease.epoch > newest.epoch:
            return True
        if (lease.session, lease.epoch) == (newest.session, newest.epoch):
            # a stored copy of a lapsed or remembered grant announces the session again
            return lease.renewal > newest.renewal or (
                retained and lease.renewal == newest.renewal and self.live(now) is None
            )
        # a lower epoch is late, unless the server's counter restarted, which its clock shows
        return self.live(now) is None and lease.stamp > newest.stamp


def stricter_of(one: LeaseLimits, other: LeaseLimits) -> LeaseLimits:
    """Return the smaller of each limit; None is no limit."""
    smaller = {}
    for name in LeaseLimits.__struct_fields__:
        limits = (getattr(one, name), getattr(other, name))
        smaller[name] = min((limit for limit in limits if limit is not None), default=None)
    return LeaseLimits(**smaller)
