"""ROS 2 without ROS: its topics are DDS topics, and cyclonedds speaks DDS.

Needs `cyclonedds` (the extra `ros2`). Services and actions are not portable over plain DDS: go-to
is a topic (`goal_pose`) whose end Nav2's action tells on another; for docking by a service, use
rosbridge. Options: `domain` (default: ROS_DOMAIN_ID, or 0) and those of `base.RosOptions`;
interfaces and peers are configured as for every Cyclone DDS, by CYCLONEDDS_URI.
"""

import asyncio
import contextlib
import gc
import os
import time
from collections.abc import Callable, Iterable, Mapping
from typing import Annotated, Any

import structlog
from msgspec import Meta

from robots.agent.adapters.common.robot_profile import load_profile, settings_of
from robots.agent.adapters.ros.base import RosAdapter, RosOptions
from robots.agent.adapters.ros.bus import Goals, Handler
from robots.agent.adapters.ros.graph import Graph, TopicPeers
from robots.agent.robot_interface import AdapterError

try:
    from cyclonedds.builtin import (
        BuiltinDataReader,
        BuiltinTopicDcpsPublication,
        BuiltinTopicDcpsSubscription,
    )
    from cyclonedds.core import DDSException
    from cyclonedds.domain import DomainParticipant
    from cyclonedds.internal import InvalidSample
    from cyclonedds.pub import DataWriter
    from cyclonedds.qos import Policy, Qos
    from cyclonedds.sub import DataReader
    from cyclonedds.topic import Topic

    from robots.agent.adapters.ros.ros2_messages import TYPES, filled, plain
except ImportError as error:
    raise ImportError("it needs cyclonedds: pip install 'cyclonedds>=0.10.5'") from error

HIGHEST_DOMAIN = 232  # of which the UDP ports are below 65536 (DDSI-RTPS 2.3, 9.6.1.1)
POLL = 0.01
AT_ONCE = 20
MOST_ENDPOINTS = 5000
DEPTH = 10
GLANCE = 0.002
BYSTANDER = 1.0
BLOCKING = 10_000_000  # nanoseconds that a full history may hold us up

log = structlog.stdlib.get_logger(__name__)


class Ros2Options(RosOptions, frozen=True, kw_only=True):
    """Which domain; without one it is the environment's, as for every program of ROS 2."""

    domain: Annotated[int, Meta(ge=0, le=HIGHEST_DOMAIN)] | None = None


def create(profile_name: str, options: Mapping[str, Any]) -> RosAdapter:
    """Return an adapter for a robot of ROS 2; nothing is opened yet.

    Raises:
        AdapterError: no such profile or option; one sentence.
    """
    robot = load_profile(profile_name)
    settings = settings_of(Ros2Options, "ros2", robot, {"navigation": "goal_pose", **options})
    if settings.navigation not in {"goal_pose", "none"}:
        raise AdapterError(
            "over DDS, navigation must be goal_pose or none; use the adapter rosbridge for actions"
        )
    if settings.dock or settings.undock:
        raise AdapterError(
            "ROS 2 services cannot be called over DDS; use the adapter rosbridge for docking"
        )
    domain = settings.domain if settings.domain is not None else _domain_of_environment()
    return RosAdapter(robot, settings, DdsBus(domain), "ROS 2")


def _domain_of_environment() -> int:
    """Return the domain as ROS 2 reads it, decimal or 0x… (rcl/src/rcl/domain_id.c).

    Raises:
        AdapterError: it is none; one sentence.
    """
    text = os.environ.get("ROS_DOMAIN_ID") or "0"
    try:
        domain = int(text, 0)
    except ValueError:
        domain = -1
    if not 0 <= domain <= HIGHEST_DOMAIN:
        raise AdapterError(
            f"ROS_DOMAIN_ID must be a whole number from 0 to {HIGHEST_DOMAIN}, not {text!r}"
        )
    return domain


def quality(*, latched: bool = False, sensor: bool = False, depth: int = DEPTH) -> Any:
    """Return the quality of service that ROS 2 gives a topic: `sensor` may lose, `latched` is kept
    for who comes later.
    """
    reliable = Policy.Reliability.BestEffort if sensor else Policy.Reliability.Reliable(BLOCKING)
    durable = Policy.Durability.TransientLocal if latched else Policy.Durability.Volatile
    form = Policy.DataRepresentation(use_cdrv0_representation=True)
    return Qos(reliable, durable, Policy.History.KeepLast(1 if latched else depth), form)


class DdsBus:
    """See ros.Bus. Samples are fetched by the loop: no thread of DDS ever runs our code."""

    version = 2
    answers = False  # an acknowledgement is of the order before
    forgotten: tuple[str, ...] = ()  # there is no master

    def __init__(self, domain: int) -> None:
        self.place = f"ROS 2 in domain {domain}"
        self._domain = domain
        self._participant: Any = None
        self._topics: dict[str, Any] = {}
        self._writers: dict[str, tuple[Any, Any]] = {}
        self._readers: list[tuple[Any, Handler]] = []
        self._task: asyncio.Task[None] | None = None
        self._endpoints: list[_Endpoints] = []
        self._driving: Any = None  # the writer of velocities
        self._has_bystanders = False

    async def open(self, lost: Callable[[str], None], goals: Goals) -> None:
        """Join the domain.

        Raises:
            AdapterError: DDS cannot use this network.
        """
        del goals  # the status of Nav2's action is a topic
        try:
            self._participant = DomainParticipant(self._domain)
        except DDSException as error:
            settings = "; check CYCLONEDDS_URI" if os.environ.get("CYCLONEDDS_URI") else ""
            raise AdapterError(f"{self.place} cannot be joined: {error}{settings}") from error
        self._endpoints = [
            _Endpoints(self._participant, topic)
            for topic in (BuiltinTopicDcpsSubscription, BuiltinTopicDcpsPublication)
        ]
        self._task = asyncio.ensure_future(self._poll(lost))

    async def shut(self) -> None:
        """Leave the domain."""
        task, self._task = self._task, None
        if task is not None:
            task.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await task
        entities = [
            self._readers,
            self._writers,
            self._topics,
            self._endpoints,
            self._driving,
            self._participant,
        ]
        self._readers, self._writers, self._topics, self._participant = [], {}, {}, None
        self._endpoints, self._driving = [], None
        await asyncio.to_thread(_forget, entities)

    def _topic(self, name: str, kind: str) -> Any:
        if name not in self._topics:
            self._topics[name] = Topic(self._participant, f"rt/{name.lstrip('/')}", TYPES[kind])
        return self._topics[name]

    def subscribe(
        self,
        topic: str,
        kind: str,
        handler: Handler,
        *,
        latched: bool = False,
        sensor: bool = False,
        period: float = 0.0,
    ) -> None:
        """Hear a topic. What is not latched is asked for as if it might be lost: then writers of
        either reliability are heard.
        """
        del sensor, period
        self._readers.append(
            (
                DataReader(
                    self._participant,
                    self._topic(topic, kind),
                    qos=quality(latched=latched, sensor=not latched),
                ),
                handler,
            )
        )

    def advertise(
        self,
        topic: str,
        kind: str,
        *,
        drives: bool = False,
        latched: bool = False,
        sensor: bool = False,
    ) -> None:
        """Join the writers of a topic; of velocities only the newest is sent again to who missed
        it.
        """
        form = quality(latched=latched, sensor=sensor, depth=1 if drives else DEPTH)
        self._writers[topic] = (
            DataWriter(self._participant, self._topic(topic, kind), qos=form),
            TYPES[kind],
        )
        if drives:
            self._driving = self._writers[topic][0]

    def unadvertise(self, topic: str) -> None:
        """Leave the writers of a topic."""
        self._writers.pop(topic, None)
        self._topics.pop(topic, None)
        self._driving = None
        gc.collect(0)

    async def ask(self) -> None:
        """Wait until every reliable reader has acknowledged the velocity of before: one that hangs
        does not.

        Where several listen, one that owes it for a second may be a bystander that has died; then
        readings alone say who lives.
        """
        began = time.monotonic()
        while self._driving is not None and not _acknowledged(self._driving):
            if self._has_bystanders or (
                time.monotonic() - began > BYSTANDER and self._matched(self._driving) > 1
            ):
                self._has_bystanders = True
                return
            await asyncio.sleep(GLANCE)
        self._has_bystanders = False

    def cut(self) -> None:
        """Do nothing: of velocities, DDS keeps the newest, which is a zero."""

    def listeners(self, topic: str) -> int | None:
        """Return how many readers of this topic and type there are."""
        return self._matched(self._writers[topic][0]) if topic in self._writers else None

    @staticmethod
    def _matched(writer: Any) -> int:
        return int(writer.get_publication_matched_status().current_count)

    async def graph(self, driving: str, heard: Iterable[str]) -> Graph | None:
        """Return what others have said of their topics. A topic that drives has the types of those
        who listen: a planner may publish another one there.
        """
        del heard
        none: frozenset[str] = frozenset()
        readers, writers = (each.others() for each in self._endpoints)
        return {
            topic: TopicPeers(
                readers.get(topic, none)
                | (none if topic == driving and topic in readers else writers.get(topic, none)),
                len(readers.get(topic, none)),
                len(writers.get(topic, none)),
            )
            for topic in readers.keys() | writers.keys()
        }

    def publish(self, topic: str, message: dict[str, Any], *, newest: bool = False) -> None:
        """Send a message.

        Raises:
            AdapterError: the bus is not open, or DDS takes no more.
        """
        del newest  # nothing waits here
        if topic not in self._writers:
            raise AdapterError(f"the connection to {self.place} is closed")
        writer, kind = self._writers[topic]
        try:
            writer.write(filled(kind, message))
        except DDSException as error:
            raise AdapterError(f"{self.place} does not accept messages: {error}") from error

    async def call(self, service: str, kind: str) -> tuple[bool, str]:
        """Refuse: services are not portable over DDS.

        Raises:
            AdapterError: always.
        """
        raise AdapterError(
            f"{service} ({kind}) is a service, which plain DDS does not carry; "
            "use the adapter rosbridge"
        )

    def send_goal(self, action: str, kind: str, goal: dict[str, Any], name: str) -> None:
        """Refuse: actions are not portable over DDS.

        Raises:
            AdapterError: always.
        """
        raise AdapterError(
            f"{action} ({kind}) is an action, which plain DDS does not carry; use "
            f"the adapter rosbridge: {name} of {len(goal)} fields"
        )

    def cancel_goal(self, action: str, name: str) -> None:
        """Do nothing: there is no such goal."""

    async def _poll(self, lost: Callable[[str], None]) -> None:
        try:
            while True:
                for reader, handler in list(self._readers):
                    for sample in reader.take(AT_ONCE):
                        if not isinstance(sample, InvalidSample):
                            handler(plain(sample))
                await asyncio.sleep(POLL)
        except DDSException as error:
            lost(f"{self.place} is gone: {error}")


def _forget(entities: list[Any]) -> None:
    """Let entities leave, which they do when they are forgotten: a writer waits a second for
    acknowledgements.
    """
    entities.clear()
    gc.collect(0)


def _acknowledged(writer: Any) -> bool:
    """Return whether every reliable reader has acknowledged what was written."""
    try:
        return bool(writer.wait_for_acks(0))
    except AttributeError:  # what cyclonedds 11.0 says instead of False
        return False


class _Endpoints:
    """The readers or the writers that others have: DDS tells each of them, with
    its topic and type.
    """

    def __init__(self, participant: Any, topic: Any) -> None:
        self._own = participant.guid
        self._reader = BuiltinDataReader(participant, topic)
        self._known: dict[Any, tuple[str, str]] = {}

    def others(self) -> dict[str, frozenset[str]]:
        """Return their types by topic, both as ROS writes them."""
        for sample in self._reader.take(MOST_ENDPOINTS):
            if sample.topic_name is None:  # it has gone
                self._known.pop(sample.key, None)
            elif sample.participant_key != self._own and sample.topic_name.startswith("rt/"):
                kind = sample.type_name.replace("::msg::dds_::", "/").removesuffix("_")
                self._known[sample.key] = sample.topic_name.removeprefix("rt"), kind
        found: dict[str, set[str]] = {}
        for topic, kind in self._known.values():
            found.setdefault(topic, set()).add(kind)
        return {topic: frozenset(kinds) for topic, kinds in found.items()}
