"""ROS 1 and ROS 2 through rosbridge: JSON over a WebSocket, protocol version 2.

Needs `websockets` (the extra `rosbridge`). Options: `url`, `version` (1 or 2: which ROS is behind
it), and those of `ros.RosOptions`.
"""

import asyncio
import contextlib
import itertools
import json
import math
import re
from collections.abc import Callable, Iterable, Mapping
from typing import Annotated, Any
from urllib.parse import urlsplit

import msgspec
import structlog
from msgspec import Meta

from robots.agent.adapters.common.robot_profile import load_profile, settings_of
from robots.agent.adapters.common.send_slots import SendSlots
from robots.agent.adapters.common.sockets import make_prompt
from robots.agent.adapters.ros.base import DONE, Goals, Handler, RosAdapter, RosOptions
from robots.agent.adapters.ros.graph import Graph, TopicPeers
from robots.agent.robot_interface import AdapterError

try:
    from websockets.asyncio.client import ClientConnection, connect
    from websockets.exceptions import WebSocketException
except ImportError as error:
    raise ImportError("it needs websockets: pip install 'websockets>=13'") from error

ANSWER_TIME = 10.0
ROSAPI_TIME = 2.0
REFUSED = 2.0  # seconds after which what rosbridge refused is tried again
# internal/topics.py, TypeConflictException
ESTABLISHED = re.compile(r"established with type (\S+)")
CLOSING = 1.0
LARGEST = 16 << 20  # bytes of a message: maps and clouds that nobody asked for are larger
PING = 2.0  # seconds between pings, and until one counts as lost

log = structlog.stdlib.get_logger(__name__)


class RosbridgeOptions(RosOptions, frozen=True, kw_only=True):
    """Where rosbridge is, and which ROS is behind it."""

    url: str = "ws://127.0.0.1:9090"
    version: Annotated[int, Meta(ge=1, le=2)] = 1


def create(profile_name: str, options: Mapping[str, Any]) -> RosAdapter:
    """Return an adapter for a robot behind a rosbridge; nothing is connected yet.

    Raises:
        AdapterError: no such profile or option; one sentence.
    """
    robot = load_profile(profile_name)
    settings = settings_of(RosbridgeOptions, "rosbridge", robot, options)
    if not _is_address(settings.url):
        raise AdapterError(
            "url must be the address of rosbridge, such as ws://192.168.1.30:9090 or"
            f" wss://host:port, not {settings.url!r}"
        )
    return RosAdapter(
        robot,
        settings,
        RosbridgeBus(settings.url, settings.version),
        f"ROS {settings.version} (rosbridge)",
    )


class RosbridgeBus:
    """See ros.Bus."""

    answers = True
    forgotten: tuple[str, ...] = ()  # rosbridge says nothing of nodes

    def __init__(self, url: str, version: int) -> None:
        self.version, self.place = version, f"rosbridge at {url}"
        self._url = url
        self._outgoing: SendSlots[dict[str, Any]] = SendSlots()
        self._handlers: dict[str, Handler] = {}
        self._calls: dict[str, asyncio.Future[dict[str, Any]]] = {}
        self._ids = itertools.count(1)
        self._socket: ClientConnection | None = None
        self._task: asyncio.Task[None] | None = None
        self._goals: Goals | None = None
        self._graph: Graph | None = None
        self._advertised: dict[str, dict[str, Any]] = {}
        # by topic which refusal, and the type that it has, "" when rosbridge does not say
        self._refused: dict[str, tuple[int, str]] = {}

    async def open(self, lost: Callable[[str], None], goals: Goals) -> None:
        """Connect.

        Raises:
            AdapterError: nobody is there, or it is no rosbridge.
        """
        self._goals = goals
        self._outgoing.clear()
        self._handlers.clear()
        self._graph = None
        self._advertised.clear()
        self._refused.clear()
        try:
            self._socket = await connect(
                self._url,
                max_size=LARGEST,
                ping_interval=PING,
                ping_timeout=PING,
                close_timeout=CLOSING,
                compression=None,
            )
        except (OSError, WebSocketException, TimeoutError) as error:
            raise AdapterError(
                f"{self.place} does not answer: {error or type(error).__name__}"
            ) from error
        make_prompt(self._socket.transport.get_extra_info("socket"))
        self._task = asyncio.ensure_future(self._serve(self._socket, lost))

    async def ask(self) -> None:
        """Wait until rosbridge answers a ping of the WebSocket, and no service call keeps it from
        what it is told.

        It works off what a client says one after the other, and a service call as long as it takes
        (call_service.py).

        Raises:
            AdapterError: it is gone.
        """
        while self._calls:
            await asyncio.wait(self._calls.values())
        if self._socket is None:
            raise AdapterError(f"the connection to {self.place} is lost")
        try:
            await (await self._socket.ping())
        except (OSError, WebSocketException) as error:
            why = getattr(error, "strerror", None) or error
            raise AdapterError(f"the connection to {self.place} is lost: {why}") from error

    def cut(self) -> None:
        """Reset the connection."""
        if self._socket is not None:
            self._socket.transport.abort()

    async def shut(self) -> None:
        """Close the connection: rosbridge then forgets what we subscribed and advertised."""
        task, self._task = self._task, None
        socket, self._socket = self._socket, None
        if socket is not None:
            await self._flush(socket)
            await socket.close()
        if task is not None:
            task.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await task
        for call in self._calls.values():
            call.cancel()
        self._calls.clear()

    async def _flush(self, socket: ClientConnection) -> None:
        with contextlib.suppress(WebSocketException, TimeoutError):
            async with asyncio.timeout(CLOSING):
                while len(self._outgoing):
                    await socket.send(json.dumps(await self._outgoing.take()))

    async def _serve(self, socket: ClientConnection, lost: Callable[[str], None]) -> None:
        try:
            async with asyncio.TaskGroup() as tasks:
                tasks.create_task(self._send(socket))
                tasks.create_task(self._receive(socket))
        except* (OSError, WebSocketException) as errors:
            lost(f"{self.place} is gone: {errors.exceptions[0]}")

    async def _send(self, socket: ClientConnection) -> None:
        while True:
            message = await self._outgoing.take()
            await socket.send(json.dumps(message))

    async def _receive(self, socket: ClientConnection) -> None:
        while True:
            text = await socket.recv()
            try:
                message = msgspec.json.decode(_plain(text))
            except (msgspec.DecodeError, ValueError, RecursionError) as error:
                log.warning("rosbridge_message_malformed", extra={"reason": str(error)})
                continue
            if isinstance(message, dict):
                self._take(message)

    def _take(self, message: dict[str, Any]) -> None:
        match message:
            case {"op": "publish", "topic": str(topic), "msg": dict(content)} if (
                topic in self._handlers
            ):
                self._handlers[topic](content)
            case {"op": "service_response", "id": str(number)} if (
                number in self._calls and not self._calls[number].done()
            ):
                self._calls[number].set_result(message)
            case {"op": "action_feedback", "id": str(name)} if self._goals is not None:
                self._goals.accepted(name)
            case {"op": "action_result", "id": str(name)} if self._goals is not None:
                self._goal_ended(name, message)
            case {"op": "status", "level": "error" | "warning", "msg": text}:
                self._complained(message.get("id"), str(text))

    def _goal_ended(self, name: str, message: dict[str, Any]) -> None:
        assert self._goals is not None
        status = DONE[2].get(message.get("status", 0), "FAILED")
        if message.get("result") is False and status == "FINISHED":
            status = "FAILED"
        values = message.get("values")
        reason = values if isinstance(values, str) else ""
        self._goals.ended(
            name, status, "" if status == "FINISHED" else reason or "navigation gave up"
        )

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
        """Hear a topic: of each only the newest, for what waits is old."""
        del latched, sensor  # rosbridge takes the publisher's quality of service
        self._handlers[topic] = handler
        entry = {
            "op": "subscribe",
            "id": f"s{next(self._ids)}",
            "topic": topic,
            "type": self._type(kind),
            "queue_length": 1,
        }
        self._outgoing.say(entry | {"throttle_rate": round(period * 1000)})

    def advertise(self, topic: str, kind: str, *, drives: bool = False) -> None:
        """Say what will be published; of velocities rosbridge is to keep only the newest."""
        entry = {
            "op": "advertise",
            "id": f"a{next(self._ids)}",
            "topic": topic,
            "type": self._type(kind),
        }
        self._advertised[topic] = entry | ({"queue_size": 1} if drives else {})
        self._say_advertised(self._advertised[topic])

    def unadvertise(self, topic: str) -> None:
        """Say that nothing more will be published."""
        entry = self._advertised.pop(topic, None)
        if entry is not None:
            self._outgoing.say({"op": "unadvertise", "id": entry["id"], "topic": topic})

    def _advertise_again(self, entry: dict[str, Any]) -> None:
        """Try again what was refused: rosbridge keeps a publisher, and its type, for ten seconds
        after its last client.
        """
        if self._advertised.get(entry["topic"]) == entry and self._socket is not None:
            self._say_advertised(entry)

    def _say_advertised(self, entry: dict[str, Any]) -> None:
        self._outgoing.say(entry)
        if entry["topic"] in self._refused:
            asyncio.get_running_loop().call_later(
                REFUSED / 4, self._accept_refusal, entry["topic"], self._refused[entry["topic"]]
            )

    def _accept_refusal(self, topic: str, refusal: tuple[int, str]) -> None:
        """Take it that nothing is refused any more: rosbridge has not complained again, and says
        nothing else.
        """
        if self._refused.get(topic) == refusal:
            del self._refused[topic]

    def _complained(self, about: Any, text: str) -> None:
        log.warning("rosbridge_problem", extra={"text": text[:300]})
        for topic, entry in self._advertised.items():
            if entry["id"] == about:
                there = ESTABLISHED.search(text)
                self._refused[topic] = next(self._ids), _short(there[1]) if there else ""
                asyncio.get_running_loop().call_later(REFUSED, self._advertise_again, entry)

    def listeners(self, topic: str) -> int | None:
        """Return how many nodes listened when that was looked up last, none when we are refused;
        None where rosapi does not run.
        """
        if topic in self._refused:
            return 0
        known = (self._graph or {}).get(topic)
        return known.listeners if known is not None else None

    async def graph(self, driving: str, heard: Iterable[str]) -> Graph | None:
        """Ask rosapi."""
        try:
            listening = await self._values("/rosapi/subscribers", {"topic": driving}, ROSAPI_TIME)
            speaking = {
                topic: await self._values("/rosapi/publishers", {"topic": topic}, ROSAPI_TIME)
                for topic in heard
            }
            # last: whoever has just come has a type
            values = await self._values("/rosapi/topics", {}, ROSAPI_TIME)
            found = {
                str(topic): TopicPeers(frozenset({_short(kind)}))
                for topic, kind in zip(values["topics"], values["types"], strict=False)
            }
            for topic, answer in speaking.items():
                kinds = found.get(topic, TopicPeers()).kinds
                found[topic] = TopicPeers(kinds, speakers=len(answer["publishers"]))
            kinds = found.get(driving, TopicPeers()).kinds
            found[driving] = TopicPeers(kinds, listeners=len(listening["subscribers"]))
        except (AdapterError, KeyError, TypeError):
            found = {}
        if driving in self._refused:  # the only way to hear of it without rosapi
            there = self._refused[driving][1]
            found[driving] = TopicPeers(frozenset({there} if there else ()), listeners=1)
        self._graph = found or None
        return self._graph

    def publish(self, topic: str, message: dict[str, Any], *, newest: bool = False) -> None:
        """Send a message.

        Raises:
            AdapterError: the connection takes none.
        """
        letter = {"op": "publish", "topic": topic, "msg": message}
        if newest:
            self._outgoing.drive(letter)
        else:
            self._outgoing.say(letter)

    async def call(self, service: str, kind: str) -> tuple[bool, str]:
        """Call a service.

        Raises:
            AdapterError: there is none, or no answer.
        """
        values = await self._values(service, {}, ANSWER_TIME, kind)
        return bool(values.get("success")), str(values.get("message", ""))

    async def _values(
        self, service: str, arguments: dict[str, Any], within: float, kind: str = ""
    ) -> dict[str, Any]:
        number = f"c{next(self._ids)}"
        answer = self._calls[number] = asyncio.get_running_loop().create_future()
        entry = {"op": "call_service", "id": number, "service": service, "args": arguments}
        self._outgoing.say(entry | ({"type": self._type(kind, "srv")} if kind else {}))
        try:
            async with asyncio.timeout(within):
                response = await answer
        except TimeoutError as error:
            raise AdapterError(f"{service} does not answer") from error
        finally:
            self._calls.pop(number, None)
        values = response.get("values")
        if response.get("result") is False or not isinstance(values, dict):
            raise AdapterError(f"{service} cannot be called: {values}")
        return values

    def send_goal(self, action: str, kind: str, goal: dict[str, Any], name: str) -> None:
        """Send a goal.

        Raises:
            AdapterError: ROS 1 has its actions on topics.
        """
        if self.version == 1:
            raise AdapterError("rosbridge supports actions of ROS 2 only; set navigation=move_base")
        entry = {
            "op": "send_action_goal",
            "id": name,
            "action": action,
            "action_type": self._type(kind, "action"),
            "args": goal,
            "feedback": True,
        }
        self._outgoing.say(entry)

    def cancel_goal(self, action: str, name: str) -> None:
        """Take a goal back."""
        self._outgoing.say({"op": "cancel_action_goal", "id": name, "action": action})

    def _type(self, kind: str, group: str = "msg") -> str:
        return kind if self.version == 1 else kind.replace("/", f"/{group}/")


def _is_address(url: str) -> bool:
    try:
        parts = urlsplit(url)
        return parts.scheme in {"ws", "wss"} and bool(parts.hostname) and parts.port != 0
    except ValueError:
        return False


def _short(kind: str) -> str:
    """Return a type as ROS 1 writes it."""
    return str(kind).replace("/msg/", "/")


def _plain(text: str | bytes) -> bytes:
    """Return JSON without what is none: older rosbridges write NaN and Infinity."""
    data = text.encode() if isinstance(text, str) else text
    if b"NaN" in data or b"Infinity" in data:
        return json.dumps(_nulled(json.loads(data))).encode()
    return data


def _nulled(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _nulled(each) for key, each in value.items()}
    if isinstance(value, list):
        return [_nulled(each) for each in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
