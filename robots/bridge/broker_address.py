"""The address of the broker, as one URL: mqtt://, mqtts://, ws:// or wss://, optionally with a user
and password.
"""

import asyncio
import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any
from urllib.parse import unquote, urlsplit

import aiomqtt
import structlog

log = structlog.stdlib.get_logger(__name__)

PORTS = {"mqtt": 1883, "mqtts": 8883, "ws": 80, "wss": 443}
REFUSED = 0x80


class BadAddress(ValueError):
    """A broker URL that cannot be used; the message is one sentence for the operator."""


@dataclass(frozen=True)
class BrokerAddress:
    """A parsed broker URL; `path` is that of a WebSocket."""

    host: str
    port: int
    tls: bool = False
    websocket: bool = False
    path: str = ""
    username: str | None = None
    password: str | None = None


def parse(url: str) -> BrokerAddress:
    """Return the parts of a broker URL.

    Raises:
        BadAddress: an unknown scheme, no host, or an impossible port.
    """
    try:
        parts = urlsplit(url)
        port = parts.port
    except ValueError as error:
        raise BadAddress(f"The broker's address “{url}” cannot be read: {error}.") from error
    if parts.scheme not in PORTS or not parts.hostname:
        raise BadAddress(
            f"The broker's address “{url}” must begin with"
            f" {', '.join(f'{scheme}://' for scheme in PORTS)} and name a host."
        )
    websocket = parts.scheme in {"ws", "wss"}
    return BrokerAddress(
        host=parts.hostname,
        port=port or PORTS[parts.scheme],
        tls=parts.scheme in {"mqtts", "wss"},
        websocket=websocket,
        path=(parts.path or "/mqtt") if websocket else "",
        username=unquote(parts.username) if parts.username else None,
        password=unquote(parts.password) if parts.password else None,
    )


class Inbox(asyncio.Queue[aiomqtt.Message]):
    """Calls `receive` at once, without a task for each message (saves a quarter of the CPU)."""

    def __init__(self, receive: Callable[[aiomqtt.Message], None], maxsize: int = 0) -> None:
        super().__init__(maxsize)
        self._receive = receive

    def put_nowait(self, item: aiomqtt.Message) -> None:
        """Pass a message on. aiomqtt would end the connection for an exception, and the next one
        would receive a retained message again.
        """
        try:
            self._receive(item)
        except Exception:
            log.exception("message_failed", topic=str(item.topic))


def backoff(attempt: int, chance: float, *, first: float = 0.2, ceiling: float = 0.8) -> float:
    """Return how many seconds to wait before attempt number `attempt` (0 is the first retry).

    It doubles up to the ceiling, which is low, because a server has few processes and a lease that
    is not renewed for ten seconds ends a drive. `chance` in [0, 1) spreads clients over the upper
    half, so that they do not all connect to a restarted broker at once.
    """
    whole = min(ceiling, first * math.pow(2.0, min(attempt, 30)))
    return whole * (0.5 + 0.5 * chance)


async def until_lost(connected: aiomqtt.Client) -> None:
    """Return, or raise MqttError, when the connection of a client with `receive` ends."""
    async for _ in connected.messages:
        pass  # never reached: `receive` gets the messages


def check_subscribed(answers: Iterable[Any]) -> None:
    """Raise MqttError when the broker refused a subscription: aiomqtt only returns its answer."""
    if any(int(getattr(answer, "value", answer)) >= REFUSED for answer in answers):
        raise aiomqtt.MqttError("the broker refused a subscription")
