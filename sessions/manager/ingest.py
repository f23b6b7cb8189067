"""Sorts what arrives at the session manager: to the recorder, into memory, and into the queues of
presence and signals.

Runs in the loop's thread and never waits. Malformed messages are counted, logged and dropped.
"""

import time
from collections import Counter, deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import aiomqtt
import msgspec
import structlog

from robots.api import codec, messages, topics
from robots.api.errors import Rejection
from sessions import protocol
from sessions.leases.readiness import ORDERED
from sessions.manager.robot_liveness import RobotLiveness
from sessions.recording.items import ActionItem, EventItem, PageItem, PhotoItem, StateItem
from sessions.recording.recorder import Recorder

logger = structlog.stdlib.get_logger(__name__)

RARE = ("event", "action", "photo/+")
FREQUENT = ("connection", "factsheet", "state", "heartbeat")
MAX_UNSENT = 10_000
MAX_SIGNS = 10_000
# Answers to actions that are repeated many times a second, or sent by the session manager itself,
# are not recorded.
UNRECORDED = frozenset({"", "stop", "estop", "resend_states"})
_NOTICES = topics.session_notices("")
_REPORTS = protocol.page_reports("")


def filters(robots: Iterable[str] = ("+",), *, frequent_qos: int = 1) -> set[tuple[str, int]]:
    """Return the (filter, QoS) pairs that a session manager subscribes to, for these robots.

    At QoS 1 the broker waits for acknowledgements, so that a burst of states cannot delay what the
    session manager publishes until its connection is given up. A cluster of NATS creates a
    replicated queue for each subscription at QoS 1, and takes a minute to restore so many after a
    partition: there, frequent messages have QoS 0. Lost states are requested by their numbers, and
    the others are repeated or retained.
    """
    return {
        *_of_robots(("+",), RARE, 1),
        *_of_robots(robots, FREQUENT, frequent_qos),
        (topics.session_notices("+"), 1),
        (protocol.page_reports("+"), 1),
    }


def _of_robots(
    robots: Iterable[str], suffixes: Iterable[str], highest_qos: int
) -> set[tuple[str, int]]:
    lines = [(suffix, topics.find(suffix.replace("+", "x"))) for suffix in suffixes]
    return {
        (topics.of(robot, suffix), min(line.qos, highest_qos))
        for robot in robots
        for suffix, line in lines
        if line is not None
    }


@dataclass(frozen=True)
class PresenceNews:
    """A message about a robot's presence."""

    robot: str
    message: messages.Message
    retained: bool = False

    @property
    def key(self) -> tuple[str, str]:
        """Only the newest message of each key counts. ONLINE has a key of its own: a late OFFLINE
        must not hide that the robot is back.
        """
        is_online = isinstance(self.message, messages.Connection) and self.message.state == "ONLINE"
        return self.robot, "online" if is_online else type(self.message).__name__


class Intake:
    """Takes every message.

    Args:
        recorder: receives what belongs into the record.
        clock: Unix seconds.
        monotonic: seconds.
        wake_signals: called when `fresh` has new items.
        wake_scheduler: called when a web process has ended a session.
    """

    def __init__(
        self,
        recorder: Recorder,
        clock: Callable[[], float],
        *,
        wake_signals: Callable[[], None],
        wake_scheduler: Callable[[], None],
        monotonic: Callable[[], float] = time.monotonic,
    ) -> None:
        self._recorder = recorder
        self._clock = clock
        self._monotonic = monotonic
        self._wake_signals = wake_signals
        self._wake_scheduler = wake_scheduler
        # the newest of each kind of each robot
        self._presence: dict[tuple[str, str], PresenceNews] = {}
        self._stated: set[str] = set()  # robots with a state that presence_news has not returned
        self._fresh: deque[Fresh] = deque(maxlen=MAX_UNSENT)
        self.liveness: dict[str, RobotLiveness] = {}
        self.signs: dict[str, float] = {}  # session: last sign of its page (transitions.py)
        self.counts: Counter[str] = Counter()

    def receive(self, message: aiomqtt.Message, received_at: float | None = None) -> None:
        """Take a message of the broker, received at `received_at` (Unix seconds) or just now."""
        topic, payload = str(message.topic), bytes(message.payload or b"")
        now = self._clock() if received_at is None else received_at
        try:
            if topic.startswith(_REPORTS):
                report = _decoded(protocol.PageReport, payload, topic)
                self._put(PageItem(report, now))
                self._notice_sign(report, now)
            elif topic.startswith(_NOTICES):
                frame = _bounded(payload, topic).decode("utf-8", "replace")
                if isinstance(protocol.decode_notice(frame), protocol.Ended):
                    self._wake_scheduler()  # a web process has ended it
            elif parsed := topics.parse(topic):
                self._on_robot_message(*parsed, payload, now, retained=message.retain)
            else:
                self._reject(topic, Rejection("unknown_topic", topic[:80]))
        except Rejection as rejection:
            self._reject(topic, rejection)

    def _reject(self, topic: str, rejection: Rejection) -> None:
        self.counts[rejection.reason] += 1
        count = self.counts[rejection.reason]
        if count <= 100 or count % 1000 == 0:
            logger.warning("message_rejected", topic=topic, reason=str(rejection), count=count)

    def _on_robot_message(
        self, robot: str, suffix: str, payload: bytes, now: float, *, retained: bool
    ) -> None:
        """Update the robot's liveness, and record the message.

        Called in the order of arrival; the recorder writes in another thread. Photos that the
        session manager ordered itself are not recorded.

        Raises:
            Rejection: the message is invalid; the caller counts it.
        """
        message = codec.decode(suffix, payload, "from_robot")
        liveness = self.liveness.get(robot) or self.liveness.setdefault(robot, RobotLiveness())
        received = self._monotonic()
        match message:
            case messages.State():
                late = not liveness.take(message, received)
                offset = liveness.offset.seconds
                item = StateItem(robot, message, payload, now, offset, late=late)
                self._stated.add(robot)
                put = self._recorder.put if message.session is None else self._put
                put(item)
            case messages.Heartbeat():
                liveness.heartbeat(message, received, now)
                if (refutation := liveness.refutation(now)) is not None:
                    self._note_presence(PresenceNews(robot, refutation))
            case messages.ActionStatus():
                liveness.answer(message)
                session = liveness.state.session if liveness.state is not None else None
                if (
                    session is not None
                    and message.status in messages.ENDED
                    and message.type not in UNRECORDED
                ):
                    self._put(ActionItem(robot, session, message, now))
            case messages.Event() if message.type != "photo" or not _is_ordered(message.action_id):
                self._put(EventItem(robot, message, now))
            case messages.Connection():
                liveness.connection(message, received)
                self._note_presence(PresenceNews(robot, message, retained))
            case messages.Factsheet():
                self._note_presence(PresenceNews(robot, message, retained))
            case bytes() if not _is_ordered(action := suffix.partition("/")[2]):
                self._recorder.put(PhotoItem(robot, action, message, now))

    def _notice_sign(self, report: protocol.PageReport, now: float) -> None:
        if (
            report.suffix != "page/event"
            or _decoded(protocol.PageEvent, bytes(report.message), report.suffix).type
            != protocol.HERE
        ):
            return
        # Also when the robot's state names another session or none: on a busy site it may be late.
        self.signs.pop(report.session, None)
        self.signs[report.session] = now
        if len(self.signs) > MAX_SIGNS:
            del self.signs[next(iter(self.signs))]

    def _put(self, item: "Fresh") -> None:
        self._recorder.put(item)
        self._fresh.append(item)
        self._wake_signals()

    def _note_presence(self, news: PresenceNews) -> None:
        self._presence.pop(news.key, None)  # the newest comes last
        self._presence[news.key] = news

    def presence_news(self) -> list[PresenceNews]:
        """Return the news since the last call: of each robot the newest factsheet and state, and
        the newest connection of either kind.
        """
        stated, self._stated = self._stated, set()
        for robot in stated:
            liveness = self.liveness.get(robot)
            if liveness is not None and liveness.state is not None:
                self._note_presence(PresenceNews(robot, liveness.state))
        news, self._presence = self._presence, {}
        return list(news.values())

    def repeat_news(self, news: list[PresenceNews]) -> None:
        """Return news that could not be stored again at the next call, before newer ones."""
        newer, self._presence = self._presence, {}
        for one in (*news, *newer.values()):
            self._note_presence(one)

    def fresh(self) -> list["Fresh"]:
        """Return the items since the last call; states are in order of seq, but for late ones."""
        return [self._fresh.popleft() for _ in range(len(self._fresh))]


def _is_ordered(action_id: str | None) -> bool:
    """Tell whether this answers an order between two sessions, a test of the camera."""
    return (action_id or "").startswith(ORDERED)


Fresh = StateItem | EventItem | ActionItem | PageItem


def _bounded(payload: bytes, topic: str) -> bytes:
    if len(payload) > protocol.MAX_FRAME:
        raise Rejection("oversized", topic[:80])
    return payload


def _decoded(kind: type[Any], payload: bytes, topic: str) -> Any:
    try:
        return msgspec.json.decode(_bounded(payload, topic), type=kind)
    except (msgspec.DecodeError, RecursionError) as error:
        raise Rejection("malformed", f"{topic[:80]}: {error}") from error
