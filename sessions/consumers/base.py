"""A WebSocket consumer that handles every frame at once, in order.

Channels' own consumer closes old database connections before every frame, in the one thread that
the queries of all pages share: a page's stop would wait behind another page's query, and for as
long as the database is away. Here queries have threads of their own (database.py), which also
manage their connections. Channels' consumer also polls the channel layer for every frame; here
pages listen to it in a separate task (sessions/page_channel.py).

All waiting frames are handled in one iteration of the event loop. One frame an iteration would be
fairer, but on a busy computer, where an iteration takes longer than a page's send interval, its
commands would pile up (seen in a benchmark: commands a minute old).
"""

from typing import Any

from channels.consumer import get_handler_name
from channels.exceptions import StopConsumer
from channels.generic.websocket import AsyncWebsocketConsumer


class DirectConsumer(AsyncWebsocketConsumer):
    """Base of all consumers here."""

    async def __call__(self, scope: Any, receive: Any, send: Any) -> None:
        """Handle frames until the socket is closed."""
        self.scope, self.base_send, self.channel_layer = scope, send, None
        try:
            while True:
                await self.dispatch(await receive())
        except StopConsumer:
            return

    async def dispatch(self, message: Any) -> None:
        """Pass a frame to its handler."""
        await getattr(self, get_handler_name(message))(message)
