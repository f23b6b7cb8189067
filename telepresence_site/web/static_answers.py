"""Answers requests for static files without Django: a drive page requests a hundred at once.

Two threads read them, because a failed disk may never answer and the event loop carries commands.

WhiteNoise has the files with their names, compressed copies and cache times. Django gets requests
for other files, those that it would redirect to HTTPS, and all while WhiteNoise looks files up at
each request.
"""

import asyncio
from collections.abc import Awaitable, Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from typing import Any, Protocol

from telepresence_site.web.headers import PERMISSIONS

Application = Callable[[dict[str, Any], Any, Any], Awaitable[None]]
# The headers of Django's security middleware and of telepresence_site.web.headers.
SAME = (
    (b"x-content-type-options", b"nosniff"),
    (b"cross-origin-resource-policy", b"same-origin"),
    (b"permissions-policy", PERMISSIONS.encode()),
)
_THREADS = ThreadPoolExecutor(2, "static")
METHODS = frozenset({"GET", "HEAD"})


class StaticFile(Protocol):
    """One of WhiteNoise's files."""

    def get_response(self, method: str, request_headers: Mapping[str, str]) -> Any:
        """Return `status`, `headers` (pairs of text) and `file` (open, or None)."""


class StaticAnswers:
    """ASGI middleware for HTTP.

    Args:
        application: answers all other requests.
        files: WhiteNoise's files by path.
        secure_only: leave requests that did not come by HTTPS to `application`.
    """

    def __init__(
        self,
        application: Application,
        files: Mapping[str, StaticFile],
        *,
        secure_only: bool = False,
    ) -> None:
        self._application, self._files, self._secure_only = application, files, secure_only

    async def __call__(self, scope: dict[str, Any], receive: Any, send: Any) -> None:
        file = (
            self._files.get(scope["path"])
            if scope["type"] == "http" and scope["method"] in METHODS
            else None
        )
        if file is None or (self._secure_only and scope["scheme"] != "https"):
            await self._application(scope, receive, send)
            return
        loop = asyncio.get_running_loop()
        answer, body = await loop.run_in_executor(_THREADS, _read, file, scope)
        headers = [(name.lower().encode(), value.encode()) for name, value in answer.headers]
        start = {"type": "http.response.start", "status": int(answer.status)}
        await send({**start, "headers": [*headers, *SAME]})
        await send({"type": "http.response.body", "body": body})


def _read(file: StaticFile, scope: dict[str, Any]) -> tuple[Any, bytes]:
    answer = file.get_response(scope["method"], _environ(scope))
    if answer.file is None:
        return answer, b""
    with answer.file:
        return answer, answer.file.read()


def _environ(scope: dict[str, Any]) -> dict[str, str]:
    """Return the request's headers under the names of WSGI, for WhiteNoise."""
    return {
        f"HTTP_{name.decode('latin-1').upper().replace('-', '_')}": value.decode("latin-1")
        for name, value in scope["headers"]
    }
