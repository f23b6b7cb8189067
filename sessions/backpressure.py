"""Whether a page's socket still takes frames, which ASGI does not report.

daphne gives every frame to Twisted, which buffers what the network does not take, without a limit
and silently. But a Twisted transport with more than 64 KiB in its buffer has asked its producer to
pause. `Backpressure` wraps the ASGI application and adds a function to the scope that reads this
flag; behind other servers than daphne it always returns False, because there `send` waits.
"""

import functools
from collections.abc import Awaitable, Callable
from typing import Any

IS_FULL = "telepresence.socket_is_full"
Application = Callable[[dict[str, Any], Any, Any], Awaitable[None]]


class Backpressure:
    """ASGI middleware; must be the outermost, where `send` is still the server's own."""

    def __init__(self, application: Application) -> None:
        self._application = application

    async def __call__(self, scope: dict[str, Any], receive: Any, send: Any) -> None:
        """Add the function to the scope."""
        protocol = send.args[0] if isinstance(send, functools.partial) and send.args else None
        await self._application(
            {**scope, IS_FULL: functools.partial(_is_full, protocol)}, receive, send
        )


def _is_full(protocol: Any) -> bool:
    """Tell whether the protocol's transport, or the one beneath its TLS, has asked for a pause."""
    transport = getattr(protocol, "transport", None)
    while transport is not None:
        if getattr(transport, "producerPaused", False):
            return True
        transport = getattr(transport, "transport", None)
    return False


def never_full() -> bool:
    """Return False: for scopes without the function."""
    return False
