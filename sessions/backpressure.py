"""Whether a page's socket still takes what it is sent: the one thing about a WebSocket that ASGI
does not tell.

daphne hands every frame to Twisted, which keeps what the network does not take, without a bound and
without a word. Twisted does know: a transport whose buffer is over 64 KiB has told its producer to
pause. `Backpressure` wraps the ASGI application and puts a function into the scope that looks at
this flag; behind another server than daphne it always says no, because there `send` waits.
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
        """Add the function to the scope and go on."""
        protocol = send.args[0] if isinstance(send, functools.partial) and send.args else None
        await self._application(
            {**scope, IS_FULL: functools.partial(_is_full, protocol)}, receive, send
        )


def _is_full(protocol: Any) -> bool:
    """Tell whether the protocol's transport, or the one beneath its TLS, has been told to pause."""
    transport = getattr(protocol, "transport", None)
    while transport is not None:
        if getattr(transport, "producerPaused", False):
            return True
        transport = getattr(transport, "transport", None)
    return False


def never_full() -> bool:
    """Stand in where no server says anything."""
    return False
