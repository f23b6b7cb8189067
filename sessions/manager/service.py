"""The session manager: the process that applies time to sessions, of all robots or of its share.

Its event loop carries messages and never waits for anything else. Three threads use the database:
the recorder writes the record, the scheduler works on sessions, presence and signals, and a third
keeps the heartbeat by which this process owns its shards of the robots.

Three lifetimes, three classes: `Membership` lives as long as the process, `ActiveManager` while it
has its slot, `BrokerConnection` from one connection to its loss. Failures of broker and database
are logged and retried. `run` ends after `stop`, or with an error when the recorder has died, as
nothing would be recorded any more.
"""

import asyncio
import random

import structlog
from django.conf import settings

from robots.bridge.failover import parse_nodes
from sessions.manager.active import ActiveManager
from sessions.manager.health import ManagerHealth
from sessions.manager.membership import WAIT_SECONDS, Membership

logger = structlog.stdlib.get_logger(__name__)


class SessionManager:
    """Runs until `stop` is called.

    Args:
        url: the broker's address, or those of its nodes, comma-separated.
        credentials: user and password there.
        rng: spreads reconnections.
    """

    def __init__(self, url: str, credentials: tuple[str, str], rng: random.Random) -> None:
        self._nodes = parse_nodes(url)
        self._credentials = credentials
        self._rng = rng
        self._health = ManagerHealth()
        self._membership = Membership(settings.VAR_DIR, self._health)
        self._stopping = asyncio.Event()
        self._giving: asyncio.Task[None] | None = None
        self.connected = asyncio.Event()
        self.active: ActiveManager | None = None

    def stop(self) -> None:
        """Have `run` write the rest of the record and return."""
        self._stopping.set()

    async def run(self) -> None:
        """Serve as soon as a slot is free; and again, if others took this process for dead.

        Raises:
            RecorderDied: the recorder's thread has ended.
        """
        waits = False
        try:
            while not self._stopping.is_set():
                if await self._membership.join():
                    await self._serve()
                elif not waits:
                    logger.info("session_manager_waiting", holder=self._membership.holder)
                    waits = True
                await self._pause(WAIT_SECONDS)
        finally:
            await self._membership.close()

    async def _serve(self) -> None:
        """Serve until this process is to stop, or others have taken its slot."""
        membership = self._membership
        logger.info("session_manager_started", holder=membership.holder, slot=membership.slot)
        self.active = active = ActiveManager(
            self._nodes,
            self._credentials,
            self._rng,
            self._health,
            self.connected,
            membership,
        )
        try:
            while not self._stopping.is_set() and await self._beat(active):
                active.check()
                await self._pause(membership.interval)
        finally:
            self.active = None
            await self._close(active)

    async def _beat(self, active: ActiveManager) -> bool:
        """Beat, and react to changes of other members; False when the slot is lost."""
        membership, version = self._membership, self._membership.ownership.version
        if not await membership.beat(active.report()):
            logger.error("session_manager_replaced", holder=membership.holder)
            membership.ownership.become({})
            return False
        if membership.ownership.version != version:
            active.wake()
        if membership.gifts and (self._giving is None or self._giving.done()):
            self._giving = asyncio.create_task(self._give(active, dict(membership.gifts)))
        if departed := membership.departed:
            membership.departed = set()
            active.forget_departed(departed)
        return True

    async def _give(self, active: ActiveManager, gifts: dict[str, frozenset[int]]) -> None:
        """Hand shards over, when everything received of their robots is written."""
        numbers = frozenset[int]().union(*gifts.values())
        await self._membership.release(numbers)
        try:
            await active.release(numbers)
        finally:
            await self._membership.hand_over(gifts)

    async def _close(self, active: ActiveManager) -> None:
        """Beat until everything is written, to keep the slot until then; and give it back."""
        if self._giving is not None:
            await asyncio.wait([self._giving])
        closing = asyncio.create_task(active.close())
        while not closing.done():
            await self._membership.beat(active.report())
            await asyncio.wait([closing], timeout=self._membership.interval)
        await self._membership.leave()
        await closing

    async def _pause(self, seconds: float) -> None:
        try:
            async with asyncio.timeout(seconds):
                await self._stopping.wait()
        except TimeoutError:
            return
