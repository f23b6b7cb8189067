"""Nodes of NATS that are one broker."""

import asyncio
import contextlib
import urllib.request
from dataclasses import dataclass
from pathlib import Path

from robots.broker.nats import user_file
from robots.broker.permissions import MAX_PACKET
from tests.support.clustered_brokers.node import Node, program
from tests.support.sessions.site import free_port

HOST = "127.0.0.1"
USERS = "users.conf"


@dataclass(frozen=True)
class Place:
    """A node's machine, and its ports: MQTT, NATS's own clients, the other nodes, and HTTP."""

    host: str
    mqtt: int
    clients: int
    routes: int
    monitor: int

    @property
    def url(self):
        return f"mqtt://{self.host}:{self.mqtt}"


class NatsNodes:
    """Nodes on these hosts or machines, which read their users from `users.conf` in the
    directory.
    """

    def __init__(self, directory: Path, hosts):
        self.directory, self._hosts = directory, hosts
        self.places = [
            Place(getattr(host, "address", host), *(free_port() for _ in range(4)))
            for host in hosts
        ]
        self.nodes = []

    @property
    def urls(self):
        return ",".join(place.url for place in self.places)

    def start(self):
        nats = program("nats-server", "nats-server")
        for number, place in enumerate(self.places):
            file = self.directory / f"node-{number}.conf"
            file.write_text(self._configuration(number, place))
            log = self.directory / f"node-{number}.log"
            with getattr(self._hosts[number], "within", contextlib.nullcontext)():
                self.nodes.append(Node([nats, "-c", str(file)], log))

    async def ready(self):
        """Wait until the nodes have found each other and keep messages together."""
        for node, place in zip(self.nodes, self.places, strict=True):
            await node.until(lambda place=place: asyncio.to_thread(is_well, place), "nats")

    def reload(self):
        for node in self.nodes:
            node.reload()

    def stop(self):
        for node in self.nodes:
            node.kill()
        self.nodes = []

    def _configuration(self, number, place):
        lines = [
            f"server_name: node-{number}",
            f'listen: "{place.host}:{place.clients}"',
            f'http: "{place.host}:{place.monitor}"',
            f'jetstream {{ store_dir: "{self.directory / f"store-{number}"}" }}',
            f"max_payload: {MAX_PACKET - 512}",  # of the payload alone
            # a node that stops answering is dropped after two of these
            'ping_interval: "1s"',
            "ping_max: 2",
            'write_deadline: "1s"',
            f'mqtt {{ listen: "{place.host}:{place.mqtt}"',
            '  ack_wait: "10s"',
            "  max_ack_pending: 1000",
            "  consumer_memory_storage: true",
            "}",
            f"include {USERS}",
        ]
        if len(self.places) > 1:
            routes = ", ".join(f'"nats://{other.host}:{other.routes}"' for other in self.places)
            lines.append(
                f'cluster {{ name: telepresence, listen: "{place.host}:{place.routes}",'
                f" routes: [{routes}] }}"
            )
        return "\n".join(lines) + "\n"


def is_well(place):
    """Tell whether JetStream works on this node (a cluster has to choose its leader first)."""
    try:
        url = f"http://{place.host}:{place.monitor}/healthz"
        with urllib.request.urlopen(url, timeout=2) as answer:
            return answer.status == 200
    except OSError:
        return False


class NatsCluster:
    """Nodes with the users that `read_users` returns, polled for changes."""

    name = "nats"

    def __init__(self, read_users, directory: Path, *, nodes=3, poll=0.1):
        self._read_users, self._directory, self._poll = read_users, directory, poll
        self._users = {}
        self._nodes = NatsNodes(directory, [HOST] * nodes)

    @property
    def ports(self):
        return [place.mqtt for place in self._nodes.places]

    async def start(self, _listeners):
        self._directory.mkdir(parents=True, exist_ok=True)
        self._write(await self._read_users())
        self._nodes.start()
        await self._nodes.ready()
        return self.ports[0]

    async def wait(self):
        while True:
            await asyncio.sleep(self._poll)
            users = await self._read_users()
            if users != self._users:
                self._write(users)
                self._nodes.reload()

    async def stop(self):
        self._nodes.stop()

    def _write(self, users):
        (self._directory / USERS).write_text(user_file(users))
        self._users = dict(users)
