"""The session manager: the one process that owns time.

Its event loop carries messages and never waits for anything else. Three threads wait: the recorder
writes the record, the scheduler looks at sessions, presence and signals, and a third keeps the beat
that makes this process the only one. The connection to the broker is a persistent session at QoS 1,
so that what robots say while this process restarts is delivered afterwards; what is missing even
then is asked for again by its number (sessions/recording/sequence_tracker.py).

A lease that the broker has kept from before a crash permits nothing (robots act only on a fresh
copy) and is replaced at start-up.

`run` is a supervisor: whatever goes wrong with broker or database it reports and starts over. It
ends when it is told to, or with an error when its recorder has died, for then nothing would be
recorded any more.
"""

import asyncio
import functools
import itertools
import logging
import os
import random
import secrets
import socket
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import aiomqtt
from django.conf import settings
from django.db import DatabaseError, InterfaceError, connection
from django.utils import timezone

from robots.api import codec, messages, topics
from robots.api.disk_space import DiskSpace, DiskState
from robots.bridge import broker_address
from robots.bridge.inbox import Inbox
from robots.bridge.quick_reading import read_quickly
from robots.cancellation import cancel
from robots.enrol.credentials import server_client_id
from robots.presence import PresenceWriter
from sessions import signals, system_log
from sessions.leases.transitions import Link
from sessions.manager import notices
from sessions.manager.desired_state import DesiredState
from sessions.manager.dispatch import send_all
from sessions.manager.health import Fault, ManagerHealth, is_disk_full
from sessions.manager.ingest import Intake, filters
from sessions.manager.leadership import HEARTBEAT_INTERVAL_S, WAIT_SECONDS, beat, give_back
from sessions.manager.lock_file import LockFile
from sessions.manager.return_to_dock import ReturnToDock
from sessions.manager.robot_liveness import PEER
from sessions.manager.scheduler import ManagerMessage, Scheduler, send
from sessions.manager.task_group import until_one_ends
from sessions.models import Session
from sessions.recording.items import CloseItem
from sessions.recording.recorder import Recorder

logger = logging.getLogger(__name__)

IDENTIFIER = "session-manager"
POLL_INTERVAL_S = 0.5
HEARTBEAT_SECONDS = 0.5
STATUS_SECONDS = 0.5
HEALTH_SECONDS = 0.1  # between two looks at what the status would be: a fault is told at once
GATHER_SECONDS = 0.04
TOGETHER = 200  # letters on their way to the broker at once, of the thousand that a client keeps
FLUSH_SECONDS = 20.0


class RecorderDied(RuntimeError):
    """The recorder's thread ended by an error that is not the database's."""


class SessionManager:
    """Runs until `stop` is called.

    Args:
        url: the broker's address.
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
        self._address = broker_address.parse(url)
        self._credentials = credentials
        self._rng = rng
        self._clock = clock
        self.holder = f"{socket.gethostname()}:{os.getpid()}:{secrets.token_hex(4)}"
        self._life = LockFile(settings.VAR_DIR / "session-manager.lock")
        self.recorder: Recorder | None = None
        self.connected = asyncio.Event()
        self._stopping = asyncio.Event()
        self._pressing = asyncio.Event()
        self._fresh = asyncio.Event()
        self._asking: set[asyncio.Task[None]] = set()
        self._health = ManagerHealth()
        self._disk = DiskSpace(settings.VAR_DIR, settings.DISK_LOW_MB)
        self._disk_state: DiskState = "ok"
        self._scheduler_thread = ThreadPoolExecutor(1, "scheduler")
        self._heartbeat_thread = ThreadPoolExecutor(1, "beat")
        self._disk_watch = ThreadPoolExecutor(1, "disk")

    def stop(self) -> None:
        """Have `run` write what is there and return."""
        self._stopping.set()

    async def run(self) -> None:
        """Wait until no other session manager runs, then be it; and again, when another has taken
        over.

        Raises:
            RecorderDied: nothing is recorded any more.
        """
        waits = False
        try:
            while not self._stopping.is_set():
                if await self._in_heartbeat_thread(self._heartbeat):
                    await self._be_the_one()
                else:
                    if not waits:
                        logger.info("session_manager_waits holder=%s", self.holder)
                        waits = True
                    await self._pause(WAIT_SECONDS)
        finally:
            await self._in_heartbeat_thread(give_back, self.holder)
            self._life.release()
            for pool in (self._scheduler_thread, self._heartbeat_thread):
                pool.submit(connection.close)
                pool.shutdown()
            self._disk_watch.shutdown(wait=False)

    async def _be_the_one(self) -> None:
        self._scheduler = Scheduler()
        self._return_to_dock = ReturnToDock()
        self._presence = PresenceWriter()
        self._loop = asyncio.get_running_loop()
        self.recorder = Recorder(
            functools.partial(self._loop.call_soon_threadsafe, self._ask_again), clock=self._clock
        )
        self._ingest = Intake(
            self.recorder,
            self._clock,
            wake_signals=self._fresh.set,
            wake_scheduler=self._pressing.set,
        )
        self.recorder.start()
        logger.info("session_manager_started holder=%s", self.holder)
        self._serving = True
        serving = asyncio.create_task(self._serve_for_ever())
        try:
            await self._keep_heartbeat(serving)
        finally:
            self._serving = False
            await cancel(serving)
            if not await asyncio.to_thread(self.recorder.stop, FLUSH_SECONDS):
                logger.error("record_not_finished counts=%s", dict(self.recorder.counts))
            logger.info(
                "session_manager_stopped counts=%s",
                dict(self.recorder.counts + self._ingest.counts),
            )

    async def _keep_heartbeat(self, serving: "asyncio.Task[None]") -> None:
        """Return when this process is to stop, or is not the one any more."""
        assert self.recorder is not None
        while not self._stopping.is_set():
            if not await self._in_heartbeat_thread(self._heartbeat, self.report()):
                logger.error("session_manager_replaced holder=%s", self.holder)
                return
            if not self.recorder.is_alive:
                raise RecorderDied
            if serving.done():
                serving.result()
            await self._pause(HEARTBEAT_INTERVAL_S)

    def report(self) -> dict[str, Any]:
        """Return how this process does, in words that hold nothing personal."""
        assert self.recorder is not None
        return {
            "connected": self.connected.is_set(),
            "waiting": self.recorder.waiting,
            "counts": dict(self.recorder.counts),
            "refused": dict(self.recorder.refused),
            "rejected": dict(self._ingest.counts),
        }

    def _heartbeat(self, report: dict[str, Any] | None = None) -> bool:
        ours = beat(self.holder, timezone.now(), report, dead=self._life.predecessor())
        if ours:
            self._life.sign(self.holder)
        return ours

    async def _in_heartbeat_thread(self, step: Callable[..., Any], *arguments: Any) -> Any:
        """Do something with the beat's row; True when the database is away, for then nobody can
        take it either.
        """
        try:
            return await self._in_thread(self._heartbeat_thread, step, *arguments)
        except (DatabaseError, InterfaceError) as error:
            self._health.refused(error, time.monotonic())
            logger.warning("session_manager_beat_missed reason=%s", error)
            return self.recorder is not None

    async def _in_thread(
        self, pool: ThreadPoolExecutor, step: Callable[..., Any], *arguments: Any
    ) -> Any:
        return await asyncio.get_running_loop().run_in_executor(
            pool, functools.partial(self._watched, step, *arguments)
        )

    def _watched(self, step: Callable[..., Any], *arguments: Any) -> Any:
        """In a thread of ours; what waits for the thread does not wait for the database."""
        asked = object()
        self._health.begun(asked, time.monotonic())
        try:
            return _with_fresh_connection(step, *arguments)
        finally:
            self._health.ended(asked, time.monotonic())

    async def _pause(self, seconds: float) -> None:
        try:
            async with asyncio.timeout(seconds):
                await self._stopping.wait()
        except TimeoutError:
            return

    # --- the broker -------------------------------------------------------------------------------

    async def _serve_for_ever(self) -> None:
        attempt = 0
        while self._serving:  # leaving a lost broker turns a cancellation into an MqttError
            try:
                await self._serve()
            except aiomqtt.MqttError as error:
                logger.warning("session_manager_offline attempt=%d reason=%s", attempt, error)
            except (DatabaseError, InterfaceError) as error:
                logger.warning(
                    "session_manager_without_database attempt=%d reason=%s", attempt, error
                )
            attempt = 0 if self.connected.is_set() else attempt + 1
            self.connected.clear()
            if self._serving:
                await asyncio.sleep(broker_address.backoff(attempt, self._rng.random()))

    async def _serve(self) -> None:
        """Serve one connection, until it is lost."""
        inbox = functools.partial(Inbox, self._ingest.receive)
        async with broker_address.client(
            self._address,
            self._credentials,
            server_client_id("session-manager"),
            inbox,
            clean_session=False,
        ) as client:
            read_quickly(client)
            client.pending_calls_threshold = 2 * TOGETHER
            self._client = client
            self._since = self._clock()
            broker_address.check_subscribed(await client.subscribe(filters()))
            await self._in_thread(self._scheduler_thread, self._scheduler.begin)
            self._standing = DesiredState()
            self.connected.set()
            logger.info(
                "session_manager_connected host=%s port=%d", self._address.host, self._address.port
            )
            await until_one_ends(
                self._tick_for_ever(),
                self._heartbeat_for_ever(),
                self._signal_for_ever(),
                self._publish_status_for_ever(),
                self._watch_disk_for_ever(),
                _end_of(client),
            )

    # --- what goes on while connected -------------------------------------------------------------

    async def _tick_for_ever(self) -> None:
        while True:
            self._pressing.clear()
            await self._tick_once()
            await self._renew()
            try:
                async with asyncio.timeout(POLL_INTERVAL_S):
                    await self._pressing.wait()
            except TimeoutError:
                continue

    async def _tick_once(self) -> None:
        assert self.recorder is not None
        for item in await self._try(self._tick) or ():
            self.recorder.put(item)

    async def _renew(self) -> None:
        """Publish leases before all that a look has found, and the rest after them."""
        published: bool | None = True
        while published:
            published = await self._try(self._scheduler.renew, timezone.now())
            await self._deliver()

    async def _try(self, step: Callable[..., Any], *arguments: Any) -> Any:
        """Do a step of the scheduler; None when the database did not let it, which the next tick
        does again.
        """
        try:
            return await self._in_thread(self._scheduler_thread, step, *arguments)
        except (DatabaseError, InterfaceError) as error:
            self._health.refused(error, time.monotonic())
            logger.warning("session_manager_looks_again reason=%s", error)
            return None

    def _tick(self) -> list[CloseItem]:
        """In the scheduler's thread: first who is there, then what time does."""
        now = timezone.now()
        for news in self._ingest.presence_news():
            change = self._presence.take(news.robot, news.message, now, retained=news.retained)
            if change is not None:
                system_log.log(
                    "robot_online" if change.online else "robot_offline",
                    robot=change.robot,
                    at=now,
                    state=change.state,
                )
                send(signals.presence_changed, robot=change.robot, online=change.online, at=now)
        send(signals.looked, now=now)
        self._scheduler.outbox.extend(
            ManagerMessage(topic, payload) for topic, payload in notices.drain()
        )
        links = {
            robot: last_received.link(self._since, self._ingest.signs)
            for robot, last_received in list(self._ingest.last_received.items())
        }
        closing = self._scheduler.tick(links, Link(since=self._since), now)
        self._scheduler.outbox.extend(self._standing.tick(now))
        self._scheduler.outbox.extend(
            self._return_to_dock.tick(dict(self._ingest.last_received), now)
        )
        return closing

    async def _deliver(self) -> None:
        """Publish what has gathered, in order; a letter leaves the box only when the broker has it.

        Nobody waits for the letter before: the last of many leases would be a second old, and its
        session over by then.
        """
        while outbound_messages := list(itertools.islice(self._scheduler.outbox, TOGETHER)):
            for outcome in await asyncio.gather(
                *map(self._publish, outbound_messages), return_exceptions=True
            ):
                if outcome is not None:
                    raise outcome

    async def _publish(self, outbound: ManagerMessage) -> None:
        await self._client.publish(outbound.topic, outbound.payload, qos=1, retain=outbound.retain)
        self._scheduler.outbox.remove(outbound)

    async def _heartbeat_for_ever(self) -> None:
        while True:
            for robot, last_received in list(self._ingest.last_received.items()):
                if last_received.is_present(self._clock()):
                    last_received.beats += 1
                    message = messages.CommandHeartbeat(
                        n=last_received.beats, stamp=self._clock(), peer=PEER
                    )
                    await self._client.publish(
                        topics.of(robot, "command/heartbeat"), codec.encode(message)
                    )
            await asyncio.sleep(HEARTBEAT_SECONDS)

    async def _publish_status_for_ever(self) -> None:
        """Say that this process lives and what it lacks; from the loop, which neither database nor
        disk holds up.
        """
        told, faults = -STATUS_SECONDS, self._faults()
        while True:
            before, faults, now = faults, self._faults(), time.monotonic()
            if faults != before or now - told >= STATUS_SECONDS:
                told = now
                await self._client.publish(
                    topics.MANAGER_STATUS,
                    codec.encode(messages.ManagerStatus(stamp=self._clock(), faults=faults)),
                )
            await asyncio.sleep(HEALTH_SECONDS)

    async def _watch_disk_for_ever(self) -> None:
        """In a thread of its own: a disk that dies may never answer."""
        while True:
            self._disk_state = await asyncio.get_running_loop().run_in_executor(
                self._disk_watch, self._disk.state
            )
            await asyncio.sleep(POLL_INTERVAL_S)

    def _faults(self) -> tuple[Fault, ...]:
        return self._health.faults(time.monotonic(), self._disk_state)

    async def _signal_for_ever(self) -> None:
        while True:
            await self._fresh.wait()
            await asyncio.sleep(GATHER_SECONDS)  # many robots' states go to the thread together
            self._fresh.clear()
            items = self._ingest.fresh()
            if any(
                signal.has_listeners(Session)
                for signal in (
                    signals.state_received,
                    signals.state_recovered,
                    signals.message_received,
                )
            ):
                offsets = {
                    robot: last_received.offset.seconds
                    for robot, last_received in list(self._ingest.last_received.items())
                }
                await self._in_thread(self._scheduler_thread, send_all, items, offsets)
                if notices.are_waiting():
                    self._pressing.set()

    def _ask_again(self, robot: str, boot: str, first: int, last: int) -> None:
        """Ask an agent for states; unanswered it is asked again, so that nothing has to be kept
        here.
        """
        if not self.connected.is_set():
            return
        action = messages.ResendStates(
            action_id=f"resend-{secrets.token_hex(8)}",
            stamp=self._clock(),
            role="server",
            user=IDENTIFIER,
            boot=boot,
            first=first,
            last=last,
        )
        asking = self._loop.create_task(
            self._publish_quietly(topics.of(robot, "command/action"), codec.encode(action))
        )
        self._asking.add(asking)
        asking.add_done_callback(self._asking.discard)
        logger.info(
            "states_asked_again robot=%s boot=%s first=%d last=%d", robot, boot, first, last
        )

    async def _publish_quietly(self, topic: str, payload: bytes) -> None:
        try:
            await self._client.publish(topic, payload, qos=1)
        except aiomqtt.MqttError as error:
            logger.info("states_not_asked reason=%s", error)


async def _end_of(client: aiomqtt.Client) -> None:
    """Return, or raise MqttError, when the connection ends; messages do not come this way (see
    robots/bridge/inbox.py).
    """
    async for _ in client.messages:
        pass


def _with_fresh_connection(step: Callable[..., Any], *arguments: Any) -> Any:
    """Run a step in its thread; after a database error the thread's connection is not trusted any
    more.

    Unless the disk is full: then SQLite could not open another one, for which it needs room.
    """
    try:
        return step(*arguments)
    except (DatabaseError, InterfaceError) as error:
        if not is_disk_full(error):
            connection.close()
        raise
