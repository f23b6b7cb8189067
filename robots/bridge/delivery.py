"""Who listens to which robot and which session, and the sorting of what arrives: no connection, no
clock of its own.
"""

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

# Suffixes of messages that no robot wrote: the connection to the broker came (True) or went
# (False); a notice of a session, which is a frame for its page; which parts of the server fail,
# once a second and whenever that changes.
LINK, NOTICE, FAULTS = "link", "notice", "faults"
FAULTS_SECONDS = 1.0
_NOTICES = topics.session_notices("")
Decoded = TypeVar("Decoded")
_status = msgspec.json.Decoder(ManagerStatus)


@dataclass(frozen=True)
class ReceivedMessage:
    """One message on its way to a listener: decoded once for all of them, and as the frame that
    pages get (binary for a picture).
    """

    suffix: str
    message: Any
    frame: str | bytes = ""


class Listener(Protocol):
    """Receives the messages of robots and servers; called on the loop, must return at once."""

    def handle_message(self, inbound: ReceivedMessage) -> None:
        """Take one message. What this raises is logged, and reaches no other listener."""


class Delivery:
    """Listeners by robot, followers by session, and what is known of each robot that somebody
    listens to.
    """

    def __init__(self) -> None:
        self.known: dict[str, KnownRobot] = {}
        self.watch = ServerWatch()
        # robot: the faults that its listeners were told of, and when
        self._told: dict[str, tuple[tuple[str, ...], float]] = {}
        self._listeners: dict[str, set[Listener]] = {}
        self._followers: dict[str, set[Listener]] = {}
        self._needed_by: dict[str, set[Listener]] = {}
        # robot: how often it was told that it is needed, and when
        self._beats: dict[str, tuple[int, float]] = {}

    @property
    def robots(self) -> tuple[str, ...]:
        """Robots that somebody listens to."""
        return tuple(self._listeners)

    def listen(self, robot: str, listener: Listener, now: float, *, needs: bool = True) -> bool:
        """Add a listener; True for the first one of this robot. One that `needs` the robot has it
        asked to speak at its full rate; `now` is monotonic seconds.
        """
        known = self.known.setdefault(robot, KnownRobot(robot))
        if needs:
            known.needed_since = min(known.needed_since, now)
            self._needed_by.setdefault(robot, set()).add(listener)
        first = robot not in self._listeners
        self._listeners.setdefault(robot, set()).add(listener)
        return first

    def ignore(self, robot: str, listener: Listener) -> bool:
        """Remove a listener; True when it was the last one, after which nothing is known of the
        robot.
        """
        listeners = self._listeners.get(robot)
        if listeners is None:
            return False
        listeners.discard(listener)
        self._need_no_more(robot, listener)
        if listeners:
            return False
        del self._listeners[robot]
        self.known.pop(robot, None)
        self._told.pop(robot, None)
        return True

    def _need_no_more(self, robot: str, listener: Listener) -> None:
        needed_by = self._needed_by.get(robot, set())
        needed_by.discard(listener)
        if not needed_by:
            self._needed_by.pop(robot, None)
            self._beats.pop(robot, None)
            self.known[robot].needed_since = math.inf

    def beats_due(self, now: float) -> list[tuple[str, int]]:
        """Return the robots that are to be told now that somebody needs them, and how often each
        was told before, counting them as told.
        """
        due = []
        for robot in self._needed_by:
            count, at = self._beats.get(robot, (0, -math.inf))
            if now - at >= INTEREST_PERIOD_SECONDS:
                self._beats[robot] = count + 1, now
                due.append((robot, count))
        return due

    def beat_again(self) -> None:
        """Have every robot that is needed told so at once: the broker is new."""
        self._beats.clear()

    def follow(self, session: str, listener: Listener) -> None:
        """Bring the notices of a session to a listener."""
        self._followers.setdefault(session, set()).add(listener)

    def unfollow(self, session: str, listener: Listener) -> None:
        """Stop bringing them."""
        followers = self._followers.get(session, set())
        followers.discard(listener)
        if not followers:
            self._followers.pop(session, None)

    def arrive(self, topic: str, payload: bytes, now: float) -> None:
        """Decode a message, note it, and bring it to whoever listens; `now` is monotonic seconds.

        Raises:
            Rejection: it is not what its topic promises.
        """
        if topic.startswith(_NOTICES):
            self.bring_notice(topic.removeprefix(_NOTICES), payload.decode("utf-8", "replace"))
            return
        if topic == topics.MANAGER_STATUS:
            self.watch.heard(_decoded(_status, payload), now)
            self.bring_faults(now)
            return
        parsed = topics.parse(topic)
        if parsed is None or (known := self.known.get(parsed[0])) is None:
            return
        suffix = parsed[1]
        message = None if suffix == "lease" and not payload else codec.decode(suffix, payload)
        self._hear(known, suffix, message, payload, now)
        if isinstance(message, Heartbeat):
            refutation = known.refutation(now, message.stamp)
            if refutation is not None:
                self._hear(known, "connection", refutation, codec.encode(refutation), now)

    def _hear(
        self, known: KnownRobot, suffix: str, message: Any, payload: bytes, now: float
    ) -> None:
        if known.take(suffix, message, now):
            frame = (
                picture.frame(payload)
                if picture.is_picture(suffix)
                else f"{suffix}\n{payload.decode('utf-8', 'replace')}"
            )
            self.bring(known.name, ReceivedMessage(suffix, message, frame))

    def note_lease(self, robot: str, lease: Lease | None, now: float) -> None:
        """Act on a lease that this process is about to publish, without waiting for it to come
        back.
        """
        known = self.known.get(robot)
        if known is not None:
            known.take_lease(lease, now, certain=True)
            self.bring(robot, ReceivedMessage("lease", lease))

    def lose_sight(self) -> None:
        """Forget which robots are connected: the connection to the broker is gone, and only a new
        word counts.
        """
        for known in self.known.values():
            known.connection = None

    def bring(self, robot: str, inbound: ReceivedMessage) -> None:
        """Give a message to all listeners of a robot."""
        for listener in tuple(self._listeners.get(robot, ())):
            _hand(listener, inbound)

    def bring_everybody(self, inbound: ReceivedMessage) -> None:
        """Give a message to the listeners of all robots."""
        for robot in self.robots:
            self.bring(robot, inbound)

    def bring_faults(self, now: float) -> None:
        """Bring everybody what fails now, when that has changed or was said a second ago: who hears
        nothing at all has lost this process.
        """
        for robot, known in tuple(self.known.items()):
            faults = self.watch.faults(known, now)
            told, at = self._told.get(robot, (None, float("-inf")))
            if faults != told or now - at >= FAULTS_SECONDS:
                self._told[robot] = faults, now
                self.bring(robot, ReceivedMessage(FAULTS, faults))

    def bring_notice(self, session: str, frame: str) -> None:
        """Give a notice to all followers of its session."""
        for follower in tuple(self._followers.get(session, ())):
            _hand(follower, ReceivedMessage(NOTICE, None, frame))


def _hand(listener: Listener, inbound: ReceivedMessage) -> None:
    try:
        listener.handle_message(inbound)
    except Exception:  # one page's failure must not take the messages of the others
        log.exception("listener_failed", kind=type(listener).__name__, suffix=inbound.suffix)


def _decoded(decoder: "msgspec.json.Decoder[Decoded]", payload: bytes) -> Decoded:
    try:
        return decoder.decode(payload)
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        raise Rejection("malformed", f"from a server: {error}") from error
