"""The web process's one connection to the broker, which delivers messages to listeners.

A robot without pages is nearly silent (robots/api/idle.py). While a page of a robot is open, this
process sends the robot a heartbeat once a second, the first one at once.

Everything runs on the loop that first called `current()`: the first page, because daphne does not
report its start. A robot's topics are subscribed while it has a listener in this process: a message
takes about 0.25 ms of CPU even without one, and a robot sends some thirty a second, so that a
hundred idle robots would fill most of a core.

No message is queued while the broker is away: a late command is worse than a lost one. `send`
returns False, and its caller informs the page. Two kinds of message are kept, within bounds: a
stop, for 3 s at most, because it is right at any age, and reports for the record.

Longer than most files, because connecting, listening and publishing share the one connection.
"""

import asyncio
import collections
import contextlib
import contextvars
import functools
import random
import secrets
import time
from collections.abc import Callable, Coroutine, Iterable
from dataclasses import dataclass
from typing import Any

import aiomqtt
import structlog
from django.conf import settings
from prometheus_client import Histogram

from robots.api import codec, topics
from robots.api.errors import Rejection
from robots.api.idle import WATCHER
from robots.api.messages import Action, CommandHeartbeat, Lease, Message
from robots.bridge import broker_address
from robots.bridge.delivery import LINK, Delivery, Listener, ReceivedMessage
from robots.bridge.failover import Failover, parse_nodes
from robots.bridge.known import KnownRobot
from robots.bridge.quick_reading import read_quickly
from robots.bridge.quick_writing import QuickWriter, writer_of
from robots.enrol.credentials import server_credentials
from robots.process.cancellation import cancel

log = structlog.stdlib.get_logger(__name__)

# The suffixes that pages listen to: not photos and the floor plan, which are large.
LISTENED = tuple(
    topic.suffix
    for topic in topics.TABLE
    if topic.suffix == "lease" or (topic.direction == "from_robot" and topic.suffix != "photo/+")
)
STOP_SECONDS, STOP_AGAIN_SECONDS = 3.0, 0.1
MAX_IN_FLIGHT = 500
WATCH_SECONDS = 0.2
SUBSCRIBE_AGAIN_SECONDS = 1.0
# Bytes read at a time, some ten messages: between two pieces, frames are sent to pages.
PIECE = 4096
# Queued, and in flight: a queue of reports must not delay a stop.
MAX_REPORTS, REPORTS_IN_FLIGHT = 2000, 100
# From the publishing of a message to its writing, at QoS 1 to the broker's acknowledgement.
BUCKETS = (0.001, 0.0025, 0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 1.0)
SEND_SECONDS = Histogram(
    "telepresence_relay_to_robot_seconds",
    "Time from a page's message to the broker.",
    buckets=BUCKETS,
)


@dataclass(frozen=True)
class _Stop:
    """A stop that the broker has not confirmed, repeated until `deadline` (monotonic seconds)."""

    topic: str
    payload: bytes
    deadline: float


class Bridge:
    """One MQTT connection that reconnects for ever. All methods are called on its loop.

    Args:
        url: the broker's (robots/bridge/broker_address.py); several nodes are comma-separated.
        credentials: (user, password) unless the URL names them.
        rng: spreads reconnections; seeded in tests.
    """

    def __init__(self, url: str, credentials: tuple[str, str], rng: random.Random) -> None:
        self._failover = Failover(parse_nodes(url), rng)
        self._credentials = credentials
        self._delivery = Delivery()
        self.follow = self._delivery.follow
        self.unfollow = self._delivery.unfollow
        self._client: aiomqtt.Client | None = None
        self._writer: QuickWriter | None = None
        self._in_flight: set[asyncio.Task[Any]] = set()
        # those of them whose packet the client does not have yet
        self._not_started: set[asyncio.Task[Any]] = set()
        self._stops: collections.deque[_Stop] = collections.deque(maxlen=MAX_IN_FLIGHT)
        self._reports: collections.deque[tuple[str, bytes]] = collections.deque()
        self.counts: collections.Counter[str] = collections.Counter()
        self._loop = asyncio.get_running_loop()
        self._up = asyncio.Event()
        self._closed = False
        # In contexts of their own: the context of the first request ends with it, and would be
        # inherited by the handling of all messages.
        self._task = self._loop.create_task(self._run(), context=contextvars.Context())
        self._watching = self._loop.create_task(self._watch(), context=contextvars.Context())

    # --- the connection ---------------------------------------------------------------------------

    @property
    def connected(self) -> bool:
        """Tell whether the broker is connected and has our subscriptions."""
        return self._up.is_set() and not (self._task.done() or self._watching.done())

    async def wait_connected(self, seconds: float) -> bool:
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(seconds):
                await self._up.wait()
        return self.connected

    def serves(self, loop: asyncio.AbstractEventLoop) -> bool:
        """Tell whether pages of `loop` use this bridge."""
        return self._loop is loop and not self._closed

    async def close(self) -> None:
        self._closed = True
        await cancel(self._task, self._watching)

    async def _run(self) -> None:
        while True:
            try:
                await self._serve()
            except aiomqtt.MqttError as error:
                log.warning("bridge_lost", attempt=self._failover.attempt, reason=str(error))
            except Exception:  # all pages of this process depend on this task
                log.exception("bridge_failed", attempt=self._failover.attempt)
            was_up = self._up.is_set()
            self._up.clear()
            await asyncio.sleep(self._failover.ended(was_up=was_up))

    async def _watch(self) -> None:
        """Deliver the faults of the server to the listeners, regularly."""
        while True:
            await asyncio.sleep(WATCH_SECONDS)
            try:
                self._watch_once(time.monotonic())
            except Exception:  # without this task no page would learn of a fault
                log.exception("bridge_watch_failed")

    def _watch_once(self, now: float) -> None:
        if self._client is not None and self._delivery.watch.wants_probe(now):
            self._launch(functools.partial(self._probe, self._client))
        self._delivery.bring_faults(now)
        self._beat()

    async def _probe(self, client: aiomqtt.Client) -> None:
        await client.publish(topics.PROBE, b"", qos=1)
        if client is self._client:
            self._delivery.watch.answered()

    async def _serve(self) -> None:
        """Connect, subscribe for all listeners, and stay until the connection ends.

        Raises:
            MqttError: it was lost, refused or never established.
        """
        identifier = f"web-{secrets.token_hex(8)}"
        async with self._failover.client(self._credentials, identifier, self._receive) as client:
            client.pending_calls_threshold = MAX_IN_FLIGHT
            read_quickly(client, chunk=PIECE)
            self._client, self._writer = client, writer_of(client)
            try:
                filters = [
                    topics.session_notices("+"),
                    topics.MANAGER_STATUS,
                    *(each for robot in self._delivery.robots for each in _filters(robot)),
                ]
                await _subscribe(client, filters)
                self._arrive()
                await broker_address.until_lost(client)
            finally:
                self._depart()

    def _arrive(self) -> None:
        log.info("bridge_connected", host=self._failover.node.host, port=self._failover.node.port)
        self._up.set()
        self._delivery.watch.link_changed(time.monotonic(), up=True)
        stops = [stop for stop in self._stops if stop.deadline > time.monotonic()]
        self._stops.clear()
        for stop in stops:
            self._publish_stop(stop)
        self._send_reports()
        self._delivery.beat_again()
        self._beat()
        self._delivery.bring_everybody(ReceivedMessage(LINK, True))

    def _depart(self) -> None:
        self._client = self._writer = None
        for task in self._in_flight:
            task.cancel()
        self._delivery.lose_sight()
        self._delivery.watch.link_changed(time.monotonic(), up=False)
        if self._up.is_set():
            self._delivery.bring_everybody(ReceivedMessage(LINK, False))

    def _receive(self, message: aiomqtt.Message) -> None:
        self.counts["arrived"] += 1
        topic, payload = str(message.topic), message.payload
        raw = payload if isinstance(payload, bytes | bytearray) else str(payload or "").encode()
        try:
            self._delivery.arrive(topic, bytes(raw), time.monotonic())
        except Rejection as rejection:
            self.counts[rejection.reason] += 1
            count, reason = self.counts[rejection.reason], str(rejection)
            log.warning("bridge_message_rejected", topic=topic, reason=reason, count=count)

    # --- listening --------------------------------------------------------------------------------

    def listen(self, robot: str, listener: Listener, *, needs: bool = True) -> KnownRobot:
        """Deliver a robot's messages to a listener; return the robot's KnownRobot, which is kept up
        to date. While a listener `needs` the robot, it sends at its full rate.
        """
        first = self._delivery.listen(robot, listener, time.monotonic(), needs=needs)
        if first and self._client is not None:
            self._launch(functools.partial(self._subscribe, self._client, robot))
        self._beat()
        return self._delivery.known[robot]

    async def _subscribe(self, client: aiomqtt.Client, robot: str) -> None:
        """Subscribe to a robot; retry while a cluster refuses after the loss of a node."""
        while client is self._client and robot in self._delivery.robots:
            try:
                await _subscribe(client, _filters(robot))
            except aiomqtt.MqttError as error:
                log.warning("subscription_refused", robot=robot, reason=str(error))
                await asyncio.sleep(SUBSCRIBE_AGAIN_SECONDS)
            else:
                return

    def _beat(self) -> None:
        """Send the heartbeats that are due to robots that are needed."""
        if not self.connected:
            return
        for robot, count in self._delivery.beats_due(time.monotonic()):
            heartbeat = CommandHeartbeat(n=count, stamp=time.time(), peer=WATCHER)
            self.send(robot, "command/heartbeat", heartbeat)

    def ignore(self, robot: str, listener: Listener) -> None:
        """Stop delivering a robot's messages to a listener; without listeners, unsubscribe."""
        if self._delivery.ignore(robot, listener) and self._client is not None:
            self._launch(functools.partial(self._client.unsubscribe, _filters(robot)))

    # --- publishing -------------------------------------------------------------------------------

    def send(self, robot: str, suffix: str, message: Message) -> bool:
        """Publish a message to a robot; False when the broker is away or does not keep up."""
        line = topics.find(suffix)
        assert line is not None
        assert line.direction == "to_robot"
        return self._publish(topics.of(robot, suffix), codec.encode(message), qos=line.qos)

    def send_stop(self, robot: str, action: Action) -> None:
        """Publish a stop or an e-stop; until the broker confirms it, repeat it for 3 s at most."""
        topic, deadline = topics.of(robot, "command/action"), time.monotonic() + STOP_SECONDS
        self._publish_stop(_Stop(topic, codec.encode(action), deadline))

    def publish_lease(self, robot: str, lease: Lease | None) -> bool:
        """Publish a lease (None: no driver), and act on it here at once.

        It is not repeated for a restarted broker: only the database knows whether the lease is
        still valid, and the page of the session reads it there first.
        """
        self._delivery.note_lease(robot, lease, time.monotonic())
        payload = b"" if lease is None else codec.encode(lease)
        return self._publish(topics.of(robot, "lease"), payload, qos=1, retain=True)

    def publish_notice(self, session: str, frame: str) -> bool:
        """Publish a notice of a session for every web process and the session manager."""
        return self._publish(topics.session_notices(session), frame.encode(), qos=1)

    def report(self, topic: str, message: Message) -> None:
        """Publish a report for the record; queued, within bounds, while the broker is away."""
        if len(self._reports) >= MAX_REPORTS:
            self._reports.popleft()
            self.counts["report_dropped"] += 1
        self._reports.append((topic, codec.encode(message)))
        self._send_reports()

    def _send_reports(self) -> None:
        while (
            self.connected
            and self._client is not None
            and self._reports
            and len(self._in_flight) < REPORTS_IN_FLIGHT
        ):
            topic, payload = self._reports.popleft()
            back = functools.partial(self._reports.append, (topic, payload))
            self._launch(
                functools.partial(self._client.publish, topic, payload, qos=1), failed=back
            )

    def _publish(self, topic: str, payload: bytes, *, qos: int, retain: bool = False) -> bool:
        if self._client is None or len(self._in_flight) >= MAX_IN_FLIGHT:
            self.counts["unsent"] += 1
            return False
        # otherwise it would overtake earlier messages
        if qos == 0 and self._writer is not None and not self._not_started:
            began = time.monotonic()
            written = self._writer.publish(topic, payload)
            self.counts["sent" if written else "unsent"] += 1
            if written:
                SEND_SECONDS.observe(time.monotonic() - began)
            return written
        self._launch(
            functools.partial(self._client.publish, topic, payload, qos=qos, retain=retain)
        )
        return True

    def _publish_stop(self, stop: _Stop) -> None:
        if self._client is None:
            self._stops.append(stop)
            return
        self._launch(
            functools.partial(self._client.publish, stop.topic, stop.payload, qos=1),
            failed=functools.partial(self._stop_again, stop),
        )

    def _stop_again(self, stop: _Stop) -> None:
        if self._client is not None and time.monotonic() + STOP_AGAIN_SECONDS < stop.deadline:
            self._loop.call_later(STOP_AGAIN_SECONDS, self._publish_stop, stop)
        else:
            self._stops.append(stop)

    def _launch(
        self,
        exchange: Callable[[], Coroutine[Any, Any, Any]],
        failed: Callable[[], None] | None = None,
    ) -> None:
        """Start an exchange with the broker; packets are sent in the order of the calls. `failed`
        is called if it ends without the broker's confirmation.
        """
        task = self._loop.create_task(self._exchange(exchange))
        self._in_flight.add(task)
        self._not_started.add(task)
        task.add_done_callback(functools.partial(self._on_done, failed, time.monotonic()))

    async def _exchange(self, exchange: Callable[[], Coroutine[Any, Any, Any]]) -> None:
        task = asyncio.current_task()
        assert task is not None
        self._not_started.discard(task)  # the client takes the packet before its first wait
        await exchange()

    def _on_done(
        self, failed: Callable[[], None] | None, began: float, task: asyncio.Task[Any]
    ) -> None:
        self._in_flight.discard(task)
        self._not_started.discard(task)
        error = None if task.cancelled() else task.exception()
        if error is not None and not isinstance(error, aiomqtt.MqttError):
            raise error  # ours, and the loop logs it
        if error is not None or task.cancelled():
            self.counts["unconfirmed"] += 1
            log.info("bridge_unconfirmed", reason=error or "link_lost")
            if failed is not None:
                failed()
        else:
            self.counts["sent"] += 1
            SEND_SECONDS.observe(time.monotonic() - began)
        self._send_reports()


def _filters(robot: str) -> list[str]:
    return [topics.of(robot, suffix) for suffix in LISTENED]


async def _subscribe(client: aiomqtt.Client, filters: Iterable[str]) -> None:
    """Subscribe at QoS 0, for the reasons in topics.subscriptions; MqttError when refused."""
    broker_address.check_subscribed(await client.subscribe([(each, 0) for each in filters]))


# --- the bridge of this process -------------------------------------------------------------------


class _Process:
    bridge: Any = None


def current() -> Bridge:
    """Return the bridge of this process; the first call starts it on the running loop."""
    if _Process.bridge is None or not _Process.bridge.serves(asyncio.get_running_loop()):
        _Process.bridge = Bridge(settings.MQTT_URL, server_credentials("web"), random.Random())
    bridge: Bridge = _Process.bridge
    return bridge


def use(bridge: Any) -> None:
    """Replace the bridge by a double, or with None forget it (for tests)."""
    _Process.bridge = bridge
