"""How often an address may try something in a while; counted in the cache, which several processes share when it is Redis."""

from dataclasses import dataclass

from django.conf import settings
from django.core.cache import cache
from django.http import HttpRequest

from accounts.client_address import counted, visitor_address


@dataclass(frozen=True)
class Attempts:
    """At most `limit` a window of `seconds`."""

    name: str
    limit: int
    seconds: int = 60

    def count(self, address: str, now: float) -> bool:
        """Count one at `now` (Unix time in seconds) and tell whether it was still allowed."""
        key = self._key(address, now)
        cache.add(key, 0, self.seconds * 2)
        try:
            return cache.incr(key) <= self.limit
        except ValueError:  # thrown out of the cache between the two lines
            return True

    def are_left(self, address: str, now: float) -> bool:
        """Tell whether one more would be allowed."""
        return int(cache.get(self._key(address, now), 0)) < self.limit

    def _key(self, address: str, now: float) -> str:
        return f"attempts:{self.name}:{address}:{int(now // self.seconds)}"


def address_of(request: HttpRequest) -> str:
    """Return for whom a request counts: the last address in X-Forwarded-For that is not a proxy of ours, when a proxy of ours says so."""
    told = request.META.get("HTTP_X_FORWARDED_FOR", "")
    return counted(visitor_address(told, str(request.META.get("REMOTE_ADDR", "")), settings.TRUSTED_PROXIES))
