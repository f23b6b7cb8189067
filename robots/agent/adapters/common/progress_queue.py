"""Progress of actions until the agent reads it; bounded: one entry per action and status."""

import asyncio

from robots.agent.robot_interface import ActionProgress, AdapterError
from robots.api.messages import ENDED

MOST = 256


class ProgressQueue:
    """A FIFO for one loop. Beyond `MOST`, the oldest entry that ends no action is dropped first."""

    def __init__(self) -> None:
        self._waiting: dict[tuple[str, str], ActionProgress | AdapterError] = {}
        self._came = asyncio.Event()

    def put(self, news: ActionProgress | AdapterError) -> None:
        """Add an entry, or replace an older one of the same action and status."""
        key = (news.action_id, news.status) if isinstance(news, ActionProgress) else ("", "FAILED")
        self._waiting[key] = news
        if len(self._waiting) > MOST:
            del self._waiting[min(self._waiting, key=lambda key: key[1] in ENDED)]
        self._came.set()

    async def get(self) -> ActionProgress:
        """Wait for the next entry; raises an AdapterError that was put in."""
        while not self._waiting:
            self._came.clear()
            await self._came.wait()
        news = self._waiting.pop(next(iter(self._waiting)))
        if isinstance(news, AdapterError):
            raise news
        return news
