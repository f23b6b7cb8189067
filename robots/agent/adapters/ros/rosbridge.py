"""ROS 1 and ROS 2 through rosbridge: JSON over a WebSocket, protocol version 2.

Options: `url`, `version` (1 or 2: which ROS is behind it), and those of `ros.RosOptions`.
"""

import asyncio
import contextlib
import itertools
import json
import math
import re
import secrets
import time
from collections.abc import Callable, Coroutine, Iterable, Mapping
from dataclasses import replace
from typing import Annotated, Any
from urllib.parse import urlsplit

import msgspec
import structlog
from msgspec import Meta
from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import WebSocketException

from robots.agent.adapters.common import remote_adapter
from robots.agent.adapters.common.robot_profile import load_profile, settings_of
from robots.agent.adapters.common.send_slots import SendSlots
from robots.agent.adapters.common.sockets import make_prompt
from robots.agent.adapters.ros.base import RosAdapter, RosOptions
from robots.agent.adapters.ros.bus import (
    ANSWER_TIME,
    GOAL_ENDED,
    Goals,
    Handler,
    Subscription,
    UnansweredError,
    result_of,
)
from robots.agent.adapters.ros.graph import Graph, TopicPeers
from robots.agent.robot_interface import ActionRefusedError, AdapterError
from robots.api.reasons import ReasonCode

ROSAPI_TIME = 2.0
REFUSED = 2.0  # seconds after which what rosbridge refused is tried again
# internal/topics.py, TypeConflictException
ESTABLISHED = re.compile(r"established with type (\S+)")
CLOSING = 1.0
LARGEST = 16 << 20  # bytes of a message; larger ones are maps and clouds
PING = 2.0  # seconds between pings, and until one counts as lost
PROBE_PERIOD = 0.1  # seconds between two probes until the first returns
BLOCKED = 1.0  # seconds of a goal or a service call, after which rosbridge's queue is blocked
CANCEL_TIME = 1.0
CANCEL_AGAIN = 0.5
IDLE = 1.0  # seconds without an active goal, after which a cancelled one never starts
ACTIVE = frozenset({1, 2, 3})  # action_msgs/GoalStatus: accepted, executing, cancelling
NEW_THREAD = "send_action_goals_in_new_thread"

log = structlog.stdlib.get_logger(__name__)


class RosbridgeOptions(RosOptions, frozen=True, kw_only=True):
    """Where rosbridge is, and which ROS is behind it."""

    url: str = "ws://127.0.0.1:9090"
    version: Annotated[int, Meta(ge=1, le=2)] = 1


def create(profile_name: str, options: Mapping[str, Any]) -> RosAdapter:
    """Return an adapter, not connected; AdapterError for a wrong profile or option."""
    robot = load_profile(profile_name)
    settings = settings_of(RosbridgeOptions, "rosbridge", robot, options)
    if not _is_address(settings.url):
        raise AdapterError(
            "url must be the address of rosbridge, such as ws://192.168.1.30:9090 or"
            f" wss://host:port, not {settings.url!r}"
        )
    uses_nav2 = settings.version == 2 and settings.navigation in {"", "nav2"}
    if settings.version == 1 and settings.navigation == "nav2":
        raise AdapterError("rosbridge supports actions of ROS 2 only; set navigation=move_base")
    navigate = settings.resolved().navigate if uses_nav2 else ""
    bus = RosbridgeBus(settings.url, settings.version, navigate)
    adapter = RosAdapter(robot, settings, bus, f"ROS {settings.version} (rosbridge)")
    # rosbridge answers for a base that hangs: at most one velocity waits for such a base
    adapter.gate_params = replace(remote_adapter.GATE, orders=1)
    return adapter


class RosbridgeBus:
    """See bus.Bus. `navigate` is Nav2's action, "" without it.

    rosbridge_server puts each message of a client into a queue that one thread processes in order
    (websocket_handler.py, IncomingQueue), while Tornado's loop answers the WebSocket's pings. So
    the probe is a message on a topic of its own that returns through the same queue and through
    ROS.

    rosbridge chooses the ids of goals and cancels only those of the same client
    (send_action_goal.py), so the action's own cancel service cancels all goals: ours cannot be
    distinguished from others.
    """

    answers = True
    advice = ""
    guards = False
    connect_time: float | None = None
    problems: tuple[str, ...] = ()

    def __init__(self, url: str, version: int, navigate: str = "") -> None:
        self.version, self.place = version, f"rosbridge at {url}"
        self._url = url
        self._navigate = navigate
        self._lost: Callable[[str], None] = lambda _reason: None
        self._probe_topic = ""
        self._probe_sent = self._probe_came = 0
        self._probe_event = asyncio.Event()
        self._sent: set[str] = set()  # our goals that have not ended
        self._idle_since: dict[str, float] = {}  # by goal: since when no goal is active
        self._active: frozenset[str] = frozenset()  # active goals by the action's status
        self._leftovers = False  # whether a goal of before this connection may be active
        self._work: set[asyncio.Task[None]] = set()
        self._outgoing: SendSlots[dict[str, Any]] = SendSlots()
        self._handlers: dict[str, Handler] = {}
        self._calls: dict[str, asyncio.Future[dict[str, Any]]] = {}
        self._ids = itertools.count(1)
        self._socket: ClientConnection | None = None
        self._task: asyncio.Task[None] | None = None
        self._goals: Goals | None = None
        self._graph: Graph | None = None
        self._advertised: dict[str, dict[str, Any]] = {}
        # by topic: number of the refusal, and the topic's type, "" when unknown
        self._refused: dict[str, tuple[int, str]] = {}

    async def open(self, lost: Callable[[str], None], goals: Goals) -> None:
        self._goals, self._lost = goals, lost
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
            reason = str(error) or type(error).__name__
            raise AdapterError(f"{self.place} does not answer: {reason}") from error
        make_prompt(self._socket.transport.get_extra_info("socket"))
        self._task = asyncio.ensure_future(self._serve(self._socket, lost))
        if self._navigate:
            await self._open_navigation()
        await self._open_probe()

    def tell_guard(self, **message: Any) -> None:
        """Do nothing: nothing runs on the robot's side."""

    async def _open_probe(self) -> None:
        """Wait until a probe returns: ROS loses messages published before both ends connect."""
        self._probe_topic = f"/telepresence_probe/p{secrets.token_hex(4)}"
        self._probe_sent = self._probe_came = 0
        kind = "std_msgs/UInt32"
        self.advertise(self._probe_topic, kind)
        self.subscribe(Subscription(self._probe_topic, kind, self._take_probe))
        while self._probe_came == 0:
            self._probe()
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(PROBE_PERIOD):
                    await self._wait_for_probe(1)

    def _probe(self) -> int:
        self._probe_sent += 1
        self.publish(self._probe_topic, {"data": self._probe_sent})
        return self._probe_sent

    def _take_probe(self, message: dict[str, Any]) -> None:
        self._probe_came = max(self._probe_came, int(message.get("data", 0)))
        self._probe_event.set()

    async def _wait_for_probe(self, number: int) -> None:
        while self._probe_came < number:
            self._probe_event.clear()
            await self._probe_event.wait()

    async def ask(self) -> None:
        """Wait until a probe has returned through rosbridge's queue."""
        if self._socket is None:
            raise AdapterError(f"the connection to {self.place} is lost")
        await self._wait_for_probe(self._probe())

    def _watch_queue(self, reason: str) -> None:
        """Give up a connection whose queue is blocked: not even a cancel would pass."""
        self._start(self._prove_queue(reason))

    def _start(self, work: Coroutine[Any, Any, None]) -> None:
        task = asyncio.ensure_future(work)
        self._work.add(task)
        task.add_done_callback(self._work.discard)

    async def _prove_queue(self, reason: str) -> None:
        try:
            async with asyncio.timeout(BLOCKED):
                await self.ask()
        except TimeoutError:
            self._lost(f"{self.place} is blocked by {reason}")
        except AdapterError:
            pass  # its reader has reported it

    def cut(self) -> None:
        if self._socket is not None:
            self._socket.transport.abort()

    async def shut(self) -> None:
        """Close the connection: rosbridge then forgets what we subscribed and advertised."""
        for work in self._work:
            work.cancel()
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
                message = _decoded(text)
            except (ValueError, RecursionError) as error:
                log.warning("rosbridge_message_malformed", reason=str(error))
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
        status, values = message.get("status"), message.get("values")
        why = values if isinstance(values, str) else ""
        reason = ReasonCode.RCA.of(why) if why else ReasonCode.NAVIGATION_FAILED
        if message.get("result") is False or status not in GOAL_ENDED:
            self._goals.failed(name, reason)  # rosbridge has failed; the goal may run
            return
        self._forget(name)
        self._goals.ended(name, GOAL_ENDED[status], "" if status == 4 else reason)

    def _forget(self, name: str) -> None:
        self._sent.discard(name)
        self._idle_since.pop(name, None)

    def subscribe(self, subscription: Subscription) -> None:
        """Subscribe with the publisher's quality of service; only the newest message is queued."""
        self._handlers[subscription.topic] = subscription.handler
        self._outgoing.say(
            {
                "op": "subscribe",
                "id": f"s{next(self._ids)}",
                "topic": subscription.topic,
                "type": self._type(subscription.kind),
                "queue_length": 1,
                "throttle_rate": round(subscription.period * 1000),
            }
        )

    def advertise(
        self, topic: str, kind: str, *, drives: bool = False, latch: bool = False
    ) -> None:
        former = self._advertised.pop(topic, None)
        if former is not None:
            self._outgoing.say({"op": "unadvertise", "id": former["id"], "topic": topic})
        entry = {
            "op": "advertise",
            "id": f"a{next(self._ids)}",
            "topic": topic,
            "type": self._type(kind),
            "latch": latch,
        }
        # of velocities, rosbridge keeps only the newest
        self._advertised[topic] = entry | ({"queue_size": 1} if drives else {})
        self._say_advertised(self._advertised[topic])

    def _advertise_again(self, entry: dict[str, Any]) -> None:
        """Retry a refused topic: rosbridge keeps a publisher, and its type, for ten seconds after
        its last client.
        """
        if self._advertised.get(entry["topic"]) == entry and self._socket is not None:
            self._say_advertised(entry)

    def _say_advertised(self, entry: dict[str, Any]) -> None:
        self._outgoing.say(entry)
        if entry["topic"] in self._refused:
            asyncio.get_running_loop().call_later(
                REFUSED / 4, self._end_refusal, entry["topic"], self._refused[entry["topic"]]
            )

    def _end_refusal(self, topic: str, refusal: tuple[int, str]) -> None:
        """End a refusal that rosbridge has not repeated; it reports no success."""
        if self._refused.get(topic) == refusal:
            del self._refused[topic]

    def _complained(self, about: Any, text: str) -> None:
        log.warning("rosbridge_problem", text=text[:300])
        for topic, entry in self._advertised.items():
            if entry["id"] == about:
                there = ESTABLISHED.search(text)
                self._refused[topic] = next(self._ids), _short(there[1]) if there else ""
                asyncio.get_running_loop().call_later(REFUSED, self._advertise_again, entry)

    def listeners(self, topic: str) -> int | None:
        """See Bus: the number at the last `graph`, 0 while refused, None without rosapi."""
        if topic in self._refused:
            return 0
        known = (self._graph or {}).get(topic)
        return known.subscribers if known is not None else None

    async def graph(self, driving: str, received: Iterable[str]) -> Graph | None:
        try:
            listening = await self._values("/rosapi/subscribers", {"topic": driving}, ROSAPI_TIME)
            speaking = {
                topic: await self._values("/rosapi/publishers", {"topic": topic}, ROSAPI_TIME)
                for topic in received
            }
            # last: a new node has a type
            values = await self._values("/rosapi/topics", {}, ROSAPI_TIME)
            found = {
                str(topic): TopicPeers(frozenset({_short(kind)}))
                for topic, kind in zip(values["topics"], values["types"], strict=False)
            }
            for topic, answer in speaking.items():
                kinds = found.get(topic, TopicPeers()).kinds
                found[topic] = TopicPeers(kinds, publishers=len(answer["publishers"]))
            kinds = found.get(driving, TopicPeers()).kinds
            found[driving] = TopicPeers(kinds, subscribers=len(listening["subscribers"]))
        except (AdapterError, KeyError, TypeError):
            found = {}
        if driving in self._refused:  # without rosapi, the refusal is the only sign of it
            there = self._refused[driving][1]
            found[driving] = TopicPeers(frozenset({there} if there else ()), subscribers=1)
        self._graph = found or None
        return self._graph

    def publish(self, topic: str, message: dict[str, Any], *, newest: bool = False) -> None:
        entry = {"op": "publish", "topic": topic, "msg": message}
        if newest:
            self._outgoing.drive(entry)
        else:
            self._outgoing.say(entry)

    async def call(
        self,
        service: str,
        kind: str,
        arguments: dict[str, Any] | None = None,
        *,
        within: float = ANSWER_TIME,
    ) -> tuple[bool, str]:
        answering = asyncio.ensure_future(self._values(service, arguments or {}, within, kind))
        self._watch_queue(f"the service {service}: set call_services_in_new_thread to true")
        return result_of(service, await answering, problem="", is_absent=False)

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
            raise UnansweredError(f"{service} does not answer") from error
        finally:
            self._calls.pop(number, None)
        values = response.get("values")
        if response.get("result") is False or not isinstance(values, dict):
            # internal/services.py, InvalidServiceException; another failure may be its own time-out
            is_absent = isinstance(values, str) and "does not exist" in values
            kind_of_error = ActionRefusedError if is_absent else UnansweredError
            raise kind_of_error(f"{service} cannot be called: {values}")
        return values

    # --- Nav2 -------------------------------------------------------------------------------------

    async def _open_navigation(self) -> None:
        """Cancel what an earlier connection has left, and refuse a rosbridge that a goal blocks."""
        self._idle_since.clear()
        self._active = frozenset()
        self._leftovers = False
        topic, kind = f"{self._navigate}/_action/status", "action_msgs/GoalStatusArray"
        self.subscribe(Subscription(topic, kind, self._take_status, latched=True))
        self._leftovers = True
        with contextlib.suppress(AdapterError):
            self._leftovers = await self._cancel_all()
        if self._leftovers:
            self._start(self._cancel_leftovers())
        arguments = {"name": f"/rosbridge_websocket:{NEW_THREAD}", "default": ""}
        values = {}
        with contextlib.suppress(AdapterError):
            values = await self._values("/rosapi/get_param", arguments, ROSAPI_TIME)
        if str(values.get("value")).lower() == "false":
            raise AdapterError(
                f"{self.place} would be blocked by each goal: set its {NEW_THREAD} to true"
            )

    async def _cancel_all(self) -> bool:
        """Cancel all goals of Nav2 (an id and a time of zero, action_msgs/CancelGoal); return
        whether one may be active. Raises AdapterError when the service does not answer.
        """
        try:
            service = f"{self._navigate}/_action/cancel_goal"
            values = await self._values(service, {}, CANCEL_TIME)
        except ActionRefusedError:
            return False  # Nav2 does not run
        return bool(values.get("goals_canceling") or self._active)

    async def _cancel_leftovers(self) -> None:
        while self._leftovers:
            await asyncio.sleep(CANCEL_AGAIN)
            with contextlib.suppress(AdapterError):
                self._leftovers = await self._cancel_all()

    def _take_status(self, message: dict[str, Any]) -> None:
        self._active = frozenset(
            str(entry.get("goal_info", {}).get("goal_id", {}).get("uuid"))
            for entry in message.get("status_list", ())
            if entry.get("status") in ACTIVE
        )
        if self._active and self._goals is not None:
            for name in self._sent:
                self._goals.accepted(name)

    def send_goal(self, action: str, kind: str, goal: dict[str, Any], name: str) -> None:
        if self._leftovers:
            raise ActionRefusedError(ReasonCode.NAVIGATION_DOES_NOT_END)
        self._sent.add(name)
        self._outgoing.say(
            {
                "op": "send_action_goal",
                "id": name,
                "action": action,
                "action_type": self._type(kind, "action"),
                "args": goal,
                "feedback": True,
            }
        )
        self._watch_queue(f"the goal: set its {NEW_THREAD} to true")

    async def cancel_goal(self, action: str, name: str) -> bool:
        """Cancel a goal, by its id and by the cancel service; return True when its result has
        arrived, or no goal has been active for a second: a rejected one has no result
        (internal/actions.py, SendGoal.goal_response_cb).
        """
        if name not in self._sent:
            return True
        self._outgoing.say({"op": "cancel_action_goal", "id": name, "action": action})
        if await self._cancel_all():
            self._idle_since.pop(name, None)
            return False
        if time.monotonic() - self._idle_since.setdefault(name, time.monotonic()) < IDLE:
            return False
        self._forget(name)
        return True

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


def _decoded(text: str | bytes) -> Any:
    """Read JSON, with None for the NaN and Infinity of older rosbridges; raises ValueError."""
    try:
        return msgspec.json.decode(text)
    except msgspec.DecodeError:
        return _nulled(json.loads(text))


def _nulled(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _nulled(each) for key, each in value.items()}
    if isinstance(value, list):
        return [_nulled(each) for each in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
