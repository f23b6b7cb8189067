"""Stores that pages are open, many in one query.

Every page stores it every ten seconds. One query each would take some ten milliseconds of a thread
that shares the interpreter with the messages between pages and robots, which it would delay.
"""

import asyncio

from django.utils import timezone

from sessions.consumers.database import query
from sessions.leases import store

GATHER_SECONDS = 1.0  # a page counts as gone after many times as long


class LastSeenBatcher:
    """Collects the open pages of one process."""

    def __init__(self) -> None:
        self._present: set[str] = set()
        self._asking: asyncio.Task[set[str]] | None = None
        self._writing: set[str] = set()
        self._written: asyncio.Task[set[str]] | None = None  # stores `_writing`

    async def seen(self, session: str) -> bool:
        """Store that a page of this session is open; False when the session has ended.

        Raises:
            DatabaseError: it was not stored.
        """
        loop = asyncio.get_running_loop()
        if self._asking is None or self._asking.done() or self._asking.get_loop() is not loop:
            self._present = set()
            self._asking = loop.create_task(self._ask())
            self._asking.add_done_callback(_check)
        self._present.add(session)
        return session in await asyncio.shield(self._asking)

    async def forget(self, session: str) -> None:
        """Leave out a page that has closed, and wait for a batch that already names it, which
        would otherwise store it as open after it was stored as closed.
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
    """Retrieve an error although every page that waited for the result may have closed."""
    if not asked.cancelled():
        asked.exception()


last_seen_batcher = LastSeenBatcher()
