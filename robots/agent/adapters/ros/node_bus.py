"""A bus over a node in a process of its own (ros1_node.py, ros2_node.py), in the Python that ROS
was built for, and a loopback connection to it: one JSON object a line.
"""

import asyncio
import contextlib
import itertools
import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

import msgspec

from robots.agent.adapters.common.child_process import connect_child, send_token, start
from robots.agent.adapters.ros.bus import (
    ANSWER_TIME,
    Goals,
    Handler,
    Subscription,
    UnansweredError,
    result_of,
)
from robots.agent.adapters.ros.graph import Graph, TopicPeers
from robots.agent.robot_interface import AdapterError
from robots.process.ending import wait_or_kill

START_TIME = 15.0  # seconds for a node to start: more than 5 on a loaded computer
GRAPH_TIME = 5.0
END_TIME = 2.0
BEAT = 0.1  # seconds between two heartbeats for the guard
BACKLOG = 256 << 10
STANDARD_ERROR = 2
# of Docker and Podman
CONTAINER = (Path("/.dockerenv"), Path("/run/.containerenv")) if sys.platform == "linux" else ()


class NodeBus:
    """See bus.Bus. One child process for each connection, because rospy cannot start twice in one.

    The child is also the guard of the robot's navigation. It outlives this process, and this
    connection for as long as something of ours may move the robot. Its heartbeat is sent by the
    event loop that the control loop runs on: when that hangs, the guard acts.
    """

    version: int
    answers: bool
    advice: str
    script: Path
    graph_source: str
    connect_time: float | None = 20.0
    arguments: tuple[str, ...] = ()  # of the script, after the port
    refusal_prefix = ""  # of the reason why a node did not start

    def __init__(
        self, place: str, python: str, environment: dict[str, str], *, guards: bool
    ) -> None:
        self.place, self._python, self._environment = place, python, environment
        self._environment.pop("PYTHONHOME", None)  # that of the agent's Python
        self.guards = guards
        self._reported: tuple[str, ...] = ()  # problems that the node reported
        self._lost: Callable[[str], None] = lambda _reason: None
        self._child: subprocess.Popen[bytes] | None = None
        self._guards_left: list[subprocess.Popen[bytes]] = []  # of earlier connections
        self._goals: Goals | None = None
        self._writer: asyncio.StreamWriter | None = None
        self._tasks: tuple[asyncio.Task[None], ...] = ()
        self._handlers: dict[str, Handler] = {}
        self._calls: dict[int, asyncio.Future[dict[str, Any]]] = {}
        self._listeners: dict[str, int] = {}
        self._numbers = itertools.count(1)

    @property
    def problems(self) -> tuple[str, ...]:
        return self._reported

    async def open(self, lost: Callable[[str], None], goals: Goals) -> None:
        self._lost, self._goals, self._reported = lost, goals, ()
        self._handlers.clear()
        self._listeners.clear()
        try:
            reader, self._writer = await connect_child(self._launch, START_TIME)
        except (OSError, TimeoutError) as error:
            raise AdapterError(f"the ROS node did not start with {self._python}") from error
        ready = asyncio.get_running_loop().create_future()
        self._tasks = (
            asyncio.ensure_future(self._read(reader, ready)),
            asyncio.ensure_future(self._beat()),
        )
        await ready

    def _launch(self, port: int, token: str) -> subprocess.Popen[bytes]:
        try:
            self._child = start(
                [self._python, str(self.script), str(port), *self.arguments],
                self._environment,
                stdin=subprocess.PIPE,
                stdout=STANDARD_ERROR,  # Fast DDS logs on standard output, which is the command's
            )
        except OSError as error:
            reason = error.strerror or error
            raise AdapterError(f"{self._python} cannot be run: {reason}") from error
        send_token(self._child, token)
        return self._child

    async def _beat(self) -> None:
        with contextlib.suppress(AdapterError):  # the reader reports the loss
            while True:
                self._say(op="beat")
                await asyncio.sleep(BEAT)

    async def _read(self, reader: asyncio.StreamReader, ready: asyncio.Future[None]) -> None:
        reason = "the ROS node has ended"
        with contextlib.suppress(OSError, ValueError):
            while line := await reader.readline():
                message = msgspec.json.decode(line)
                if message["op"] == "ready" and not ready.done():
                    ready.set_result(None)
                elif message["op"] == "lost":
                    reason = str(message["reason"])
                    break
                self._take(message)
        if ready.done():
            self._lost(reason)
        else:
            ready.set_exception(AdapterError(self.refusal_prefix + reason))

    def _take(self, message: dict[str, Any]) -> None:
        match message:
            case {"op": "publish", "topic": topic, "content": content} if topic in self._handlers:
                self._handlers[topic](content)
            case {"op": "response", "number": number} if (
                number in self._calls and not self._calls[number].done()
            ):
                self._calls[number].set_result(message)
            case {"op": "problems", "sentences": sentences}:
                self._reported = tuple(sentences)
            case {"op": "docking_cancelled"} if self._goals is not None:
                self._goals.docking_cancelled()
            case {"op": "listeners", "topic": topic, "count": int(count)} if (
                topic in self._listeners
            ):
                self._listeners[topic] = count
                if count and self._guards_left:  # this connection's zeros reach the base
                    left, self._guards_left = self._guards_left, []
                    asyncio.get_running_loop().run_in_executor(None, _end, left)

    async def shut(self) -> None:
        tasks, self._tasks = self._tasks, ()
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        if self._writer is not None:
            self._writer.close()
            self._writer = None
        for call in self._calls.values():
            call.cancel()
        self._calls.clear()
        child, self._child = self._child, None
        if child is not None and not await asyncio.to_thread(_has_ended, child):
            self._guards_left.append(child)

    def cut(self) -> None:
        if self._writer is not None:
            self._writer.transport.abort()

    def tell_guard(self, **message: Any) -> None:
        self._say(**message)

    def subscribe(self, subscription: Subscription) -> None:
        self._handlers[subscription.topic] = subscription.handler
        self._say(
            op="subscribe",
            topic=subscription.topic,
            kind=subscription.kind,
            period=subscription.period,
            latched=subscription.latched or subscription.either,
            essential=subscription.essential,
        )

    def advertise(
        self, topic: str, kind: str, *, drives: bool = False, latch: bool = False
    ) -> None:
        self._listeners.pop(topic, None)
        self._say(op="advertise", topic=topic, kind=kind, latch=latch, drives=drives)
        if drives:
            self._listeners[topic] = 0

    def listeners(self, topic: str) -> int | None:
        return self._listeners.get(topic)

    async def ask(self) -> None:
        await self._answer(None, op="ask")

    async def graph(self, driving: str, received: Iterable[str]) -> Graph | None:
        del received  # the node describes all topics
        try:
            answer = await self._answer(GRAPH_TIME, op="graph", driving=driving, **self._before())
        except TimeoutError as error:
            raise AdapterError(f"{self.place}: {self.graph_source} does not answer") from error
        self._described(answer)
        return {
            str(topic): TopicPeers(frozenset(kinds), subscribers, publishers)
            for topic, (kinds, subscribers, publishers) in answer.get("topics", {}).items()
        }

    def _before(self) -> dict[str, Any]:
        """Return what the node needs to know of earlier connections."""
        return {}

    def _described(self, answer: dict[str, Any]) -> None:
        """Take the node's description of the graph."""

    def publish(self, topic: str, message: dict[str, Any], *, newest: bool = False) -> None:
        if newest:
            at = time.monotonic()
            self._say(op="drive", topic=topic, content=message, moving=_moves(message), at=at)
        else:
            self._say(op="publish", topic=topic, content=message)

    async def call(
        self,
        service: str,
        kind: str,
        arguments: dict[str, Any] | None = None,
        *,
        within: float = ANSWER_TIME,
    ) -> tuple[bool, str]:
        request = {"service": service, "kind": kind, "arguments": arguments or {}}
        try:
            answer = await self._answer(within, op="call", **request)
        except TimeoutError as error:
            raise UnansweredError(f"{service} does not answer") from error
        return result_of(
            service,
            answer.get("values"),
            problem=answer.get("problem"),
            is_absent=bool(answer.get("absent")),
        )

    async def _answer(self, within: float | None, **message: Any) -> dict[str, Any]:
        """Send a message and return its answer; raises TimeoutError after `within` seconds."""
        number = next(self._numbers)
        answer: asyncio.Future[dict[str, Any]] = asyncio.get_running_loop().create_future()
        self._calls[number] = answer
        try:
            self._say(number=number, **message)
            async with asyncio.timeout(within):
                return await answer
        finally:
            self._calls.pop(number, None)

    def _say(self, **message: Any) -> None:
        writer = self._writer
        if writer is None or writer.transport.is_closing():
            raise AdapterError("the connection to the ROS node is lost")
        if writer.transport.get_write_buffer_size() > BACKLOG:
            raise AdapterError("the ROS node has stopped reading messages")
        writer.write((json.dumps(message) + "\n").encode())


def _moves(message: Mapping[str, Any]) -> bool:
    twist = message.get("twist", message)
    return bool(twist["linear"]["x"] or twist["angular"]["z"])


def outlives_agent() -> bool:
    """Return whether a child process outlives the agent: not in a container that ends with it."""
    return 1 not in {os.getpid(), os.getppid()} or not any(map(Path.exists, CONTAINER))


def _has_ended(child: subprocess.Popen[bytes]) -> bool:
    """Wait END_TIME for a node to exit; return False for one that still guards the robot."""
    try:
        child.wait(timeout=END_TIME)
    except subprocess.TimeoutExpired:
        return False
    return True


def _end(children: list[subprocess.Popen[bytes]]) -> None:
    for child in children:
        child.terminate()
        wait_or_kill(child, END_TIME)
