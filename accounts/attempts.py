"""How often an address may try something in a while; counted in the cache, which several processes
share when it is Redis.
"""

import math
from dataclasses import dataclass
from urllib.parse import quote

from django.conf import settings
from django.core.cache import cache
from django.http import HttpRequest

from accounts.client_address import counted, visitor_address

SLICES = 10  # of a window


@dataclass(frozen=True)
class Attempts:
    """At most `limit` in any `seconds`, whenever they begin.

    A window that begins anew every minute would let twice as many through around the full minute.
    So attempts are counted by tenths of the window, and the present tenth and the ten before it,
    which hold all of the last `seconds`, count together.
    """

    name: str
    limit: int
    seconds: int = 60

    def count(self, address: str, now: float) -> bool:
        """Count one at `now` (Unix time in seconds) and tell whether it was still allowed; what was
        not allowed does not count.
        """
        newest = self._keys(address, now)[-1]
        cache.add(newest, 0, self.seconds * 2)
        try:
            cache.incr(newest)
            if sum(self._found(address, now)) <= self.limit:
                return True
            # after looking: of several that come at once, no more than the limit pass
            cache.decr(newest)
        except ValueError:  # thrown out of the cache between two lines
            return True
        return False

    def take_back(self, address: str, now: float) -> None:
        """Make one that was counted at `now` count no longer."""
        try:
            cache.decr(self._keys(address, now)[-1])
        except ValueError:  # thrown out of the cache
            return

    def are_left(self, address: str, now: float) -> bool:
        """Tell whether one more would be allowed."""
        return sum(self._found(address, now)) < self.limit

    def wait(self, address: str, now: float) -> int:
        """Return the whole seconds after which one more is allowed; at least 1."""
        found = self._found(address, now)
        gone = next(
            (oldest for oldest in range(len(found)) if sum(found[oldest:]) < self.limit), len(found)
        )
        tenth = self.seconds / SLICES
        return max(1, math.ceil((now // tenth + gone) * tenth - now))

    def _found(self, address: str, now: float) -> list[int]:
        keys = self._keys(address, now)
        there = cache.get_many(keys)
        return [int(there.get(key, 0)) for key in keys]

    def _keys(self, address: str, now: float) -> list[str]:
        """Return the keys of the tenths that count, oldest first."""
        named = quote(address, safe=":/")[:200]  # whatever a proxy passes on
        newest = int(now // (self.seconds / SLICES))
        return [
            f"attempts:{self.name}:{named}:{part}" for part in range(newest - SLICES, newest + 1)
        ]


def address_of(request: HttpRequest) -> str:
    """Return for whom a request counts: the last address in X-Forwarded-For that is not a proxy of
    ours, when a proxy of ours says so.
    """
    told = request.META.get("HTTP_X_FORWARDED_FOR", "")
    return counted(
        visitor_address(told, str(request.META.get("REMOTE_ADDR", "")), settings.TRUSTED_PROXIES)
    )
