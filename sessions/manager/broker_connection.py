"""The session manager's work while it is connected to the broker.

The connection is a persistent session at QoS 1, so that messages of robots are delivered even if
this process restarts (by a cluster: only rare messages). States that are still missing are
requested by their numbers (sessions/recording/sequence_tracker.py).

A retained lease from before a crash permits nothing (robots act only on a fresh copy) and is
replaced after connecting.
"""

import asyncio
import datetime
import itertools
import secrets
import time
from collections import defaultdict, deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TypeVar

import aiomqtt
import structlog
from django.db import DatabaseError, InterfaceError, transaction
from django.utils import timezone

from robots.api import codec, messages, topics
from robots.api.bucket import Bucket
from robots.bridge import broker_address
from robots.models import Robot
from robots.presence.writer import PresenceWriter
from robots.process.cancellation import until_one_ends
from sessions import signals, system_log
from sessions.leases.transitions import RobotLink
from sessions.manager import notices
from sessions.manager.database_thread import DatabaseThread
from sessions.manager.desired_state import DesiredState
from sessions.manager.disk_watch import DiskWatch
from sessions.manager.dispatch import send_all
from sessions.manager.health import Fault, ManagerHealth
from sessions.manager.ingest import Intake, PresenceNews, filters
from sessions.manager.intake_gate import IntakeGate
from sessions.manager.return_to_dock import ReturnToDock
from sessions.manager.robot_liveness import PEER
from sessions.manager.scheduler import (
    ManagerMessage,
    Scheduler,
    needed_robots,
    notice_message,
    send,
)
from sessions.models import Session, SystemLog
from sessions.recording.builder import LOGGED_RATE
from sessions.recording.items import CloseItem
from sessions.recording.recorder import Recorder
from sessions.shards.ownership import Ownership

logger = structlog.stdlib.get_logger(__name__)

Filter = TypeVar("Filter", str, tuple[str, int])

IDENTIFIER = "session-manager"
POLL_INTERVAL_S = 0.5
HEARTBEAT_SECONDS = 0.5
STATUS_SECONDS = 0.5
HEALTH_SECONDS = 0.1  # between two checks for faults, which are published at once
GATHER_SECONDS = 0.04
STEP_SECONDS = 1.0  # by which the clock may change between two ticks, as NTP slews it
MAX_FILTERS = 50  # of one packet; some brokers limit it
# A cluster creates a replicated queue for each filter, the first time.
SUBSCRIBE_SECONDS = 30.0
TOGETHER = 200  # messages in flight to the broker, of the thousand that a client keeps


@dataclass(frozen=True)
class Work:
    """State that a session manager keeps from one connection to the next.

    `due` is set when the scheduler is to run at once, `received` when there are signals to send to
    the apps above.
    """

    ownership: Ownership
    recorder: Recorder
    ingest: Intake
    gate: IntakeGate
    scheduler: Scheduler
    return_to_dock: ReturnToDock
    presence: PresenceWriter
    thread: DatabaseThread
    health: ManagerHealth
    disk: DiskWatch
    due: asyncio.Event
    received: asyncio.Event


class BrokerConnection:
    """One connection, from its subscriptions to its loss.

    Args:
        client: connected.
        work: outlives the connection.
        clock: Unix seconds.
        frequent_qos: of subscriptions to frequent messages (see ingest.filters).
    """

    def __init__(
        self,
        client: aiomqtt.Client,
        work: Work,
        clock: Callable[[], float],
        frequent_qos: int = 1,
    ) -> None:
        self._client = client
        self._work = work
        self._clock = clock
        self._frequent_qos = frequent_qos
        self._since = clock()
        self._shift = self._since - time.monotonic()  # from monotonic to Unix seconds
        self._desired_state = DesiredState(work.ownership)
        self._subscribed: set[tuple[str, int]] = set()
        self.prepared: tuple[int, ...] = ()  # the slots by whose division we have subscribed
        self._asking: set[asyncio.Task[None]] = set()
        self._needed: frozenset[str] = frozenset()
        # of each robot, for entries of the system log
        self._log_allowances: dict[str, Bucket] = defaultdict(lambda: Bucket(*LOGGED_RATE))

    async def begin(self) -> None:
        """Subscribe, and schedule every lease for publishing."""
        self._client.pending_calls_threshold = 2 * TOGETHER
        await self._subscribe()
        if self._work.ownership.was_shared:
            # The broker may still have subscriptions of another division.
            kept = await self._work.thread.run(_every_topic) - dict(self._subscribed).keys()
            await self._unsubscribe(kept)
        await self._work.thread.run(self._work.scheduler.begin)

    async def _subscribe(self) -> None:
        """Subscribe to our share of the robots, and to no others."""
        ownership = self._work.ownership
        slots = ownership.slots
        if ownership.is_whole:
            wanted = filters(frequent_qos=self._frequent_qos)
        else:
            names = await self._work.thread.run(_names_of, ownership.wants)
            wanted = filters(names, frequent_qos=self._frequent_qos)
        for packet in packets_of(wanted - self._subscribed):
            granted = await self._client.subscribe(packet, timeout=SUBSCRIBE_SECONDS)
            broker_address.check_subscribed(granted)
        await self._unsubscribe(dict(self._subscribed).keys() - dict(wanted).keys())
        self._subscribed = wanted
        self.prepared = slots

    async def _unsubscribe(self, stale: set[str]) -> None:
        for packet in packets_of(stale):
            await self._client.unsubscribe(packet)

    async def serve(self) -> None:
        """Run all loops of the connection, until it is lost."""
        await until_one_ends(
            self._tick_for_ever(),
            self._heartbeat_for_ever(),
            self._signal_for_ever(),
            self._publish_status_for_ever(),
            broker_address.until_lost(self._client),
        )

    # --- the scheduler ----------------------------------------------------------------------------

    async def _tick_for_ever(self) -> None:
        while True:
            self._work.due.clear()
            self._work.gate.follow()
            await self._subscribe()
            for item in await self._work.thread.attempt(self._tick) or ():
                self._work.recorder.put(item)
            await self._renew()
            try:
                async with asyncio.timeout(POLL_INTERVAL_S):
                    await self._work.due.wait()
            except TimeoutError:
                continue

    async def _renew(self) -> None:
        """Publish leases, and after them the messages of a tick."""
        scheduler, published = self._work.scheduler, True
        while published and self._may_act():
            published = await self._work.thread.attempt(scheduler.renew, timezone.now())
            await publish_all(scheduler.outbox, self._client, self._may_act)

    def _may_act(self) -> bool:
        return self._work.ownership.is_confirmed

    def _tick(self) -> list[CloseItem]:
        """Update presence, then the sessions. In the scheduler's thread."""
        now, work = timezone.now(), self._work
        if not self._may_act():  # this process has just resumed after a stop
            return []
        work.presence.follow_ownership(now)
        self._needed = needed_robots()
        self._take_presence(now)
        send(signals.ticked, now=now, ownership=work.ownership)
        work.scheduler.outbox.extend(map(notice_message, notices.drain()))
        robots = dict(work.ingest.liveness)
        self._follow_clock()
        links = {
            name: robots[name].link(self._since, work.ingest.signs, shift=self._shift)
            for name in self._needed & robots.keys()
        }
        closing = work.scheduler.tick(links, RobotLink(since=self._since), now)
        work.scheduler.outbox.extend(self._desired_state.tick(now))
        work.scheduler.outbox.extend(work.return_to_dock.tick(robots, now, time.monotonic()))
        return closing

    def _follow_clock(self) -> None:
        """Restart all deadlines when the server's clock has jumped: times in the database from
        before the jump no longer tell how long ago something happened.
        """
        before, self._shift = self._shift, self._clock() - time.monotonic()
        if abs(self._shift - before) > STEP_SECONDS:
            self._since = self._work.scheduler.stepped_at = self._clock()
            logger.warning("clock_stepped", seconds=round(self._shift - before, 3))

    def _take_presence(self, now: datetime.datetime) -> None:
        """Store the robots' presence. News that the database did not take are repeated, because the
        next state of an idle robot is half a minute away.
        """
        news = [
            one for one in self._work.ingest.presence_news() if self._work.ownership.owns(one.robot)
        ]
        for first in range(0, max(len(news), 1), TOGETHER):
            together = news[first : first + TOGETHER]
            entries: list[SystemLog] = []
            try:
                with transaction.atomic():  # after a broker's restart thousands reconnect
                    self._store_presence(together, now, entries)
            except (DatabaseError, InterfaceError):
                for entry in entries:  # of news that is repeated
                    self._log_allowances[entry.robot.name].level += 1.0
                self._work.presence.forget({one.robot for one in news[first:]})
                self._work.ingest.repeat_news(news[first:])
                raise

    def _store_presence(
        self, news: list[PresenceNews], now: datetime.datetime, entries: list[SystemLog]
    ) -> None:
        """Store news, and add its entries of the system log to `entries`."""
        presence = self._work.presence
        presence.read({one.robot for one in news}, now)
        for one in news:
            row = presence.take(one.robot, one.message, now, retained=one.retained)
            if row is not None and self._log_allowances[row.robot.name].spend(now.timestamp()):
                event = "robot_online" if row.connection == "ONLINE" else "robot_offline"
                # Written now, because the next news changes the row.
                entries.append(
                    system_log.entry(event, robot=row.robot, at=now, state=row.connection)
                )
        presence.write(now)
        with self._work.ownership.about(*(entry.robot.name for entry in entries)):
            SystemLog.objects.bulk_create(entries)

    # --- heartbeats and status --------------------------------------------------------------------

    async def _heartbeat_for_ever(self) -> None:
        """Beat for robots that are needed, and for others that are awake, to know their clocks."""
        due = time.monotonic()
        while True:
            needed, now = self._needed, time.monotonic()
            for robot, liveness in list(self._work.ingest.liveness.items()):
                is_due = liveness.is_awake(now) or (robot in needed and liveness.is_present(now))
                if is_due and self._work.ownership.owns(robot):
                    liveness.beats += 1
                    message = messages.CommandHeartbeat(
                        n=liveness.beats, stamp=self._clock(), peer=PEER, needed=robot in needed
                    )
                    await self._client.publish(
                        topics.of(robot, "command/heartbeat"), codec.encode(message)
                    )
            # A robot cancels the server's actions when it misses these beats.
            due = max(due + HEARTBEAT_SECONDS, time.monotonic())
            await asyncio.sleep(due - time.monotonic())

    async def _publish_status_for_ever(self) -> None:
        """Publish faults of the site, from the loop: database and disk may block their threads."""
        published_at, faults = -STATUS_SECONDS, self._faults()
        while True:
            before, faults, now = faults, self._faults(), time.monotonic()
            due = faults != before or now - published_at >= STATUS_SECONDS
            if due and self._work.ownership.owns_site:
                published_at = now
                await self._client.publish(
                    topics.MANAGER_STATUS,
                    codec.encode(messages.ManagerStatus(stamp=self._clock(), faults=faults)),
                )
            await asyncio.sleep(HEALTH_SECONDS)

    def _faults(self) -> tuple[Fault, ...]:
        return self._work.health.faults(time.monotonic(), self._work.disk.state)

    # --- signals and lost states ------------------------------------------------------------------

    async def _signal_for_ever(self) -> None:
        """Send the apps above the signals of what was received."""
        ingest = self._work.ingest
        while True:
            await self._work.received.wait()
            await asyncio.sleep(GATHER_SECONDS)  # many robots' states in one step of the thread
            self._work.received.clear()
            items = ingest.fresh()
            if any(signal.has_listeners(Session) for signal in signals.OF_SESSIONS):
                offsets = {
                    robot: liveness.offset.seconds
                    for robot, liveness in list(ingest.liveness.items())
                }
                await self._work.thread.run(send_all, items, offsets, self._work.ownership)
                if notices.are_waiting():
                    self._work.due.set()

    def ask_again(self, robot: str, boot: str, first: int, last: int) -> None:
        """Request states from an agent. The recorder repeats it until they come."""
        action = messages.ResendStates(
            action_id=f"resend-{secrets.token_hex(8)}",
            stamp=self._clock(),
            role="server",
            user=IDENTIFIER,
            boot=boot,
            first=first,
            last=last,
        )
        asking = asyncio.get_running_loop().create_task(
            self._publish_quietly(topics.of(robot, "command/action"), codec.encode(action))
        )
        self._asking.add(asking)
        asking.add_done_callback(self._asking.discard)
        logger.info("states_requested", robot=robot, boot=boot, first=first, last=last)

    async def _publish_quietly(self, topic: str, payload: bytes) -> None:
        try:
            await self._client.publish(topic, payload, qos=1)
        except aiomqtt.MqttError as error:
            logger.info("states_not_requested", reason=str(error))


def packets_of(filters_: set[Filter]) -> Iterator[list[Filter]]:
    """Yield filters in packets of a size that every broker takes."""
    in_order = sorted(filters_)
    for first in range(0, len(in_order), MAX_FILTERS):
        yield in_order[first : first + MAX_FILTERS]


def _names_of(is_wanted: Callable[[str], bool]) -> list[str]:
    """Return the names of our share of the robots. In the scheduler's thread."""
    return list(filter(is_wanted, Robot.objects.values_list("name", flat=True)))


def _every_topic() -> set[str]:
    """Return all possible topics of subscriptions. In the scheduler's thread."""
    return set(dict(filters(["+", *Robot.objects.values_list("name", flat=True)])))


async def publish_all(
    outbox: deque[ManagerMessage], client: aiomqtt.Client, may_act: Callable[[], bool]
) -> None:
    """Publish the outbox in order; a message leaves it only when the broker has it. None is
    published while this process may not act.

    Messages do not wait for the acknowledgement of the one before: the last of many leases would be
    a second old, and its session perhaps over.
    """

    async def publish(outbound: ManagerMessage) -> None:
        if not may_act():
            return
        await client.publish(outbound.topic, outbound.payload, qos=1, retain=outbound.retain)
        outbox.remove(outbound)

    while may_act() and (batch := list(itertools.islice(outbox, TOGETHER))):
        for outcome in await asyncio.gather(*map(publish, batch), return_exceptions=True):
            if outcome is not None:
                raise outcome
