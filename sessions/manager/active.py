"""The session manager that leads: it records, keeps time, and connects to the broker again and
again.
"""

import asyncio
import functools
import random
from collections.abc import Callable
from typing import Any

import aiomqtt
import structlog
from django.conf import settings
from django.db import DatabaseError, InterfaceError

from robots.api.disk_space import DiskSpace
from robots.bridge import broker_address
from robots.bridge.broker_address import BrokerAddress
from robots.bridge.failover import Failover
from robots.bridge.inbox import Inbox
from robots.bridge.quick_reading import read_quickly
from robots.cancellation import cancel
from robots.enrol.credentials import server_client_id
from robots.presence import PresenceWriter
from sessions.manager.broker_connection import BrokerConnection, Work
from sessions.manager.database_thread import DatabaseThread
from sessions.manager.disk_watch import DiskWatch
from sessions.manager.health import ManagerHealth
from sessions.manager.ingest import Intake
from sessions.manager.return_to_dock import ReturnToDock
from sessions.manager.scheduler import Scheduler
from sessions.recording.recorder import Recorder

logger = structlog.stdlib.get_logger(__name__)

FLUSH_SECONDS = 20.0


class RecorderDied(RuntimeError):
    """The recorder's thread ended by an error that is not the database's."""


class ActiveManager:
    """Lives while this process leads; make it in the event loop, and `close` it.

    Args:
        nodes: where the broker is; more than one when it is a cluster.
        credentials: user and password there.
        rng: spreads reconnections.
        clock: Unix seconds.
        health: is told how steps in the database go.
        connected: is set while there is a connection that serves.
    """

    def __init__(
        self,
        nodes: tuple[BrokerAddress, ...],
        credentials: tuple[str, str],
        rng: random.Random,
        clock: Callable[[], float],
        health: ManagerHealth,
        connected: asyncio.Event,
    ) -> None:
        self._failover = Failover(nodes, rng)
        self._credentials = credentials
        self._clock = clock
        self._connected = connected
        self._connection: BrokerConnection | None = None
        self._ending = False
        loop = asyncio.get_running_loop()
        self.recorder = Recorder(
            functools.partial(loop.call_soon_threadsafe, self._ask_again), clock=clock
        )
        due, received = asyncio.Event(), asyncio.Event()
        self._work = Work(
            recorder=self.recorder,
            ingest=Intake(self.recorder, clock, wake_signals=received.set, wake_scheduler=due.set),
            scheduler=Scheduler(),
            return_to_dock=ReturnToDock(),
            presence=PresenceWriter(),
            thread=DatabaseThread("scheduler", health),
            health=health,
            disk=DiskWatch(DiskSpace(settings.VAR_DIR, settings.DISK_LOW_MB)),
            due=due,
            received=received,
        )
        self.recorder.start()
        self._serving = loop.create_task(self._serve_for_ever())

    def check(self) -> None:
        """Raise what has ended this manager's work, if anything has.

        Raises:
            RecorderDied: nothing is recorded any more.
        """
        if not self.recorder.is_alive:
            raise RecorderDied
        if self._serving.done():
            self._serving.result()

    def report(self) -> dict[str, Any]:
        """Return how this process does, in words that hold nothing personal."""
        return {
            "connected": self._connected.is_set(),
            "waiting": self.recorder.waiting,
            "counts": dict(self.recorder.counts),
            "refused": dict(self.recorder.refused),
            "rejected": dict(self._work.ingest.counts),
        }

    async def close(self) -> None:
        """Leave the broker, and write what is there."""
        self._ending = True
        await cancel(self._serving)
        if not await asyncio.to_thread(self.recorder.stop, FLUSH_SECONDS):
            logger.error("record_not_finished", counts=dict(self.recorder.counts))
        self._work.disk.close()
        await self._work.thread.close()
        counts = self.recorder.counts + self._work.ingest.counts
        logger.info("session_manager_stopped", counts=dict(counts))

    async def _serve_for_ever(self) -> None:
        while not self._ending:  # leaving a lost broker turns a cancellation into an MqttError
            try:
                await self._serve()
            except aiomqtt.MqttError as error:
                logger.warning(
                    "session_manager_offline", attempt=self._failover.attempt, reason=str(error)
                )
            except (DatabaseError, InterfaceError) as error:
                logger.warning(
                    "session_manager_without_database",
                    attempt=self._failover.attempt,
                    reason=str(error),
                )
            was_up = self._connected.is_set()
            self._connected.clear()
            if not self._ending:
                await asyncio.sleep(self._failover.ended(was_up=was_up))

    async def _serve(self) -> None:
        """Serve one connection, until it is lost."""
        inbox = functools.partial(Inbox, self._work.ingest.receive)
        async with broker_address.client(
            self._failover.node,
            self._credentials,
            server_client_id("session-manager"),
            inbox,
            keepalive_seconds=self._failover.keepalive_seconds,
            clean_session=False,
        ) as client:
            read_quickly(client)
            connection = BrokerConnection(client, self._work, self._clock)
            await connection.begin()
            self._connected.set()
            node = self._failover.node
            logger.info("session_manager_connected", host=node.host, port=node.port)
            self._connection = connection
            try:
                await connection.serve()
            finally:
                self._connection = None

    def _ask_again(self, robot: str, boot: str, first: int, last: int) -> None:
        if self._connection is not None:
            self._connection.ask_again(robot, boot, first, last)
