"""Static files without Django: a drive page asks for a hundred of them at once.

They are read in two threads of their own, because a disk that dies may never answer, and the event
loop carries commands.

Which files there are, under which names, compressed how and kept for how long, WhiteNoise knows
(whitenoise.middleware); what it does not find, or Django would first send to HTTPS, goes on to
Django as before, and so does everything where files are looked for anew each time.
"""

import asyncio
from collections.abc import Awaitable, Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from typing import Any, Protocol

from telepresence_site.web.headers import PERMISSIONS

Application = Callable[[dict[str, Any], Any, Any], Awaitable[None]]
# What Django's security middleware and telepresence_site.web.headers say with every answer.
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
        application: answers everything else.
        files: paths to WhiteNoise's files.
        secure_only: whether a request that did not come by HTTPS is left to `application`.
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
        await send(
            {
                "type": "http.response.start",
                "status": int(answer.status),
                "headers": [*headers, *SAME],
            }
        )
        await send({"type": "http.response.body", "body": body})


def _read(file: StaticFile, scope: dict[str, Any]) -> tuple[Any, bytes]:
    answer = file.get_response(scope["method"], _environ(scope))
    if answer.file is None:
        return answer, b""
    with answer.file:
        return answer, answer.file.read()


def _environ(scope: dict[str, Any]) -> dict[str, str]:
    """Return the request's headers under the names that WhiteNoise looks for."""
    return {
        f"HTTP_{name.decode('latin-1').upper().replace('-', '_')}": value.decode("latin-1")
        for name, value in scope["headers"]
    }
