"""The session manager that has a slot: it records, keeps time, and reconnects to the broker.

The broker queues messages for a slot while its process restarts. While other members live, they
receive the messages of the slot's robots, and the queue must be discarded: by the process that
takes the slot, or else by the owner of the site's shard.
"""

import asyncio
import contextlib
import functools
import random
import time
from collections.abc import Collection
from typing import Any

import aiomqtt
import structlog
from django.conf import settings
from django.db import DatabaseError, InterfaceError

from robots.api.disk_space import DiskSpace
from robots.bridge.broker_address import BrokerAddress
from robots.bridge.failover import Failover
from robots.bridge.quick_reading import read_quickly
from robots.enrol.credentials import server_client_id
from robots.presence.writer import PresenceWriter
from robots.process.cancellation import cancel
from sessions.manager.broker_connection import BrokerConnection, Work
from sessions.manager.database_thread import DatabaseThread
from sessions.manager.disk_watch import DiskWatch
from sessions.manager.health import ManagerHealth
from sessions.manager.ingest import Intake
from sessions.manager.intake_gate import IntakeGate
from sessions.manager.membership import Membership
from sessions.manager.return_to_dock import ReturnToDock
from sessions.manager.scheduler import Scheduler
from sessions.recording.items import ReleaseItem
from sessions.recording.recorder import Recorder
from sessions.shards.hashing import shard_of

logger = structlog.stdlib.get_logger(__name__)

FLUSH_SECONDS = 20.0
RELEASE_SECONDS = 5.0  # longest wait for a slow database before shards are handed over


class RecorderDied(RuntimeError):
    """The recorder's thread ended by an error that is not the database's."""


class ActiveManager:
    """Lives while this process has its slot; create it in the event loop, and `close` it.

    Args:
        nodes: addresses of the broker; more than one for a cluster.
        credentials: user and password of the broker.
        rng: spreads reconnections.
        health: receives the outcome of steps in the database.
        connected: is set while a connection serves.
        membership: of the process, which has a slot.
    """

    def __init__(
        self,
        nodes: tuple[BrokerAddress, ...],
        credentials: tuple[str, str],
        rng: random.Random,
        health: ManagerHealth,
        connected: asyncio.Event,
        membership: Membership,
    ) -> None:
        self._failover = Failover(nodes, rng)
        self._credentials = credentials
        self._connected = connected
        self._connection: BrokerConnection | None = None
        self._ending = False
        self._slot = membership.slot
        self._ownership = ownership = membership.ownership
        self._forgets = len(ownership.slots) > 1
        self._forgetting: set[asyncio.Task[None]] = set()
        self._prepared: tuple[int, ...] = ()
        self._loop = loop = asyncio.get_running_loop()
        self.recorder = Recorder(self._request_states, ownership=ownership)
        due, received = asyncio.Event(), asyncio.Event()
        intake = Intake(self.recorder, time.time, wake_signals=received.set, wake_scheduler=due.set)
        self._work = Work(
            recorder=self.recorder,
            ownership=ownership,
            ingest=intake,
            gate=IntakeGate(intake, ownership, time.time),
            scheduler=Scheduler(ownership),
            return_to_dock=ReturnToDock(ownership),
            presence=PresenceWriter(ownership),
            thread=DatabaseThread("scheduler", health, ownership.fenced),
            health=health,
            disk=DiskWatch(DiskSpace(settings.VAR_DIR, settings.DISK_LOW_MB)),
            due=due,
            received=received,
        )
        self.recorder.start()
        self._serving = loop.create_task(self._serve_for_ever())

    def check(self) -> None:
        """Raise the error that has ended this manager's work, if one has.

        Raises:
            RecorderDied: the recorder's thread has ended.
        """
        if not self.recorder.is_alive:
            raise RecorderDied
        if self._serving.done():
            self._serving.result()

    def report(self) -> dict[str, Any]:
        """Return the state of this process; `prepared`: the slots of its last subscription."""
        if self._connection is not None:
            self._prepared = self._connection.prepared
        return {
            "connected": self._connected.is_set(),
            "prepared": list(self._prepared),
            "waiting": self.recorder.waiting,
            "counts": dict(self.recorder.counts),
            "refused": dict(self.recorder.refused),
            "rejected": dict(self._work.ingest.counts),
        }

    def wake(self) -> None:
        """Run the scheduler at once: our share of the robots has changed."""
        self._work.due.set()

    async def release(self, shards: frozenset[int]) -> None:
        """Return when everything received of these shards' robots is written."""
        await self._work.thread.run(tuple)  # a running tick ends first
        written = asyncio.Event()
        done = functools.partial(self._loop.call_soon_threadsafe, written.set)
        self.recorder.put(ReleaseItem(lambda robot: shard_of(robot) in shards, done))
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(RELEASE_SECONDS):
                await written.wait()

    def forget_departed(self, slots: Collection[int]) -> None:
        """Discard the broker's queues of slots that were left."""
        for slot in slots if self._ownership.owns_site else ():
            task = self._loop.create_task(self._forget(slot))
            self._forgetting.add(task)
            task.add_done_callback(self._forgetting.discard)

    async def _forget(self, slot: int) -> None:
        try:
            identifier = server_client_id("session-manager", slot)
            async with self._failover.client(self._credentials, identifier):
                logger.info("broker_session_forgotten", slot=slot)
        except aiomqtt.MqttError as error:
            logger.info("broker_session_kept", slot=slot, reason=str(error))

    async def close(self) -> None:
        """Disconnect, and write the rest of the record."""
        self._ending = True
        await cancel(self._serving)
        for task in list(self._forgetting):
            await cancel(task)
        if not await asyncio.to_thread(self.recorder.stop, FLUSH_SECONDS):
            logger.error("record_not_finished", counts=dict(self.recorder.counts))
        self._work.disk.close()
        await self._work.thread.close()
        counts = self.recorder.counts + self._work.ingest.counts
        logger.info("session_manager_stopped", counts=dict(counts))

    async def _serve_for_ever(self) -> None:
        while not self._ending:  # disconnecting from a lost broker hides a cancellation
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
        if self._forgets:
            await self._forget(self._slot)
            self._forgets = False
        async with self._failover.client(
            self._credentials,
            server_client_id("session-manager", self._slot),
            self._work.gate.receive,
            clean_session=False,
        ) as client:
            read_quickly(client)
            connection = BrokerConnection(
                client, self._work, time.time, frequent_qos=0 if self._failover.has_nodes else 1
            )
            await connection.begin()
            self._connected.set()
            node = self._failover.node
            logger.info("session_manager_connected", host=node.host, port=node.port)
            self._connection = connection
            try:
                await connection.serve()
            finally:
                self._connection = None

    def _request_states(self, robot: str, boot: str, first: int, last: int) -> None:
        """Request lost states. In the recorder's thread."""
        if (connection := self._connection) is not None:
            self._loop.call_soon_threadsafe(connection.ask_again, robot, boot, first, last)
