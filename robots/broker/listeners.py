"""The addresses on which a broker listens."""

import asyncio
import socket
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

# where a client on this computer finds a server that listens on all addresses
LOOPBACK_OF = {"0.0.0.0": "127.0.0.1", "::": "::1"}  # noqa: S104


@dataclass(frozen=True)
class Tls:
    """Paths of the server's certificate chain and its key, PEM."""

    certificate: Path
    key: Path


@dataclass(frozen=True)
class Listeners:
    """Host and port for MQTT, with TLS if there is a certificate; `websockets` is the host and port
    for MQTT over WebSocket, without TLS, which the proxy adds.
    """

    host: str
    port: int
    tls: Tls | None = None
    websockets: tuple[str, int] | None = None

    def bound(self) -> "Listeners":
        """Return the same with a free port in place of 0, which the brokers cannot report.

        Raises:
            OSError: an address is not available; a broker would only write so into its log.
        """
        if self.websockets is not None:
            _usable_port(*self.websockets)
        return replace(self, port=_usable_port(self.host, self.port))

    def addresses(self) -> Iterator[tuple[str, int]]:
        """Iterate over (host, port) of each listener, as a client on this computer finds it."""
        yield LOOPBACK_OF.get(self.host, self.host), self.port
        if self.websockets is not None:
            host, port = self.websockets
            yield LOOPBACK_OF.get(host, host), port

    async def answer(self) -> bool:
        """Tell whether a server accepts connections on every address."""
        for host, port in self.addresses():
            try:
                _, writer = await asyncio.open_connection(host, port)
            except OSError:
                return False
            writer.close()
        return True


def _usable_port(host: str, port: int) -> int:
    family, kind, _, _, address = socket.getaddrinfo(
        host or None, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE
    )[0]
    with socket.socket(family, kind) as probe:
        # connections that ended a moment ago do not count
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        probe.bind(address)
        probe.listen()
        return int(probe.getsockname()[1])
