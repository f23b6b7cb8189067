"""The listeners of robots and sessions; has neither a connection nor a clock."""

import math
from dataclasses import dataclass
from typing import Any, Protocol, TypeVar

import msgspec
import structlog

from robots.api import codec, picture, topics
from robots.api.errors import Rejection
from robots.api.idle import INTEREST_PERIOD_SECONDS
from robots.api.messages import Heartbeat, Lease, ManagerStatus
from robots.bridge.known import KnownRobot
from robots.bridge.server_watch import ServerWatch

log = structlog.stdlib.get_logger(__name__)

# Suffixes of messages that are not a robot's: the connection to the broker was established (True)
# or lost (False); a notice of a session, which is a frame for its page; the faults of the server,
# once a second and whenever they change.
LINK, NOTICE, FAULTS = "link", "notice", "faults"
FAULTS_SECONDS = 1.0
_NOTICES = topics.session_notices("")
Decoded = TypeVar("Decoded")
_status = msgspec.json.Decoder(ManagerStatus)


@dataclass(frozen=True)
class ReceivedMessage:
    """A message, decoded once for all listeners, and as the frame for pages."""

    suffix: str
    message: Any
    frame: str | bytes = ""


class Listener(Protocol):
    """Receives messages of robots and servers; called on the loop, must return at once."""

    def handle_message(self, inbound: ReceivedMessage) -> None:
        """Handle a message. An exception is logged, and reaches no other listener."""


class Delivery:
    """Listeners by robot, followers by session, and the KnownRobot of each robot with listeners."""

    def __init__(self) -> None:
        self.known: dict[str, KnownRobot] = {}
        self.watch = ServerWatch()
        # robot: the faults that its listeners last received, and when
        self._last_faults: dict[str, tuple[tuple[str, ...], float]] = {}
        self._listeners: dict[str, set[Listener]] = {}
        self._followers: dict[str, set[Listener]] = {}
        self._needed_by: dict[str, set[Listener]] = {}
        # robot: how many heartbeats it was sent, and when the last one
        self._beats: dict[str, tuple[int, float]] = {}

    @property
    def robots(self) -> tuple[str, ...]:
        return tuple(self._listeners)

    def listen(self, robot: str, listener: Listener, now: float, *, needs: bool = True) -> bool:
        """Add a listener; True for the first one of this robot. While a listener `needs` the robot,
        the robot is sent heartbeats; `now` is monotonic seconds.
        """
        known = self.known.setdefault(robot, KnownRobot(robot))
        if needs:
            known.needed_since = min(known.needed_since, now)
            self._needed_by.setdefault(robot, set()).add(listener)
        first = robot not in self._listeners
        self._listeners.setdefault(robot, set()).add(listener)
        return first

    def ignore(self, robot: str, listener: Listener) -> bool:
        """Remove a listener; True for the last one, after which the robot is forgotten."""
        listeners = self._listeners.get(robot)
        if listeners is None:
            return False
        listeners.discard(listener)
        self._need_no_more(robot, listener)
        if listeners:
            return False
        del self._listeners[robot]
        self.known.pop(robot, None)
        self._last_faults.pop(robot, None)
        return True

    def _need_no_more(self, robot: str, listener: Listener) -> None:
        needed_by = self._needed_by.get(robot, set())
        needed_by.discard(listener)
        if not needed_by:
            self._needed_by.pop(robot, None)
            self._beats.pop(robot, None)
            self.known[robot].needed_since = math.inf

    def beats_due(self, now: float) -> list[tuple[str, int]]:
        """Return the robots to send a heartbeat to now, with their counts, and count these."""
        due = []
        for robot in self._needed_by:
            count, at = self._beats.get(robot, (0, -math.inf))
            if now - at >= INTEREST_PERIOD_SECONDS:
                self._beats[robot] = count + 1, now
                due.append((robot, count))
        return due

    def beat_again(self) -> None:
        """Make all heartbeats due, because the connection is new."""
        self._beats.clear()

    def follow(self, session: str, listener: Listener) -> None:
        """Deliver the notices of a session to a listener."""
        self._followers.setdefault(session, set()).add(listener)

    def unfollow(self, session: str, listener: Listener) -> None:
        followers = self._followers.get(session, set())
        followers.discard(listener)
        if not followers:
            self._followers.pop(session, None)

    def arrive(self, topic: str, payload: bytes, now: float) -> None:
        """Decode a message, note it, and deliver it to its listeners; `now` is monotonic seconds.

        Raises:
            Rejection: it does not fit its topic.
        """
        if topic.startswith(_NOTICES):
            self.bring_notice(topic.removeprefix(_NOTICES), payload.decode("utf-8", "replace"))
            return
        if topic == topics.MANAGER_STATUS:
            self.watch.on_status(_decoded(_status, payload), now)
            self.bring_faults(now)
            return
        parsed = topics.parse(topic)
        if parsed is None or (known := self.known.get(parsed[0])) is None:
            return
        suffix = parsed[1]
        message = None if suffix == "lease" and not payload else codec.decode(suffix, payload)
        self._on_message(known, suffix, message, payload, now)
        if isinstance(message, Heartbeat):
            refutation = known.refutation(now, message.stamp)
            if refutation is not None:
                self._on_message(known, "connection", refutation, codec.encode(refutation), now)

    def _on_message(
        self, known: KnownRobot, suffix: str, message: Any, payload: bytes, now: float
    ) -> None:
        if known.take(suffix, message, now):
            frame: str | bytes = f"{suffix}\n{payload.decode('utf-8', 'replace')}"
            if picture.is_picture(suffix):
                frame = picture.frame(payload)
            self.bring(known.name, ReceivedMessage(suffix, message, frame))

    def note_lease(self, robot: str, lease: Lease | None, now: float) -> None:
        """Act on a lease that this process is about to publish, before the broker returns it."""
        known = self.known.get(robot)
        if known is not None:
            known.take_lease(lease, now, certain=True)
            self.bring(robot, ReceivedMessage("lease", lease))

    def lose_sight(self) -> None:
        """Forget which robots are connected: the broker is lost, and only a new message counts."""
        for known in self.known.values():
            known.connection = None

    def bring(self, robot: str, inbound: ReceivedMessage) -> None:
        for listener in tuple(self._listeners.get(robot, ())):
            _deliver(listener, inbound)

    def bring_everybody(self, inbound: ReceivedMessage) -> None:
        for robot in self.robots:
            self.bring(robot, inbound)

    def bring_faults(self, now: float) -> None:
        """Deliver the present faults, when they have changed and once a second: a page that
        receives nothing at all has lost this process.
        """
        for robot, known in tuple(self.known.items()):
            faults = self.watch.faults(known, now)
            last, at = self._last_faults.get(robot, (None, float("-inf")))
            if faults != last or now - at >= FAULTS_SECONDS:
                self._last_faults[robot] = faults, now
                self.bring(robot, ReceivedMessage(FAULTS, faults))

    def bring_notice(self, session: str, frame: str) -> None:
        """Deliver a notice to all followers of its session."""
        for follower in tuple(self._followers.get(session, ())):
            _deliver(follower, ReceivedMessage(NOTICE, None, frame))


def _deliver(listener: Listener, inbound: ReceivedMessage) -> None:
    try:
        listener.handle_message(inbound)
    except Exception:  # one page's failure must not take the messages of the others
        log.exception("listener_failed", kind=type(listener).__name__, suffix=inbound.suffix)


def _decoded(decoder: "msgspec.json.Decoder[Decoded]", payload: bytes) -> Decoded:
    try:
        return decoder.decode(payload)
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        raise Rejection("malformed", f"from a server: {error}") from error
