"""Who has a place at the broker: strangers, which have not shown a right password yet, and the
connections of each user. Pure.

Strangers have places of their own, which signed-in clients never take, and when those are full
somebody goes for each that comes: of the address (IPv4, or /64 of IPv6) with the most strangers,
there of the single address with the most, the one that has been there longest. So a crowd displaces
itself, its neighbours behind other addresses keep their places, and a neighbour behind the same
address has as long as it takes until all places have changed hands; that is more than a client
needs, which sends its CONNECT as soon as it can. Nobody is turned away at the door.
"""

from collections.abc import Hashable
from typing import Generic, TypeVar

from accounts.client_address import counted
from robots.broker.permissions import BrokerUser
from robots.broker.token_bucket import TokenBucket

Who = TypeVar("Who", bound=Hashable)

MAX_STRANGERS = 200
MAX_CONNECTIONS = 2_000  # of users
# packets: a connection takes a look at its password, a session, and perhaps a will
CONNECT_COST = 10.0


class Usage(Generic[Who]):
    """What one user takes of the broker."""

    def __init__(self, user: BrokerUser, now: float) -> None:
        allowance = user.permissions.allowance
        self.bucket = TokenBucket(allowance.packets_per_s, allowance.packets_per_s, now)
        self.connections: dict[Who, None] = {}  # the oldest first
        self.most = allowance.connections


class Admission(Generic[Who]):
    """Keeps count of who is there. Whoever it returns has lost the place and must be sent away."""

    def __init__(self) -> None:
        # by household and address, the oldest first
        self._strangers: dict[str, dict[str, dict[Who, None]]] = {}
        self._places: dict[Who, tuple[str, str]] = {}
        self._usages: dict[str, Usage[Who]] = {}
        self._users: dict[Who, str] = {}

    @property
    def strangers(self) -> int:
        """How many strangers there are."""
        return len(self._places)

    def arrive(self, who: Who, address: str) -> Who | None:
        """Give a stranger a place, and return whose it was."""
        displaced = self._oldest_of_the_many() if self.strangers >= MAX_STRANGERS else None
        if displaced is not None:
            self.leave(displaced)
        network_prefix = counted(address)
        self._places[who] = network_prefix, address
        self._strangers.setdefault(network_prefix, {}).setdefault(address, {})[who] = None
        return displaced

    def progress(self, who: Who) -> None:
        """A stranger has sent its CONNECT: from here on the broker is at work, and idle ones go
        first.
        """
        network_prefix, address = self._places[who]
        same = self._strangers[network_prefix][address]
        del same[who]
        same[who] = None

    def sign_in(self, who: Who, user: BrokerUser, now: float) -> tuple[bool, Who | None]:
        """Make a stranger a user's connection: (whether there is room, which older one of the same
        user goes for it).
        """
        usage = self.usage(user, now)
        is_many = len(usage.connections) >= usage.most
        if (not is_many and len(self._users) >= MAX_CONNECTIONS) or usage.bucket.wait(now):
            return False, None
        usage.bucket.take(CONNECT_COST, now)
        displaced = next(iter(usage.connections)) if is_many else None
        for gone in (displaced, who):
            if gone is not None:
                self.leave(gone)
        usage.connections[who] = None
        self._users[who] = user.name
        return True, displaced

    def usage(self, user: BrokerUser, now: float) -> Usage[Who]:
        """Return what a user takes; it is kept while the user exists, so that who comes back has no
        more than before.
        """
        if user.name not in self._usages:
            self._usages[user.name] = Usage(user, now)
        return self._usages[user.name]

    def leave(self, who: Who) -> None:
        """Free a place, if there is one."""
        if who in self._places:
            network_prefix, address = self._places.pop(who)
            addresses = self._strangers[network_prefix]
            del addresses[address][who]
            if not addresses[address]:
                del addresses[address]
            if not addresses:
                del self._strangers[network_prefix]
        user = self._users.pop(who, None)
        if user in self._usages:
            self._usages[user].connections.pop(who, None)

    def forget_users(self, but: dict[str, BrokerUser]) -> None:
        """Forget what users took that exist no more."""
        self._usages = {name: usage for name, usage in self._usages.items() if name in but}

    def _oldest_of_the_many(self) -> Who:
        network_prefix = max(
            self._strangers.values(), key=lambda addresses: sum(map(len, addresses.values()))
        )
        return next(iter(max(network_prefix.values(), key=len)))
