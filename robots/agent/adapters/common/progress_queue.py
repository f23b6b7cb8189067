"""Progress of actions until the agent reads it; bounded: one entry per action and status."""

import asyncio

from robots.agent.robot_interface import ActionProgress, AdapterError
from robots.api.messages import ENDED

News = ActionProgress | AdapterError
MOST = 256


class ProgressQueue:
    """A FIFO for one loop. Beyond `MOST`, the oldest news that ends no action is dropped first."""

    def __init__(self) -> None:
        self._waiting: dict[tuple[str, str], News] = {}
        self._came = asyncio.Event()

    def put(self, news: News) -> None:
        """Let news wait, in the place of older news of the same action and status."""
        key = (news.action_id, news.status) if isinstance(news, ActionProgress) else ("", "FAILED")
        self._waiting[key] = news
        if len(self._waiting) > MOST:
            del self._waiting[min(self._waiting, key=_ends)]  # the oldest of those that end nothing
        self._came.set()

    async def get(self) -> ActionProgress:
        """Wait for the next news; raises an AdapterError that was put in."""
        while not self._waiting:
            self._came.clear()
            await self._came.wait()
        news = self._waiting.pop(next(iter(self._waiting)))
        if isinstance(news, AdapterError):
            raise news
        return news


def _ends(key: tuple[str, str]) -> bool:
    return key[1] in ENDED
