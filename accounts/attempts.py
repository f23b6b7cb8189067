"""Limits on attempts, counted in the cache; with Redis, all processes count together."""

import contextlib
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
    """A sliding window: at most `limit` in any `seconds`.

    A window that restarts every minute would allow twice as many around the full minute. Attempts
    are therefore counted by tenths of the window. The present tenth and the ten before it, which
    contain all of the last `seconds`, count together.
    """

    name: str
    limit: int
    seconds: int = 60

    def count(self, address: str, now: float) -> bool:
        """Count one at `now` (Unix time in seconds) and tell whether it was allowed; a refused one
        does not count.
        """
        newest = self._keys(address, now)[-1]
        cache.add(newest, 0, self.seconds * 2)
        try:
            cache.incr(newest)
            if sum(self._found(address, now)) <= self.limit:
                return True
            # counted first and looked at then: of simultaneous ones, at most `limit` are allowed
            cache.decr(newest)
        except ValueError:  # evicted from the cache between two lines
            return True
        return False

    def take_back(self, address: str, now: float) -> None:
        """Undo `count` of one at `now`."""
        with contextlib.suppress(ValueError):  # evicted from the cache
            cache.decr(self._keys(address, now)[-1])

    def are_left(self, address: str, now: float) -> bool:
        """Tell whether one more would be allowed."""
        return sum(self._found(address, now)) < self.limit

    def wait(self, address: str, now: float) -> int:
        """Return the whole seconds after which one more is allowed; at least 1."""
        found = self._found(address, now)
        expired = next(
            (oldest for oldest in range(len(found)) if sum(found[oldest:]) < self.limit), len(found)
        )
        tenth = self.seconds / SLICES
        return max(1, math.ceil((now // tenth + expired) * tenth - now))

    def _found(self, address: str, now: float) -> list[int]:
        keys = self._keys(address, now)
        there = cache.get_many(keys)
        return [int(there.get(key, 0)) for key in keys]

    def _keys(self, address: str, now: float) -> list[str]:
        """Return the keys of the tenths that count, oldest first."""
        named = quote(address, safe=":/")[:200]  # a proxy may pass on any text
        newest = int(now // (self.seconds / SLICES))
        return [
            f"attempts:{self.name}:{named}:{part}" for part in range(newest - SLICES, newest + 1)
        ]


def address_of(request: HttpRequest) -> str:
    """Return the address that a request is counted by: the last one in X-Forwarded-For that is not
    one of our proxies, if one of our proxies sent it.
    """
    forwarded, sender = (
        str(request.META.get(name, "")) for name in ("HTTP_X_FORWARDED_FOR", "REMOTE_ADDR")
    )
    return counted(visitor_address(forwarded, sender, settings.TRUSTED_PROXIES))
