"""The agent's MQTT messages, in order, also without a connection.

Records (states, events, answers, photos) are queued until the broker has acknowledged them, so that
a restart of the broker loses no part of a drive. Other messages are dropped while disconnected.
"""

from collections import deque
from dataclasses import dataclass

from robots.api import topics

KEPT = ("state", "event", "action", "photo")
MESSAGES = 6000
BYTES = 32 << 20
ONE_AT_A_TIME = frozenset({"picture"})  # more would only wait behind it on a slow network


@dataclass(frozen=True, eq=False)
class OutboundMessage:
    suffix: str
    payload: bytes
    qos: int
    retained: bool


def outbound(suffix: str, payload: bytes) -> OutboundMessage:
    """Return a message with its topic's QoS and retain flag; ValueError for no such topic."""
    topic = topics.find(suffix)
    if topic is None:
        raise ValueError(f"no topic {suffix}")
    return OutboundMessage(suffix, payload, topic.qos, topic.retained)


class Outbox:
    """A queue bounded in messages and bytes: the oldest is dropped first, counted in `lost`."""

    def __init__(self, messages: int = MESSAGES, size: int = BYTES) -> None:
        self._waiting: deque[OutboundMessage] = deque()
        self._sent: dict[int, OutboundMessage] = {}
        self._limits = messages, size
        self._bytes = 0
        self.lost = 0

    def __len__(self) -> int:
        return len(self._waiting)

    @property
    def unacknowledged(self) -> int:
        return len(self._sent)

    def put(self, message: OutboundMessage, *, connected: bool) -> None:
        """Queue a message; one that is not a record only when `connected`."""
        kind = message.suffix.partition("/")[0]
        if not connected and kind not in KEPT:
            return
        if kind in ONE_AT_A_TIME and not self._make_room(message.suffix):
            self.lost += 1
            return
        self._waiting.append(message)
        self._bytes += len(message.payload)
        messages, size = self._limits
        while len(self._waiting) > messages or (self._bytes > size and len(self._waiting) > 1):
            self._bytes -= len(self._waiting.popleft().payload)
            self.lost += 1

    def _make_room(self, suffix: str) -> bool:
        """Drop the waiting message of this suffix; False when one is being sent."""
        for old in [old for old in self._waiting if old.suffix == suffix]:
            self._waiting.remove(old)
            self._bytes -= len(old.payload)
            self.lost += 1
        return all(sent.suffix != suffix for sent in self._sent.values())

    def take(self) -> OutboundMessage:
        """Return the next message, which counts as being sent until `acknowledged`."""
        message = self._waiting.popleft()
        self._bytes -= len(message.payload)
        self._sent[id(message)] = message
        return message

    def acknowledged(self, message: OutboundMessage) -> None:
        self._sent.pop(id(message), None)

    def disconnected(self) -> None:
        """Put unacknowledged records back in front, in order, and drop the rest."""
        everything = [*self._sent.values(), *self._waiting]
        self._sent.clear()
        self._waiting.clear()
        self._bytes = 0
        for message in everything:
            self.put(message, connected=False)
