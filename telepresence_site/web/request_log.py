"""ASGI middleware that gives each request an id, a line in the log, and its place in the metrics.

A line has the route and never the path: paths contain one-time links, and reveal who visits what.
daphne's own access log, which has paths, is off (telepresence_site/serving.py).
"""

import logging
import re
import secrets
import time
from collections.abc import Awaitable, Callable
from typing import Any

import structlog
from django.urls import Resolver404, resolve
from prometheus_client import Counter, Gauge, Histogram

from robots.process import log_ids

log = structlog.stdlib.get_logger("telepresence.request")
HEADER = b"x-request-id"
ELSEWHERE = "elsewhere"
METHODS = frozenset({"GET", "HEAD", "POST", "PUT", "PATCH", "DELETE", "OPTIONS"})
QUIET = frozenset({"healthz", "readyz", "metrics", ELSEWHERE})  # frequent, or static
_GIVEN = re.compile(rb"[A-Za-z0-9-]{8,64}")
REQUESTS = Counter("telepresence_http_requests", "Answered HTTP requests.", ["method", "status"])
SECONDS = Histogram(
    "telepresence_http_request_seconds", "Time from a request to the end of its response."
)
SOCKETS = Gauge("telepresence_websockets", "Open WebSockets.", ["kind"])

Application = Callable[[dict[str, Any], Any, Any], Awaitable[None]]


def route_of(path: str) -> str:
    """Return the pattern that a path matches, without ids and keys, or `elsewhere`."""
    return _found(path)[0]


class RequestLog:
    """Gives every request and socket an id, its proxy's if that sent a plain one; the answer has it
    as X-Request-ID.
    """

    def __init__(self, application: Application) -> None:
        self._application = application

    async def __call__(self, scope: dict[str, Any], receive: Any, send: Any) -> None:
        given = next((value for name, value in scope.get("headers", ()) if name == HEADER), b"")
        request = given.decode() if _GIVEN.fullmatch(given) else secrets.token_hex(8)
        if scope["type"] == "websocket":
            with log_ids.about(request=request):  # the consumer adds robot and session
                await self._serve_socket(scope, receive, send)
            return
        route, named = _found(scope["path"])
        with log_ids.about(request=request, **named):
            await self._serve_request(scope, receive, send, request, route)

    async def _serve_socket(self, scope: dict[str, Any], receive: Any, send: Any) -> None:
        kind = _kind_of_socket(scope["path"])
        SOCKETS.labels(kind).inc()
        try:
            await self._application(scope, receive, send)
        finally:
            SOCKETS.labels(kind).dec()

    async def _serve_request(
        self, scope: dict[str, Any], receive: Any, send: Any, request: str, route: str
    ) -> None:
        began, status = time.monotonic(), 0

        async def answer(message: dict[str, Any]) -> None:
            nonlocal status
            if message["type"] == "http.response.start":
                status = message["status"]
                headers = [*message.get("headers", ()), (HEADER, request.encode())]
                message = {**message, "headers": headers}
            await send(message)

        try:
            await self._application(scope, receive, answer)
        finally:
            _note(scope["method"], route, status, time.monotonic() - began)


def _kind_of_socket(path: str) -> str:
    match path.strip("/").split("/"):
        case ["ws", "check"]:
            return "check"
        case ["ws", "robots", _robot]:
            return "drive"
        case ["ws", "robots", _robot, "screen" | "wizard" as page]:
            return page
    return ELSEWHERE


def _found(path: str) -> tuple[str, dict[str, object]]:
    """Return a path's route, and the robot and session in it."""
    try:
        found = resolve(path)
    except Resolver404:
        return ELSEWHERE, {}
    return found.route or "/", {
        name: str(found.kwargs[name]) for name in ("robot", "session") if name in found.kwargs
    }


def _note(given: str, route: str, status: int, seconds: float) -> None:
    method = given if given in METHODS else "other"
    REQUESTS.labels(method, str(status)).inc()
    SECONDS.observe(seconds)
    level = logging.DEBUG if route in QUIET else logging.INFO
    log.log(
        level,
        "request_done",
        method=method,
        route=route,
        status=status,
        milliseconds=round(1000.0 * seconds, 1),
    )
