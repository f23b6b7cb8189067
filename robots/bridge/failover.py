"""The node of the broker to connect to, and the wait before.

The nodes of a cluster have one address each, and all are equivalent. A client stays at its node
while that answers, and tries the next one when the connection is lost or refused. Every node is
tried once before the waits become longer.
"""

import functools
import random
import socket
import ssl
from collections.abc import Callable

import aiomqtt

from robots.bridge.broker_address import BrokerAddress, Inbox, backoff, parse

CONNECT_SECONDS = 5.0
# Far more than a web process ever has in flight; beyond it the bridge refuses instead of queueing.
MAX_INFLIGHT = 1000
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
        """Return a client for the present node; a user in its address overrides `credentials`. Call
        it inside the loop.

        `receive` is called with every message. Without `clean_session`, the broker keeps
        subscriptions and queues their messages at QoS 1 while the client is away.
        """
        node = self.node
        username, password = (node.username, node.password) if node.username else credentials
        return aiomqtt.Client(
            node.host,
            node.port,
            username=username,
            password=password,
            identifier=identifier,
            queue_type=functools.partial(Inbox, receive) if receive else None,  # type: ignore[arg-type]
            clean_session=clean_session,
            timeout=CONNECT_SECONDS,
            keepalive=self.keepalive_seconds,
            max_inflight_messages=MAX_INFLIGHT,
            max_queued_outgoing_messages=MAX_INFLIGHT,
            transport="websockets" if node.websocket else "tcp",
            websocket_path=node.path or None,
            tls_context=ssl.create_default_context() if node.tls else None,
            socket_options=[(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)],
        )

    def ended(self, *, was_up: bool) -> float:
        """Move to the next node after a connection (`was_up`) or attempt; return the wait in s."""
        self.attempt = 0 if was_up else self.attempt + 1
        self._index = (self._index + 1) % len(self._nodes)
        return backoff(self.attempt // len(self._nodes), self._rng.random())
