"""The session manager: the one process that owns time.

Its event loop carries messages and never waits for anything else. Three threads wait: the recorder
writes the record, the scheduler looks at sessions, presence and signals, and a third keeps the
heartbeat that makes this process the leader.

Three lifetimes, three classes: `LeaderElection` lives as long as the process, `ActiveManager` while
this process leads, `BrokerConnection` from one connection to its loss. Whatever goes wrong with
broker or database is reported, and begun again. `run` ends when it is told to, or with an error
when the recorder has died, for then nothing would be recorded any more.
"""

import asyncio
import random
import time
from collections.abc import Callable

import structlog
from django.conf import settings

from robots.bridge.failover import parse_nodes
from sessions.manager.active import ActiveManager
from sessions.manager.health import ManagerHealth
from sessions.manager.leadership import HEARTBEAT_INTERVAL_S, WAIT_SECONDS, LeaderElection

logger = structlog.stdlib.get_logger(__name__)


class SessionManager:
    """Runs until `stop` is called.

    Args:
        url: the broker's address, or those of its nodes, comma-separated.
        credentials: user and password there.
        rng: spreads reconnections.
        clock: Unix seconds.
    """

    def __init__(
        self,
        url: str,
        credentials: tuple[str, str],
        rng: random.Random,
        clock: Callable[[], float] = time.time,
    ) -> None:
        self._nodes = parse_nodes(url)
        self._credentials = credentials
        self._rng = rng
        self._clock = clock
        self._health = ManagerHealth()
        self._election = LeaderElection(settings.VAR_DIR / "session-manager.lock", self._health)
        self._stopping = asyncio.Event()
        self.connected = asyncio.Event()
        self.active: ActiveManager | None = None

    def stop(self) -> None:
        """Have `run` write what is there and return."""
        self._stopping.set()

    async def run(self) -> None:
        """Lead as soon as no other session manager does; and again, when another has taken over.

        Raises:
            RecorderDied: nothing is recorded any more.
        """
        waits = False
        try:
            while not self._stopping.is_set():
                if await self._election.win():
                    await self._lead()
                elif not waits:
                    logger.info("session_manager_waiting", holder=self._election.holder)
                    waits = True
                await self._pause(WAIT_SECONDS)
        finally:
            await self._election.close()

    async def _lead(self) -> None:
        """Lead until this process is to stop, or another one has taken over."""
        logger.info("session_manager_started", holder=self._election.holder)
        self.active = active = ActiveManager(
            self._nodes,
            self._credentials,
            self._rng,
            self._clock,
            self._health,
            self.connected,
        )
        try:
            while not self._stopping.is_set():
                if not await self._election.keep(active.report()):
                    logger.error("session_manager_replaced", holder=self._election.holder)
                    return
                active.check()
                await self._pause(HEARTBEAT_INTERVAL_S)
        finally:
            self.active = None
            await active.close()

    async def _pause(self, seconds: float) -> None:
        try:
            async with asyncio.timeout(seconds):
                await self._stopping.wait()
        except TimeoutError:
            return
