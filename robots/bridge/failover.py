"""The node of the broker to connect to, and the wait before.

The nodes of a cluster have one address each, and all are equivalent. A client stays at its node
while that answers, and tries the next one when the connection is lost or refused. Every node is
tried once before the waits become longer.
"""

import random
from collections.abc import Callable

import aiomqtt

from robots.bridge.broker_address import BrokerAddress, backoff, client, parse

# A node that stops answering is noticed after 1.5 to 2 of these. A single node has the longer one:
# an earlier notice would be of no use, and a slow moment would end the connection.
KEEPALIVE_SECONDS, KEEPALIVE_OF_NODES_SECONDS = 5, 2


def parse_nodes(urls: str) -> tuple[BrokerAddress, ...]:
    """Return the addresses in a comma-separated text, in its order.

    Raises:
        BadAddress: one of them cannot be used, or there is none.
    """
    return tuple(parse(url.strip()) for url in urls.split(","))


class Failover:
    """The nodes of one client.

    Args:
        nodes: at least one; the first is tried first.
        rng: spreads the attempts of clients.
    """

    def __init__(self, nodes: tuple[BrokerAddress, ...], rng: random.Random) -> None:
        self._nodes, self._rng = nodes, rng
        self._index = 0
        self.attempt = 0  # how many have failed since the last connection

    @property
    def node(self) -> BrokerAddress:
        return self._nodes[self._index]

    @property
    def has_nodes(self) -> bool:
        return len(self._nodes) > 1

    @property
    def keepalive_seconds(self) -> int:
        return KEEPALIVE_OF_NODES_SECONDS if self.has_nodes else KEEPALIVE_SECONDS

    def client(
        self,
        credentials: tuple[str, str],
        identifier: str,
        receive: Callable[[aiomqtt.Message], None] | None = None,
        *,
        clean_session: bool = True,
    ) -> aiomqtt.Client:
        """Return a client for the present node; see robots/bridge/broker_address.py."""
        return client(
            self.node,
            credentials,
            identifier,
            receive,
            keepalive_seconds=self.keepalive_seconds,
            clean_session=clean_session,
        )

    def ended(self, *, was_up: bool) -> float:
        """Move to the next node after a connection (`was_up`) or attempt; return the wait in s."""
        self.attempt = 0 if was_up else self.attempt + 1
        self._index = (self._index + 1) % len(self._nodes)
        return backoff(self.attempt // len(self._nodes), self._rng.random())
