"""A line that says back what it is told: a page measures with it whether, and how quickly, this
site can be reached.
"""

import asyncio

from sessions import protocol
from sessions.consumers.base import DirectConsumer

MOST_ECHOES = 20
LONGEST = 64  # characters
SECONDS = 20.0


class CheckConsumer(DirectConsumer):
    """Anybody's, so it does little, and not for long."""

    async def connect(self) -> None:
        """Let everybody in for a moment."""
        self.left = MOST_ECHOES
        await self.accept()
        self.ending = asyncio.get_running_loop().create_task(self._end())

    async def _end(self) -> None:
        await asyncio.sleep(SECONDS)
        await self.close()

    async def disconnect(self, code: int) -> None:
        """Forget the end that is not needed any more."""
        self.ending.cancel()

    async def receive(self, text_data: str | None = None, bytes_data: bytes | None = None) -> None:
        """Say a short word back."""
        if text_data is None or len(text_data) > LONGEST or self.left == 0:
            await self.close(protocol.FLOODED)
            return
        self.left -= 1
        await self.send(text_data)
