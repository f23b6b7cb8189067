"""A WebSocket consumer that takes every frame at once, in the order in which they came.

Channels' own looks after old database connections before every frame, in the one thread that all
queries of all pages share: a page's stop would wait behind another page's query, and for as long as
the database is away. Queries have threads of their own (database.py), which look after
connections themselves. Nor is the channel layer asked before every frame: who listens to it does so
in a task of its own (sessions/page_channel.py).

Frames that wait are taken in one turn of the loop. One a turn would be fairer, and would let a
page's commands pile up for as long as a turn takes longer than they are apart, which is just when
the computer is busy (seen in a benchmark: commands a minute old).
"""

from typing import Any

from channels.consumer import get_handler_name
from channels.exceptions import StopConsumer
from channels.generic.websocket import AsyncWebsocketConsumer


class DirectConsumer(AsyncWebsocketConsumer):
    """Base of all consumers here."""

    async def __call__(self, scope: Any, receive: Any, send: Any) -> None:
        """Take frames until the socket is closed."""
        self.scope, self.base_send, self.channel_layer = scope, send, None
        try:
            while True:
                await self.dispatch(await receive())
        except StopConsumer:
            return

    async def dispatch(self, message: Any) -> None:
        """Hand a frame to its handler."""
        await getattr(self, get_handler_name(message))(message)
