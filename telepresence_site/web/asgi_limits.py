"""What never reaches Django: bodies that are larger than any form, WebSockets of pages that are not
ours, and too many at once.
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

# The largest form is a floor plan: its image, YAML and plan (robots/floorplans.py), and what
# multipart adds.
MAX_BODY = 10 * 1024 * 1024
TOO_LARGE = 413
# a class behind one address reloads its pages together
CONNECTS_A_SECOND, CONNECTS_AT_ONCE, ADDRESSES = 5.0, 200.0, 4096
DEFAULT_PORTS = {"http": 80, "https": 443, "ws": 80, "wss": 443}


class BodyLimit:
    """ASGI middleware for HTTP: a body that says it is too large, or turns out to be, is answered
    with 413 and read no further.
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
    """`receive` that counts; past the limit it refuses, and the client is gone as far as the
    application knows.
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
    """ASGI middleware for WebSockets: the page that opens one comes from this very host and port,
    or from a trusted origin.

    Stricter than the host alone: a browser sends our cookies also to whatever else listens on
    another port of the same host. With `secure_only` the page came by HTTPS: anybody on the network
    between can make one up that came by plain http. It is the page's own word that counts, which a
    proxy that speaks TLS for us passes on, and not how the socket arrives here.
    """

    def __init__(
        self, application: Application, trusted: list[str], *, secure_only: bool = False
    ) -> None:
        self._application, self._trusted, self._secure_only = (
            application,
            {origin.lower().rstrip("/") for origin in trusted},
            secure_only,
        )

    async def __call__(self, scope: dict[str, Any], receive: Any, send: Any) -> None:
        origin, host = (
            _header(scope, b"origin").lower().rstrip("/"),
            _header(scope, b"host").lower(),
        )
        is_ours = is_same(origin, host) and (not self._secure_only or origin.startswith("https://"))
        if is_ours or origin in self._trusted:
            await self._application(scope, receive, send)
        else:
            await send({"type": "websocket.close", "code": 1000})


class ConnectLimit:
    """ASGI middleware for WebSockets: an address opens so many at once, and so many a second; the
    page tries again by itself, later.

    Counted in this process alone, because to ask a shared cache would keep everybody else's
    commands waiting.
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
    """ASGI middleware for WebSockets: a path that no consumer serves is answered with 404."""

    def __init__(self, application: Application, patterns: Sequence[URLPattern]) -> None:
        self._application, self._patterns = application, patterns

    async def __call__(self, scope: dict[str, Any], receive: Any, send: Any) -> None:
        path = scope["path"].removeprefix("/")
        if any(pattern.resolve(path) for pattern in self._patterns):
            await self._application(scope, receive, send)
        else:
            await _not_found(send)


async def _not_found(send: Any) -> None:
    """Refuse a handshake with 404. ASGI knows no status of a refusal, and daphne's is 403: this
    does what its WebSocketProtocol.serverReject does. Behind another server it stays 403.
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
    """ASGI middleware for WebSockets: each has so many open at a time in this process, an address,
    a user, or whomever `who` names.

    Of whom it names by the empty string nothing is known, and nothing counted. A page that is
    refused tries again by itself, later.
    """

    def __init__(
        self, application: Application, limit: int, who: Callable[[dict[str, Any]], str]
    ) -> None:
        self._application, self._limit, self._who = application, limit, who
        self._open: collections.Counter[str] = collections.Counter()

    async def __call__(self, scope: dict[str, Any], receive: Any, send: Any) -> None:
        who = self._who(scope)
        if not who:
            await self._application(scope, receive, send)
        elif self._open[who] < self._limit:
            await self._counted(who, scope, receive, send)
        else:
            log.warning("sockets_refused", reason="open")
            await send({"type": "websocket.close", "code": 1013})

    async def _counted(self, who: str, scope: dict[str, Any], receive: Any, send: Any) -> None:
        self._open[who] += 1
        try:
            await self._application(scope, receive, send)
        finally:
            self._open[who] -= 1
            if not self._open[who]:
                del self._open[who]


def address_of(scope: dict[str, Any], trusted_proxies: list[str]) -> str:
    """Return for whom a socket counts, by where our proxies say that it comes from; the empty
    string when nobody does.
    """
    return counted(
        visitor_address(
            _header(scope, b"x-forwarded-for"), (scope.get("client") or ("",))[0], trusted_proxies
        )
    )


def user_of(scope: dict[str, Any]) -> str:
    """Return the key of whoever opened a socket, the empty string for somebody who has not signed
    in.
    """
    return str(scope["user"].pk) if scope["user"].is_authenticated else ""


def is_same(origin: str, host: str) -> bool:
    """Tell whether an Origin header is of the host that was asked; a port that is not written is
    the scheme's own.
    """
    try:
        page, asked = urlsplit(origin), urlsplit(f"//{host}")
        default = DEFAULT_PORTS.get(page.scheme)
        return (
            bool(page.hostname)
            and page.hostname == asked.hostname
            and (page.port or default) == (asked.port or default)
        )
    except ValueError:  # a port that is none
        return False


def _header(scope: dict[str, Any], name: bytes) -> str:
    return next(
        (value.decode("latin-1") for key, value in scope.get("headers", ()) if key.lower() == name),
        "",
    )
