"""ROS 1: a node in a process of its own (ros1_node.py), in the Python that ROS was built for, and a
loopback connection to it.

Needs rospy: Debian and Ubuntu have it as `python3-rospy`, ROS itself brings it. Options: `master`
(default: ROS_MASTER_URI), `ip` (how others reach this computer: ROS_IP), `python` (the interpreter
that has rospy), and those of `ros.RosOptions`.
"""

import asyncio
import contextlib
import hmac
import itertools
import json
import os
import secrets
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import structlog

from robots.agent.adapters.common.robot_profile import load_profile, settings_of
from robots.agent.adapters.ros.base import RosAdapter, RosOptions
from robots.agent.adapters.ros.bus import ANSWER_TIME, Goals, Handler
from robots.agent.adapters.ros.graph import Graph, TopicPeers
from robots.agent.robot_interface import ActionRefusedError, AdapterError

START_TIME = 15.0  # seconds for rospy to start: more than 5 on a loaded computer
GRAPH_TIME = 5.0
END_TIME = 2.0
BEAT = 0.1  # seconds between two heartbeats for the guard
BACKLOG = 256 << 10
UNCONNECTED = (
    10.0  # seconds after which a node that listens for velocities is taken to have given up
)
LONGEST_LINE = 8 << 20
NODE = Path(__file__).with_name("ros1_node.py")
# of Docker and Podman
CONTAINER = (Path("/.dockerenv"), Path("/run/.containerenv")) if sys.platform == "linux" else ()

log = structlog.stdlib.get_logger(__name__)


class Ros1Options(RosOptions, frozen=True, kw_only=True):
    """Where the master is, and which Python has rospy."""

    master: str = ""
    ip: str = ""
    python: str = "python" if sys.platform == "win32" else "/usr/bin/python3"


def create(profile_name: str, options: Mapping[str, Any]) -> RosAdapter:
    """Return an adapter for a robot of ROS 1; nothing is started yet.

    Raises:
        AdapterError: no such profile or option; one sentence.
    """
    robot = load_profile(profile_name)
    settings = settings_of(Ros1Options, "ros1", robot, options)
    if settings.navigation == "nav2":
        raise AdapterError("with ROS 1, navigation must be move_base or none")
    return RosAdapter(robot, settings, NodeBus(settings), "ROS 1")


class NodeBus:
    """See bus.Bus. One child process for each connection, because rospy cannot start twice in one.

    The child is also the guard of the robot's navigation (ros1_node.py). It outlives this process,
    and this connection for as long as something of ours may move the robot. It counts as a guard
    only on the computer of the ROS master, where no cut link separates it from the robot, and not
    in a container that ends with the agent.
    """

    version = 1
    answers = True
    connect_time: float | None = 20.0
    problems: tuple[str, ...] = ()
    advice = "run the agent on the computer of the ROS master, or "
    script = NODE
    arguments: tuple[str, ...] = ()  # of the script, after the port

    def __init__(self, options: Ros1Options) -> None:
        uri = _master_of(options)
        self.guards = outlives_agent() and _is_here(urlsplit(uri).hostname or "")
        environment = {**os.environ, "ROS_MASTER_URI": uri, "ROS_PYTHON_LOG_CONFIG_FILE": ""}
        if options.ip:
            environment["ROS_IP"] = options.ip
        self._prepare(f"ROS 1 at {uri}", options.python, environment)

    def _prepare(self, place: str, python: str, environment: dict[str, str]) -> None:
        self.place, self._python, self._environment = place, python, environment
        self._environment.pop("PYTHONHOME", None)  # that of the agent's Python
        self._lost: Callable[[str], None] = lambda _reason: None
        self._child: subprocess.Popen[bytes] | None = None
        self._guards_left: list[subprocess.Popen[bytes]] = []  # of earlier connections
        self._goals: Goals | None = None
        self._beating: asyncio.Task[None] | None = None
        self._writer: asyncio.StreamWriter | None = None
        self._reading: asyncio.Task[None] | None = None
        self._handlers: dict[str, Handler] = {}
        self._calls: dict[int, asyncio.Future[dict[str, Any]]] = {}
        self._listeners: dict[str, int] = {}
        # slave API by name, of the nodes that the master knows, and of those that it knew on an
        # earlier connection, does not know now, and that run all the same
        self.known: dict[str, str] = {}
        self._old: dict[str, str] = {}
        self._numbers = itertools.count(1)
        self._unconnected_since: float | None = None
        self._begun_anew = False

    async def open(self, lost: Callable[[str], None], goals: Goals) -> None:
        """Start a node and wait until the master knows it.

        Raises:
            AdapterError: there is no master, or no rospy.
        """
        self._lost, self._goals = lost, goals
        self._unconnected_since = None
        self._handlers.clear()
        self._listeners.clear()
        self._old |= self.known
        self.known = {}
        reader, self._writer = await self._start()
        first = await self._line(reader)
        if first.get("op") != "ready":
            raise AdapterError(str(first.get("reason", f"{self.place}: the node ended")))
        self._reading = asyncio.ensure_future(self._read(reader, lost))
        self._beating = asyncio.ensure_future(self._beat())

    def tell_guard(self, **message: Any) -> None:
        """Send the child what it guards."""
        self._say(**message)

    def _end_earlier_guards(self) -> None:
        """End the guards of earlier connections, once this one's zeros reach the base."""
        left, self._guards_left = self._guards_left, []
        if left:
            asyncio.get_running_loop().run_in_executor(None, _end, left)

    async def _beat(self) -> None:
        with contextlib.suppress(AdapterError):  # its reader reports the loss
            while True:
                self._say(op="beat")
                await asyncio.sleep(BEAT)

    async def _start(self) -> tuple[asyncio.StreamReader, asyncio.StreamWriter]:
        arrived: asyncio.Future[tuple[asyncio.StreamReader, asyncio.StreamWriter]] = (
            asyncio.get_running_loop().create_future()
        )
        password = secrets.token_hex(16)

        async def greet(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
            line = (await reader.readline()).strip()
            if hmac.compare_digest(line, password.encode()) and not arrived.done():
                arrived.set_result((reader, writer))
            else:
                writer.close()

        server = await asyncio.start_server(greet, "127.0.0.1", 0, limit=LONGEST_LINE)
        try:
            port = server.sockets[0].getsockname()[1]
            self._child = await asyncio.to_thread(self._launch, port, password)
            async with asyncio.timeout(START_TIME):
                return await arrived
        except TimeoutError as error:
            raise AdapterError(f"the ROS node did not start with {self._python}") from error
        finally:
            server.close()

    def _launch(self, port: int, password: str) -> subprocess.Popen[bytes]:
        command = [self._python, str(self.script), str(port), *self.arguments]
        flags = getattr(subprocess, "CREATE_NEW_PROCESS_GROUP", 0)
        try:
            child = subprocess.Popen(
                command,
                stdin=subprocess.PIPE,
                start_new_session=True,
                creationflags=flags,
                env=self._environment,
            )
        except OSError as error:
            raise AdapterError(
                f"{self._python} cannot be run: {error.strerror or error}"
            ) from error
        assert child.stdin is not None
        child.stdin.write(f"{password}\n".encode())
        child.stdin.flush()
        return child

    async def _line(self, reader: asyncio.StreamReader) -> dict[str, Any]:
        try:
            async with asyncio.timeout(START_TIME):
                line = await reader.readline()
        except TimeoutError as error:
            raise AdapterError(
                f"{self.place}: the ROS node has not started within {START_TIME:.0f} s"
            ) from error
        return json.loads(line) if line else {}

    async def _read(self, reader: asyncio.StreamReader, lost: Callable[[str], None]) -> None:
        reason = "the ROS node has ended"
        with contextlib.suppress(OSError, ValueError):
            while line := await reader.readline():
                said: dict[str, Any] = json.loads(line)
                match said:
                    case {"op": "publish", "topic": topic, "content": content} if (
                        topic in self._handlers
                    ):
                        self._handlers[topic](content)
                    case {"op": "response", "number": number} if (
                        number in self._calls and not self._calls[number].done()
                    ):
                        self._calls[number].set_result(said)
                    case {"op": "listeners", "topic": topic, "count": int(count)} if (
                        topic in self._listeners
                    ):
                        self._listeners[topic] = count
                        if count:
                            self._end_earlier_guards()
                    case {"op": "gone"} if self._goals is not None:
                        self._goals.server_gone()
                    case {"op": "lost", "reason": why}:
                        reason = str(why)
                        break
        lost(reason)

    async def shut(self) -> None:
        """Close the connection: the node stops the robot, cancels what is ours, and exits then."""
        tasks = [task for task in (self._reading, self._beating) if task is not None]
        self._reading = self._beating = None
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

    def subscribe(
        self,
        topic: str,
        kind: str,
        handler: Handler,
        *,
        latched: bool = False,
        either: bool = False,
        sensor: bool = False,
        period: float = 0.0,
    ) -> None:
        """Subscribe to a topic."""
        del latched, either, sensor  # the publisher of ROS 1 alone decides
        self._handlers[topic] = handler
        self._say(op="subscribe", topic=topic, kind=kind, period=period)

    def advertise(
        self, topic: str, kind: str, *, drives: bool = False, latch: bool = False
    ) -> None:
        """Advertise a topic; a new subscriber of velocities receives a zero first."""
        self._listeners.pop(topic, None)
        self._say(op="advertise", topic=topic, kind=kind, latch=latch, drives=drives)
        if drives:
            self._listeners[topic] = 0

    def unadvertise(self, topic: str) -> None:
        """Say that nothing more will be published."""
        self._say(op="unadvertise", topic=topic)

    async def ask(self) -> None:
        """Wait until every node that listens for velocities has said that it lives.

        Raises:
            AdapterError: the node is gone.
        """
        await self._answer(lambda number: self._say(op="ask", number=number))

    def cut(self) -> None:
        """Abort the connection: the node sends no more velocities of ours, only zeros."""
        if self._writer is not None:
            self._writer.transport.abort()

    def listeners(self, topic: str) -> int | None:
        """Return how many nodes are connected to hear a topic that drives."""
        return self._listeners.get(topic)

    async def graph(self, driving: str, heard: Iterable[str]) -> Graph | None:
        """Ask the master, and nodes that it has forgotten whether they run."""
        del heard
        try:
            async with asyncio.timeout(GRAPH_TIME):
                answer = await self._answer(
                    lambda number: self._say(
                        op="graph", number=number, driving=driving, old=self._old
                    )
                )
        except TimeoutError as error:
            raise AdapterError(f"{self.place}: the ROS master does not answer") from error
        if "nodes" in answer:
            self.known = answer["nodes"]
            self._old = {name: self._old[name] for name in answer["forgotten"]}
        found = {
            str(topic): TopicPeers(frozenset(kinds), listeners, speakers)
            for topic, (kinds, listeners, speakers) in answer.get("topics", {}).items()
        }
        self._reach_again(driving, found.get(driving, TopicPeers()), time.monotonic())
        return found

    def _reach_again(self, driving: str, peers: TopicPeers, now: float) -> None:
        """Begin anew as another publisher, once, for who listens, was not refused and does not
        connect.

        rospy gives up on a publisher that was away when it tried again, and takes no later news of
        the same one (rospy/impl/tcpros_pubsub.py, robust_connect_subscriber). Once, because the
        master also keeps who has crashed.
        """
        connected = self._listeners.get(driving)
        if connected or not peers.listeners or peers.kinds:
            self._unconnected_since = None
            self._begun_anew = self._begun_anew and not connected
        elif self._unconnected_since is None:
            self._unconnected_since = now
        elif now - self._unconnected_since > UNCONNECTED and not self._begun_anew:
            self._begun_anew = True
            self._lost(f"a node listens on {driving} and does not connect: connecting again")

    @property
    def forgotten(self) -> tuple[str, ...]:
        """Return the nodes that run and that the master does not know any more."""
        return tuple(self._old)

    def publish(self, topic: str, message: dict[str, Any], *, newest: bool = False) -> None:
        """Send a message.

        Raises:
            AdapterError: the node is gone, or does not read.
        """
        if newest:
            self._say(
                op="drive",
                topic=topic,
                content=message,
                moving=_moves(message),
                at=time.monotonic(),
            )
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
        """Call a service.

        Raises:
            ActionRefusedError: it does not exist.
            AdapterError: no answer, or an error.
        """
        try:
            async with asyncio.timeout(within):
                response = await self._answer(
                    lambda number: self._say(
                        op="call", number=number, service=service, kind=kind, arguments=arguments
                    )
                )
        except TimeoutError as error:
            raise AdapterError(f"{service} does not answer") from error
        if "values" not in response:
            kind_of_error = ActionRefusedError if response.get("absent") else AdapterError
            raise kind_of_error(f"{service} cannot be called: {response.get('problem')}")
        return bool(response["values"].get("success")), str(response["values"].get("message", ""))

    async def _answer(self, ask: Callable[[int], None]) -> dict[str, Any]:
        number = next(self._numbers)
        answer: asyncio.Future[dict[str, Any]] = asyncio.get_running_loop().create_future()
        self._calls[number] = answer
        try:
            ask(number)
            return await answer
        finally:
            self._calls.pop(number, None)

    def send_goal(self, action: str, kind: str, goal: dict[str, Any], name: str) -> None:
        """Refuse: ROS 1 has its actions on topics.

        Raises:
            ActionRefusedError: always.
        """
        del kind, goal, name
        raise ActionRefusedError(f"the ROS 1 adapter cannot send a goal to {action}")

    async def cancel_goal(self, action: str, name: str) -> bool:
        """Return True: there is no such goal."""
        del action, name
        return True

    def _say(self, **message: Any) -> None:
        writer = self._writer
        if writer is None or writer.transport.is_closing():
            raise AdapterError("the connection to the ROS node is lost")
        if writer.transport.get_write_buffer_size() > BACKLOG:
            raise AdapterError("the ROS node has stopped reading messages")
        writer.write((json.dumps(message) + "\n").encode())


def _master_of(options: Ros1Options) -> str:
    """Return the address of the master: the option, or what ROS itself goes by.

    Raises:
        AdapterError: it is none; one sentence.
    """
    uri = options.master or os.environ.get("ROS_MASTER_URI") or "http://localhost:11311"
    try:
        parts = urlsplit(uri)
        is_address = parts.scheme == "http" and bool(parts.hostname) and parts.port != 0
    except ValueError:
        is_address = False
    if not is_address:
        raise AdapterError(
            f"{'master' if options.master else 'ROS_MASTER_URI'} must be the address of the ROS"
            f" master, such as http://192.168.1.30:11311, not {uri!r}"
        )
    return uri


def _moves(message: Mapping[str, Any]) -> bool:
    twist = message.get("twist", message)
    return bool(twist["linear"]["x"] or twist["angular"]["z"])


def outlives_agent() -> bool:
    """Return whether a child process outlives the agent: not in a container that ends with it."""
    return 1 not in {os.getpid(), os.getppid()} or not any(map(Path.exists, CONTAINER))


def _is_here(host: str) -> bool:
    """Return whether an address is one of this computer's."""
    if host == "localhost" or host.startswith("127."):
        return True
    try:
        address = socket.getaddrinfo(host, 0, type=socket.SOCK_DGRAM)[0]
        with socket.socket(address[0], socket.SOCK_DGRAM) as probe:
            probe.bind(address[4])
    except OSError:
        return False
    return True


def _has_ended(child: subprocess.Popen[bytes]) -> bool:
    """Wait END_TIME for a node to exit; return False for one that still guards the robot."""
    assert child.stdin is not None
    child.stdin.close()
    try:
        child.wait(timeout=END_TIME)
    except subprocess.TimeoutExpired:
        return False
    return True


def _end(children: list[subprocess.Popen[bytes]]) -> None:
    for child in children:
        child.terminate()
        try:
            child.wait(timeout=END_TIME)
        except subprocess.TimeoutExpired:
            child.kill()
            child.wait()
