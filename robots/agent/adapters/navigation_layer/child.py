"""The navigation process as a child of the agent: started, killed when it hangs, and restarted."""

import asyncio
import random
import subprocess
from collections.abc import Callable

import structlog

from robots.agent.adapters.common.child_process import (
    connect_child,
    send_token,
    start_module,
)
from robots.agent.autonomy import wire
from robots.agent.autonomy.sensor_snapshot import Body, NavigationOutput
from robots.agent.robot_interface import AdapterError
from robots.agent.timing import Backoff
from robots.api.messages import Dock, FloorPlanUpdate, Follow, Goto, Relocalize, Undock
from robots.api.reasons import ReasonCode
from robots.process import framing
from robots.process.logs import reason_of

START_TIME = 30.0  # a slow computer takes that long to import scipy
READY_TIME = 5.0  # that an action waits for a process that is starting
ANSWER_TIME = 5.0
BACKLOG = 256 << 10

log = structlog.stdlib.get_logger(__name__)

Orderable = Goto | Follow | Dock | Undock | Relocalize


class NavigationProcess:
    """One process after the other, for one robot. All methods run on the control loop, none blocks.

    `output` gets every output, `settled` is called when a new process needs the robot's pose.
    """

    def __init__(
        self,
        body: Body,
        *,
        output: Callable[[NavigationOutput], None],
        settled: Callable[[], None],
        seed: int = 0,
    ) -> None:
        self.ready = False
        self.problem = "no map of the site has been received yet"
        self.starts = 0
        self._body, self._output, self._settled, self._seed = body, output, settled, seed
        self._area: FloorPlanUpdate | None = None
        self._area_came, self._changed = asyncio.Event(), asyncio.Event()
        self._child: subprocess.Popen[bytes] | None = None
        self._writer: asyncio.StreamWriter | None = None
        self._task: asyncio.Task[None] | None = None
        self._answers: dict[int, asyncio.Future[str]] = {}
        self._routes: dict[int, asyncio.Future[wire.FoundRoute]] = {}
        self._orders = 0

    @property
    def pid(self) -> int | None:
        return self._child.pid if self._child is not None else None

    def settle(self, area: FloorPlanUpdate) -> None:
        """Use this site; a process with another one is killed."""
        self._area = area
        self._area_came.set()
        self.give_up("the map has changed")

    def run(self) -> None:
        """Start on the running loop; idempotent."""
        if self._task is None or self._task.done():
            self._task = asyncio.get_running_loop().create_task(self._run())

    def check(self) -> None:
        """Raise what ended the task that restarts the process, if it has ended."""
        if self._task is not None and self._task.done() and not self._task.cancelled():
            self._task.result()

    def send(self, message: wire.NodeMessage) -> bool:
        """Send without waiting; return False when no process receives it."""
        writer = self._writer
        if (
            not self.ready
            or writer is None
            or writer.transport.is_closing()
            or writer.transport.get_write_buffer_size() > BACKLOG
        ):
            return False
        writer.write(framing.pack(message))
        return True

    async def order(self, action: Orderable) -> None:
        """Begin an action and wait for the answer; raises AdapterError when refused or silent."""
        await self._until_ready()
        self._orders += 1
        answer = self._answers[self._orders] = asyncio.get_running_loop().create_future()
        try:
            self.send(wire.BeginAction(self._orders, action))
            async with asyncio.timeout(ANSWER_TIME):
                problem = await answer
        except TimeoutError as error:
            raise AdapterError(ReasonCode.NAVIGATION_LOST.of("silent")) from error
        finally:
            del self._answers[self._orders]
        if problem:
            raise AdapterError(problem)

    async def route(self, x: float, y: float) -> wire.FoundRoute:
        """Return where a goto would lead; raises AdapterError without an answer."""
        self._orders += 1
        number = self._orders
        found: asyncio.Future[wire.FoundRoute] = asyncio.get_running_loop().create_future()
        self._routes[number] = found
        try:
            if not self.send(wire.FindRoute(number, x, y)):
                raise AdapterError(ReasonCode.NAVIGATION_LOST.of(self.problem))
            async with asyncio.timeout(ANSWER_TIME):
                return await found
        except TimeoutError as error:
            raise AdapterError(ReasonCode.NAVIGATION_LOST.of("silent")) from error
        finally:
            del self._routes[number]

    def give_up(self, why: str) -> None:
        """Kill the process; the next one starts by itself."""
        if self._child is not None:
            log.warning("navigation_node_abandoned", reason=why, pid=self._child.pid)
            self._child.kill()
        self._lose(why)

    async def close(self) -> None:
        if self._task is not None:
            self._task.cancel()
            await asyncio.gather(self._task, return_exceptions=True)
            self._task = None

    # --- inside -----------------------------------------------------------------------------------

    async def _until_ready(self) -> None:
        try:
            async with asyncio.timeout(READY_TIME):
                while not self.ready:
                    if not self._area_came.is_set():
                        raise AdapterError(ReasonCode.NAVIGATION_LOST.of(self.problem))
                    self._changed.clear()
                    await self._changed.wait()
        except TimeoutError as error:
            raise AdapterError(ReasonCode.NAVIGATION_LOST.of(self.problem)) from error

    async def _run(self) -> None:
        backoff = Backoff(random.Random(self._seed), first=0.2, longest=10.0)
        while True:
            await self._area_came.wait()
            began = asyncio.get_running_loop().time()
            try:
                await self._live()
            except (OSError, TimeoutError, asyncio.IncompleteReadError, framing.WireError) as error:
                log.warning("navigation_node_lost", reason=reason_of(error))
            finally:
                self._lose("it is restarting")
                if self._child is not None:
                    self._child.kill()
                    await asyncio.to_thread(self._child.wait)
                    self._child = None
            await asyncio.sleep(backoff.failed(asyncio.get_running_loop().time() - began))

    async def _live(self) -> None:
        """Start a process, send it the site, and read its output until it ends with an OSError,
        TimeoutError, IncompleteReadError or WireError.
        """
        area = self._area
        assert area is not None
        reader, writer = await connect_child(self._launch, START_TIME)
        try:
            writer.write(framing.pack(wire.Settle(self._body, area, self._seed + self.starts)))
            async with asyncio.timeout(START_TIME):
                settled = await _read(reader)
            self.problem = (
                settled.problem
                if isinstance(settled, wire.Settled)
                else "it uses another version of the protocol"
            )
            if self.problem:
                log.error("map_refused", reason=self.problem)
                self._area_came.clear()  # the same map again would be refused again
                return
            if area is not self._area:
                return
            self._writer, self.ready = writer, True
            self._changed.set()
            self._settled()
            while True:
                self._take(await _read(reader))
        finally:
            writer.close()

    def _launch(self, port: int, token: str) -> subprocess.Popen[bytes]:
        self.starts += 1
        self._child = start_module("robots.agent.autonomy", str(port), stdin=subprocess.PIPE)
        send_token(self._child, token)
        return self._child

    def _take(self, word: wire.FromNode) -> None:
        match word:
            case wire.NodeOutput(output):
                self._output(output)
            case wire.OrderReply(number, problem):
                answer = self._answers.get(number)
                if answer is not None and not answer.done():
                    answer.set_result(problem)
            case wire.FoundRoute(number):
                route = self._routes.get(number)
                if route is not None and not route.done():
                    route.set_result(word)
            case _:
                kind = type(word).__name__
                raise framing.WireError(f"unexpected {kind} after navigation was set up")

    def _lose(self, why: str) -> None:
        self.ready, self._writer = False, None
        self.problem = self.problem or why
        for answer in self._answers.values():
            if not answer.done():
                answer.set_result(ReasonCode.NAVIGATION_LOST.of(why))
        for number, route in self._routes.items():
            if not route.done():
                reason = ReasonCode.NAVIGATION_LOST.of(why)
                route.set_result(wire.FoundRoute(number, (), reason))


async def _read(reader: asyncio.StreamReader) -> wire.FromNode:
    return wire.unpack_answer(await framing.read(reader))
