"""ASGI middleware that keeps requests from Django: bodies that are larger than any form, WebSockets
of other sites' pages, and too many WebSockets.
"""

import collections
import functools
import time
from collections.abc import Awaitable, Callable, Sequence
from typing import Any
from urllib.parse import urlsplit

import structlog
from django.urls import URLPattern

from accounts.client_address import counted, visitor_address
from robots.api.bucket import Bucket

log = structlog.stdlib.get_logger(__name__)

Application = Callable[[dict[str, Any], Any, Any], Awaitable[None]]

# The largest form is a floor plan (robots/plans/floorplans.py): image, YAML and plan, multipart.
MAX_BODY = 10 * 1024 * 1024
TOO_LARGE = 413
# A class behind one address may reload its pages together.
CONNECTS_A_SECOND, CONNECTS_AT_ONCE, ADDRESSES = 5.0, 200.0, 4096
DEFAULT_PORTS = {"http": 80, "https": 443, "ws": 80, "wss": 443}


class BodyLimit:
    """Answers 413 to a request whose body is too large, by its header or in fact, and reads no more
    of it.
    """

    def __init__(self, application: Application, limit: int = MAX_BODY) -> None:
        self._application, self._limit = application, limit

    async def __call__(self, scope: dict[str, Any], receive: Any, send: Any) -> None:
        if scope["type"] != "http":
            await self._application(scope, receive, send)
        elif _declared(scope) > self._limit:
            await _refuse(send)
        else:
            await self._application(scope, _Counted(receive, send, self._limit), send)


class _Counted:
    """`receive` that counts bytes. Beyond the limit it answers with 413, and reports to the
    application that the client has disconnected.
    """

    def __init__(self, receive: Any, send: Any, limit: int) -> None:
        self._receive, self._send, self._left, self._refused = receive, send, limit, False

    async def __call__(self) -> dict[str, Any]:
        if self._refused:
            return {"type": "http.disconnect"}
        message: dict[str, Any] = await self._receive()
        self._left -= len(message.get("body", b""))
        if self._left >= 0:
            return message
        self._refused = True
        await _refuse(self._send)
        return {"type": "http.disconnect"}


def _declared(scope: dict[str, Any]) -> int:
    length = _header(scope, b"content-length")
    return int(length) if length.isascii() and length.isdigit() else 0


async def _refuse(send: Any) -> None:
    headers = [(b"content-type", b"text/plain; charset=utf-8"), (b"connection", b"close")]
    await send({"type": "http.response.start", "status": TOO_LARGE, "headers": headers})
    await send(
        {"type": "http.response.body", "body": b"This is larger than anything that is sent here.\n"}
    )


class SameOrigin:
    """Accepts WebSockets of pages from this host and port, or from a trusted origin.

    The port counts because a browser sends our cookies to all ports of a host, and a page at
    another port is not ours. With `secure_only`, the page itself must have come by HTTPS, because
    an attacker in the network can forge a page that came by http. This is read from the Origin
    header, which a TLS proxy passes on, and not from the connection, which may come from the proxy.
    """

    def __init__(
        self, application: Application, trusted: list[str], *, secure_only: bool = False
    ) -> None:
        self._application, self._secure_only = application, secure_only
        self._trusted = {origin.lower().rstrip("/") for origin in trusted}

    async def __call__(self, scope: dict[str, Any], receive: Any, send: Any) -> None:
        origin = _header(scope, b"origin").lower().rstrip("/")
        host = _header(scope, b"host").lower()
        is_ours = is_same(origin, host) and (not self._secure_only or origin.startswith("https://"))
        if is_ours or origin in self._trusted:
            await self._application(scope, receive, send)
        else:
            await send({"type": "websocket.close", "code": 1000})


class ConnectLimit:
    """Limits how many WebSockets an address opens at once and a second; a refused page retries
    later.

    Each process counts for itself: a request to a shared cache would delay commands.
    """

    def __init__(
        self,
        application: Application,
        trusted_proxies: list[str],
        now: Callable[[], float] = time.monotonic,
    ) -> None:
        self._application, self._proxies, self._now = application, trusted_proxies, now
        self._buckets: collections.OrderedDict[str, Bucket] = collections.OrderedDict()

    async def __call__(self, scope: dict[str, Any], receive: Any, send: Any) -> None:
        if self._bucket(address_of(scope, self._proxies)).spend(self._now()):
            await self._application(scope, receive, send)
        else:
            log.warning("sockets_refused", reason="rate")
            await send({"type": "websocket.close", "code": 1013})

    def _bucket(self, address: str) -> Bucket:
        bucket = self._buckets.setdefault(address, Bucket(CONNECTS_A_SECOND, CONNECTS_AT_ONCE))
        self._buckets.move_to_end(address)
        if len(self._buckets) > ADDRESSES:
            self._buckets.popitem(last=False)
        return bucket


class KnownPaths:
    """Answers 404 to a WebSocket whose path no consumer serves."""

    def __init__(self, application: Application, patterns: Sequence[URLPattern]) -> None:
        self._application, self._patterns = application, patterns

    async def __call__(self, scope: dict[str, Any], receive: Any, send: Any) -> None:
        path = scope["path"].removeprefix("/")
        if any(pattern.resolve(path) for pattern in self._patterns):
            await self._application(scope, receive, send)
        else:
            await _not_found(send)


async def _not_found(send: Any) -> None:
    """Refuse a handshake with 404. ASGI has no status for a refusal, and daphne sends 403, so this
    does the same as its WebSocketProtocol.serverReject. Behind another server it stays 403.
    """
    protocol = send.args[0] if isinstance(send, functools.partial) and send.args else None
    handshake = getattr(protocol, "handshake_deferred", None)
    if protocol is None or handshake is None:
        await send({"type": "websocket.close", "code": 1000})
        return
    from autobahn.websocket.types import ConnectionDeny  # noqa: PLC0415 -- daphne has loaded it

    del protocol.handshake_deferred
    handshake.errback(ConnectionDeny(code=404, reason="Not Found"))
    protocol.server.protocol_disconnected(protocol)


class OpenLimit:
    """Limits how many WebSockets are open in this process for each key that `key_of` returns, such
    as an address or user; an empty key has no limit. A refused page retries later.
    """

    def __init__(
        self, application: Application, limit: int, key_of: Callable[[dict[str, Any]], str]
    ) -> None:
        self._application, self._limit, self._key_of = application, limit, key_of
        self._open: collections.Counter[str] = collections.Counter()

    async def __call__(self, scope: dict[str, Any], receive: Any, send: Any) -> None:
        key = self._key_of(scope)
        if not key:
            await self._application(scope, receive, send)
            return
        if self._open[key] >= self._limit:
            log.warning("sockets_refused", reason="open")
            await send({"type": "websocket.close", "code": 1013})
            return
        self._open[key] += 1
        try:
            await self._application(scope, receive, send)
        finally:
            self._open[key] -= 1
            if not self._open[key]:
                del self._open[key]


def address_of(scope: dict[str, Any], trusted_proxies: list[str]) -> str:
    """Return the address that a socket is counted by, empty when it is unknown."""
    forwarded, sender = _header(scope, b"x-forwarded-for"), (scope.get("client") or ("",))[0]
    return counted(visitor_address(forwarded, sender, trusted_proxies))


def user_of(scope: dict[str, Any]) -> str:
    """Return the key of a socket's user, empty without a login."""
    return str(scope["user"].pk) if scope["user"].is_authenticated else ""


def is_same(origin: str, host: str) -> bool:
    """Tell whether an Origin header and a Host header are the same; a missing port is the scheme's
    default.
    """
    try:
        page, asked = urlsplit(origin), urlsplit(f"//{host}")
        default = DEFAULT_PORTS.get(page.scheme)
        return (
            bool(page.hostname)
            and page.hostname == asked.hostname
            and (page.port or default) == (asked.port or default)
        )
    except ValueError:  # an invalid port
        return False


def _header(scope: dict[str, Any], name: bytes) -> str:
    return next(
        (value.decode("latin-1") for key, value in scope.get("headers", ()) if key.lower() == name),
        "",
    )
