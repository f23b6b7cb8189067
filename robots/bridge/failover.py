"""Which node of the broker to connect to, and how long to wait before: pure.

A broker of several nodes is one address each, all of them good. A client has one connection at a
time: it keeps to its node while that answers, and goes on to the next when it is lost or does not
let it in. Every node is tried once before the waits become longer.
"""

import random

from robots.bridge.broker_address import BrokerAddress, backoff, parse

# A node that stops answering is noticed after one and a half to two of these. Where there is no
# other node, finding out sooner helps nobody, and a slow moment would end the connection.
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
        rng: spreads the attempts of many clients.
    """

    def __init__(self, nodes: tuple[BrokerAddress, ...], rng: random.Random) -> None:
        self._nodes, self._rng = nodes, rng
        self._index = 0
        self.attempt = 0  # how many have failed since the last connection

    @property
    def node(self) -> BrokerAddress:
        """Where to connect to now."""
        return self._nodes[self._index]

    @property
    def has_nodes(self) -> bool:
        """Tell whether there is more than one."""
        return len(self._nodes) > 1

    @property
    def keepalive_seconds(self) -> int:
        """Return how often the node must show that it answers."""
        return KEEPALIVE_OF_NODES_SECONDS if self.has_nodes else KEEPALIVE_SECONDS

    def qos(self, wanted: int) -> int:
        """Return the QoS to subscribe with to what may be lost with a connection.

        A cluster makes a replicated queue of each subscription at QoS 1, for which page and robot
        would wait; over one TCP connection QoS 1 adds nothing but acknowledgements.
        """
        return 0 if self.has_nodes else wanted

    def ended(self, *, was_up: bool) -> float:
        """Go on to the next node after a connection (`was_up`) or an attempt; returns the seconds
        to wait before.
        """
        self.attempt = 0 if was_up else self.attempt + 1
        self._index = (self._index + 1) % len(self._nodes)
        return backoff(self.attempt // len(self._nodes), self._rng.random())
