"""A WebSocket that echoes: a page measures whether, and how quickly, it reaches this site."""

import asyncio

from sessions import protocol
from sessions.consumers.base import DirectConsumer

MAX_ECHOES = 20
MAX_LENGTH = 64  # characters
SECONDS = 20.0


class CheckConsumer(DirectConsumer):
    """Needs no login, so it allows few echoes in a short time."""

    async def connect(self) -> None:
        """Accept the page for SECONDS."""
        self.left = MAX_ECHOES
        await self.accept()
        self.ending = asyncio.get_running_loop().create_task(self._end())

    async def _end(self) -> None:
        await asyncio.sleep(SECONDS)
        await self.close()

    async def disconnect(self, code: int) -> None:
        """Cancel the pending end."""
        self.ending.cancel()

    async def receive(self, text_data: str | None = None, bytes_data: bytes | None = None) -> None:
        """Echo a short text."""
        if text_data is None or len(text_data) > MAX_LENGTH or self.left == 0:
            await self.close(protocol.FLOODED)
            return
        self.left -= 1
        await self.send(text_data)
