"""Pages that are open, said to the database for many of them at once.

Every page says so every ten seconds. One by one that keeps the database's thread busy for some ten
milliseconds each; it shares the interpreter with whatever passes between pages and robots, which is
late for as long.
"""

import asyncio

from django.utils import timezone

from sessions.consumers.database import query
from sessions.leases import store

GATHER_SECONDS = 1.0  # a page counts as gone after many times as long


class LastSeenBatcher:
    """The pages of one process that are about to be said to be open."""

    def __init__(self) -> None:
        self._present: set[str] = set()
        self._asking: asyncio.Task[set[str]] | None = None
        self._writing: set[str] = set()
        self._written: asyncio.Task[set[str]] | None = None  # stores `_writing`

    async def seen(self, session: str) -> bool:
        """Say that a page of this session is open; False when the session has ended.

        Raises:
            DatabaseError: it was not said.
        """
        loop = asyncio.get_running_loop()
        if self._asking is None or self._asking.done() or self._asking.get_loop() is not loop:
            self._present = set()
            self._asking = loop.create_task(self._ask())
            self._asking.add_done_callback(_check)
        self._present.add(session)
        return session in await asyncio.shield(self._asking)

    async def forget(self, session: str) -> None:
        """Leave out a page that has closed, and wait for a batch that names it already: it would
        be stored as open after it was stored as gone.
        """
        self._present.discard(session)
        if session in self._writing and self._written is not None:
            await asyncio.wait({self._written})

    async def _ask(self) -> set[str]:
        await asyncio.sleep(GATHER_SECONDS)
        present, self._present = self._present, set()
        self._writing, self._written, self._asking = present, self._asking, None
        return await query(store.seen, present, timezone.now())


def _check(asked: asyncio.Task[set[str]]) -> None:
    """Take note of an error for which every page that would hear of it has gone."""
    if not asked.cancelled():
        asked.exception()


last_seen_batcher = LastSeenBatcher()
