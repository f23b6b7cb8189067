"""The embedded broker's mind: sessions, subscriptions, retained messages. No sockets, no clock, no
database.

A connection hands over what it read (connect, publish, subscribe, …) and is told what to write
through its `HubLink`. What it keeps to (OASIS MQTT 3.1.1): QoS 0 and 1 outwards and the lesser of a
message's and a subscription's; QoS 2 inwards, delivered once; retained messages; wills; persistent
sessions, which live as long as this process; a second connection of the same client takes over.
Beyond the standard: a session belongs to its user as well as to its client id, so that nobody can
take another one's over; nobody publishes or subscribes, nor leaves a will, past their permissions;
retained is what the topic table says is; everything that could grow has a bound. What waits for a
client and what it has not acknowledged count together, in messages and in the bytes of memory that
they take.
"""

import logging
from collections import deque
from dataclasses import dataclass, field
from typing import Any, Protocol

import structlog
from msgspec.structs import replace
from paho.mqtt.matcher import MQTTMatcher

from robots.api.topics import is_kept
from robots.broker import packets
from robots.broker.bounded_log import BoundedLog
from robots.broker.filters import is_filter, matches
from robots.broker.packets import Connect, ProtocolError, PublishPacket, Subscribe
from robots.broker.permissions import BrokerUser

logger = structlog.stdlib.get_logger(__name__)

WINDOW = 200  # QoS 1 messages sent and not yet acknowledged
MAX_UNRELEASED = 1_000  # QoS 2 messages that a client has not released
MESSAGE_BYTES = 300  # of memory that a waiting message takes besides its topic and payload
MAX_RETAINED = 10_000
MAX_FILTERS = 1_000  # of one session
MAX_LEFT_SESSIONS = 4  # persistent sessions of one user that nobody is connected to
KNOWN_ROUTES = 8_192
KNOWN_TOPICS = 1_000  # of one session


class HubLink(Protocol):
    """A connection as the hub sees it. `is_ready` is false while the other end reads too slowly."""

    is_ready: bool

    def write(self, data: bytes) -> None:
        """Send bytes."""

    def kick(self) -> None:
        """Close at once, without waiting for the other end."""


@dataclass(eq=False)
class MqttSession:
    """What the broker keeps of one client."""

    user: BrokerUser
    client_id: str
    clean: bool
    link: HubLink | None = None
    will: PublishPacket | None = None
    left_at: float = 0.0
    filters: dict[str, int] = field(default_factory=dict)
    inflight: dict[int, PublishPacket] = field(default_factory=dict)
    queue: deque[PublishPacket] = field(default_factory=deque)
    held_bytes: int = 0  # of queue and inflight
    dropped: int = 0
    received: set[int] = field(default_factory=set)  # QoS 2 messages between PUBLISH and PUBREL
    last_id: int = 0
    # topics that were found permitted, so that they need not be matched again
    permitted: set[str] = field(default_factory=set)

    def may_publish(self, topic: str) -> bool:
        """Tell whether this client may publish there."""
        if topic in self.permitted:
            return True
        if not self.user.permissions.may_publish(topic):
            return False
        if len(self.permitted) >= KNOWN_TOPICS:
            self.permitted.clear()
        self.permitted.add(topic)
        return True

    def can_hold(self, message: PublishPacket) -> bool:
        """Tell whether one more message may wait."""
        allowance = self.user.permissions.allowance
        return (
            len(self.queue) + len(self.inflight) < allowance.queue_messages
            and self.held_bytes + _bytes(message) <= allowance.queue_bytes
        )

    def free_id(self) -> int:
        """Return a packet id that is not in flight."""
        while True:
            self.last_id = self.last_id % 0xFFFF + 1
            if self.last_id not in self.inflight:
                return self.last_id


def _bytes(message: PublishPacket) -> int:
    return MESSAGE_BYTES + len(message.topic) + len(message.payload)


class Hub:
    """Routes messages between sessions. `now` is monotonic seconds."""

    def __init__(self, log: BoundedLog | None = None) -> None:
        self.log = log or BoundedLog(logger)
        self.sessions: dict[tuple[str, str], MqttSession] = {}
        self.retained: dict[str, PublishPacket] = {}
        self._subscribers: dict[str, dict[MqttSession, int]] = {}
        self._filters: Any = MQTTMatcher()  # the same, by level
        self._routes: dict[str, tuple[tuple[MqttSession, int], ...]] = {}

    # --- coming and going -------------------------------------------------------------------------

    def connect(
        self, connect: Connect, user: BrokerUser, link: HubLink, now: float
    ) -> tuple[MqttSession | None, int, bool]:
        """Return (session, CONNACK code, session present) of a user whose password was right; the
        session is None when refused.
        """
        if not connect.client_id and not connect.clean:
            return None, packets.BAD_CLIENT_ID, False
        if connect.will is not None and not user.permissions.may_publish(connect.will.topic):
            self._warn(
                user.name, "broker_will_refused", user=user.name, topic=connect.will.topic[:200]
            )
            return None, packets.NOT_AUTHORIZED, False
        key = (user.name, connect.client_id or f"anonymous-{id(link)}")
        old = self.sessions.get(key)
        if old is not None and old.link is not None:
            self.log.write(
                logging.INFO, user.name, "broker_take_over", user=key[0], client=key[1][:80]
            )
            old.link.kick()
            self.leave(old, old.link, graceful=False, now=now)
            old = self.sessions.get(key)
        present = old is not None and not connect.clean
        if old is not None and not present:
            self._forget(old)
        session = old if old is not None and present else MqttSession(user, key[1], connect.clean)
        self.sessions[key] = session
        session.user, session.link, session.will = user, link, connect.will
        session.permitted.clear()
        return session, packets.ACCEPTED, present

    def resume(self, session: MqttSession) -> None:
        """Send again what a returning session did not acknowledge, and then what waited for it, as
        far as it keeps up.
        """
        session.queue.extendleft(
            replace(message, dup=True) for message in reversed(session.inflight.values())
        )
        session.inflight.clear()
        self.push(session)

    def leave(self, session: MqttSession, link: HubLink, *, graceful: bool, now: float) -> None:
        """A connection ended; without a good-bye its will is published. Does nothing when another
        one has taken over.
        """
        if session.link is not link:
            return
        session.link, session.left_at = None, now
        will, session.will = session.will, None
        if session.clean:
            self._forget(session)
        else:
            self._bound_left_sessions(session.user.name)
        if will is not None and not graceful:
            self.publish(session, will)

    def set_users(self, users: dict[str, BrokerUser], now: float) -> None:
        """Part with every session whose user is gone, has another key, or may do other things than
        before.
        """
        for session in [s for s in self.sessions.values() if users.get(s.user.name) != s.user]:
            self.log.write(
                logging.INFO,
                session.user.name,
                "broker_revoked",
                user=session.user.name,
                client=session.client_id[:80],
            )
            if session.link is not None:
                session.link.kick()
                self.leave(session, session.link, graceful=False, now=now)
            self._forget(session)

    def expire(self, before: float) -> None:
        """Forget persistent sessions that were left earlier than this."""
        for session in [s for s in self.sessions.values() if s.link is None and s.left_at < before]:
            self._forget(session)

    def _bound_left_sessions(self, user: str) -> None:
        left = sorted(
            (s for s in self.sessions.values() if s.user.name == user and s.link is None),
            key=lambda s: s.left_at,
        )
        for session in left[:-MAX_LEFT_SESSIONS]:
            self._forget(session)

    def _forget(self, session: MqttSession) -> None:
        self.unsubscribe(session, tuple(session.filters))
        if self.sessions.get((session.user.name, session.client_id)) is session:
            del self.sessions[session.user.name, session.client_id]

    # --- subscriptions ----------------------------------------------------------------------------

    def subscribe(self, session: MqttSession, subscribe: Subscribe) -> list[int]:
        """Return a SUBACK's codes. Send the SUBACK, and then `send_retained`."""
        return [
            self._subscribe_one(session, filter_, min(qos, 1)) for filter_, qos in subscribe.filters
        ]

    def _subscribe_one(self, session: MqttSession, filter_: str, qos: int) -> int:
        permitted = is_filter(filter_) and session.user.permissions.may_subscribe(filter_)
        if not permitted or (
            len(session.filters) >= MAX_FILTERS and filter_ not in session.filters
        ):
            self._warn(
                session.user.name,
                "broker_subscribe_refused",
                user=session.user.name,
                filter=filter_[:200],
            )
            return packets.SUBSCRIPTION_REFUSED
        if session.filters.get(filter_) != qos:
            session.filters[filter_] = qos
            if filter_ not in self._subscribers:
                self._filters[filter_] = self._subscribers[filter_] = {}
            self._subscribers[filter_][session] = qos
            self._routes.clear()
        return qos

    def send_retained(self, session: MqttSession, subscribe: Subscribe, codes: list[int]) -> None:
        """Send the retained messages under the filters that were granted."""
        for (filter_, _), qos in zip(subscribe.filters, codes, strict=True):
            if qos != packets.SUBSCRIPTION_REFUSED:
                for message in self._retained_under(filter_):
                    self._enqueue(session, replace(message, qos=min(qos, message.qos)))
        self.push(session)

    def _retained_under(self, filter_: str) -> list[PublishPacket]:
        literal = filter_.partition("+")[0].partition("#")[0]
        if literal == filter_:
            return [self.retained[filter_]] if filter_ in self.retained else []
        start = literal.removesuffix("/")  # `a/#` is `a` as well
        return [
            m
            for topic, m in self.retained.items()
            if topic.startswith(start) and matches(filter_, topic)
        ]

    def unsubscribe(self, session: MqttSession, filters: tuple[str, ...]) -> None:
        """Forget subscriptions; unknown ones are no error."""
        for filter_ in filters:
            if session.filters.pop(filter_, None) is not None:
                subscribers = self._subscribers[filter_]
                del subscribers[session]
                if not subscribers:
                    del self._subscribers[filter_], self._filters[filter_]
                self._routes.clear()

    # --- messages ---------------------------------------------------------------------------------

    def publish(self, session: MqttSession, message: PublishPacket) -> None:
        """Deliver a client's message, unless it may not publish there: then it is dropped and
        logged, as Mosquitto does.
        """
        if not session.may_publish(message.topic):
            self._warn(
                session.user.name,
                "broker_publish_refused",
                user=session.user.name,
                topic=message.topic[:200],
            )
            return
        # else one robot, which may write to as many topics as it likes, fills the store
        if message.retain and is_kept(message.topic):
            self._retain(message)
        at_most_once = b""
        for target, granted in self._route(message.topic):
            if min(granted, message.qos) == 0:
                at_most_once = at_most_once or packets.publish(
                    PublishPacket(message.topic, message.payload)
                )
                self._send_at_most_once(target, at_most_once)
            else:
                self._enqueue(target, PublishPacket(message.topic, message.payload, qos=1))
                self.push(target)

    def acknowledge(self, session: MqttSession, packet_id: int) -> None:
        """A client has a QoS 1 message; send the next ones."""
        message = session.inflight.pop(packet_id, None)
        if message is not None:
            session.held_bytes -= _bytes(message)
            self.push(session)

    def receive_once(self, session: MqttSession, message: PublishPacket) -> None:
        """Take a QoS 2 message: deliver it the first time, and remember its id until it is
        released.

        Raises:
            ProtocolError: too many were not released.
        """
        if message.packet_id in session.received:
            return
        if len(session.received) >= MAX_UNRELEASED:
            raise ProtocolError(f"more than {MAX_UNRELEASED} unreleased messages")
        session.received.add(message.packet_id)
        self.publish(session, message)

    def push(self, session: MqttSession) -> None:
        """Send what waits for a session, as far as it keeps up."""
        link = session.link
        while (
            link is not None and link.is_ready and session.queue and len(session.inflight) < WINDOW
        ):
            message = session.queue.popleft()
            if message.qos:
                message = (
                    message if message.packet_id else replace(message, packet_id=session.free_id())
                )
                session.inflight[message.packet_id] = message
            else:
                session.held_bytes -= _bytes(message)
            link.write(packets.publish(message))

    def _route(self, topic: str) -> tuple[tuple[MqttSession, int], ...]:
        known = self._routes.get(topic)
        if known is None:
            best: dict[MqttSession, int] = {}
            for subscribers in self._filters.iter_match(topic):
                for session, qos in subscribers.items():
                    best[session] = max(qos, best.get(session, 0))
            if len(self._routes) >= KNOWN_ROUTES:
                self._routes.clear()
            known = self._routes[topic] = tuple(best.items())
        return known

    def _retain(self, message: PublishPacket) -> None:
        if not message.payload:
            self.retained.pop(message.topic, None)
        elif message.topic in self.retained or len(self.retained) < MAX_RETAINED:
            self.retained[message.topic] = PublishPacket(
                message.topic, message.payload, min(message.qos, 1), retain=True
            )
        else:
            self.log.write(logging.ERROR, "", "broker_retained_full", topic=message.topic[:200])

    @staticmethod
    def _send_at_most_once(session: MqttSession, data: bytes) -> None:
        if session.link is not None and session.link.is_ready:
            session.link.write(data)
        elif session.link is not None:
            session.dropped += 1

    def _enqueue(self, session: MqttSession, message: PublishPacket) -> None:
        if not session.can_hold(message):
            session.dropped += 1
            user, client, dropped = session.user.name, session.client_id, session.dropped
            self.log.write(
                logging.ERROR,
                user,
                "broker_queue_full",
                user=user,
                client=client[:80],
                dropped=dropped,
            )
            return
        session.queue.append(message)
        session.held_bytes += _bytes(message)

    def _warn(self, subject: str, event: str, **fields: object) -> None:
        self.log.write(logging.WARNING, subject, event, **fields)
