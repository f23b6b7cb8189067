"""The STUN and TURN servers that a page and a robot use for one connection.

TURN credentials are made for one person and a limited time, from a secret that the TURN server
shares (coturn's `use-auth-secret`; draft-uberti-behave-turn-rest-00): the user name is
"<expiry>:<name>", the password its HMAC-SHA1 in base64.
"""

import base64
import hashlib
import hmac
import math
import time
from collections.abc import Sequence

from django.conf import settings

from robots.api.messages import IceServer

# longer than any session: a TURN allocation is renewed with the same credentials
LIFETIME_SECONDS = 6 * 3600
MAX_URLS = 8


def ice_servers(name: str, now: float) -> tuple[IceServer, ...]:
    """Return the servers for `name` (a visitor's id or a robot's name) at `now`, Unix time in
    seconds. The relays of a region are one entry: page and robot each measure which region is
    nearest, and use its relays.
    """
    servers: list[IceServer] = []
    if settings.STUN_URLS:
        servers.append(IceServer(urls=tuple(settings.STUN_URLS[:MAX_URLS])))
    if settings.TURN_URLS and settings.TURN_SECRET:
        username, credential = turn_credentials(name, settings.TURN_SECRET, now)
        servers += [
            IceServer(urls=tuple(urls[:MAX_URLS]), username=username, credential=credential)
            for urls in relays_by_region(settings.TURN_URLS).values()
        ]
    return tuple(servers)


class IceCredentials:
    """The servers for one name, for connections that begin at any time: the credentials are renewed
    after half of their lifetime.
    """

    def __init__(self, name: str) -> None:
        self._name = name
        self._servers: tuple[IceServer, ...] = ()
        self._made_at = -math.inf  # Unix seconds

    def __call__(self) -> tuple[IceServer, ...]:
        now = time.time()
        if not 0.0 <= now - self._made_at < LIFETIME_SECONDS / 2:
            self._servers, self._made_at = ice_servers(self._name, now), now
        return self._servers


def relays_by_region(words: Sequence[str]) -> dict[str, list[str]]:
    """Return the addresses of relays by region: `eu=turn:relay.example.org` is in the region `eu`;
    those without a name form one region.
    """
    regions: dict[str, list[str]] = {}
    for word in words:
        name, named, url = word.partition("=")
        if not named or ":" in name:  # after a scheme, "=" is part of the address
            name, url = "", word
        regions.setdefault(name.strip(), []).append(url.strip())
    return regions


def turn_credentials(name: str, secret: str, now: float) -> tuple[str, str]:
    """Return (user name, password), valid for `LIFETIME_SECONDS` from `now`."""
    username = f"{int(now) + LIFETIME_SECONDS}:{name}"
    # The protocol requires SHA-1, which is still secure in an HMAC.
    digest = hmac.new(secret.encode(), username.encode(), hashlib.sha1).digest()
    return username, base64.b64encode(digest).decode()
