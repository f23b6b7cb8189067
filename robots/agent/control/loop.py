"""The control loop, in a thread of its own so that nothing else can delay it.

Adapter, safety and broker link share one selector loop, which no image and no disk can block.
Velocities are sent at 50 Hz of monotonic time, and once more for every command that arrives. When
the thread itself hangs, the base's own watchdog stops the robot and the agent ends its process
(robots/agent/watchdog.py).
"""

import asyncio
import math
import random
import threading
from collections.abc import Coroutine
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import structlog

from robots.agent.control.dispatcher import CommandDispatcher
from robots.agent.control.ingress import Ingress
from robots.agent.control.publisher import AgentLink, Media
from robots.agent.control.supervised_adapter import AdapterLink
from robots.agent.lab.in_force import CLEAN, Networks
from robots.agent.loop_calls import MOST_FRAMES, LoopCalls
from robots.agent.media.webrtc.packet_gate import ReceivedPacket
from robots.agent.robot_interface import Adapter
from robots.agent.safety.collision_monitor import monitor_of
from robots.agent.safety.kernel import Kernel
from robots.agent.store import Store
from robots.agent.thread_priority import FIRST, ORDINARY, set_nice
from robots.agent.timing import TimeSource
from robots.agent.watchdog import end_process
from robots.api.messages import Capability, Message, Role, SignalReply
from robots.process.cancellation import cancel

log = structlog.stdlib.get_logger(__name__)

PERIOD = 0.02
LATE = 0.2
BRAKING_TIME = 5.0  # s; a Giraff needs 3.5 s from its largest speed
FAREWELL_TIME = 3.0
# s for all of it, and for a photo that a thread of the executor still takes
CLOSE_TIME = 20.0


class ControlLoop:
    """Controls one robot. `start`, `close`, `receive`, `reply` and `publish` are thread-safe.

    `capabilities` are the adapter's and the agent's, `boot` identifies this run, `rng` spreads
    attempts to connect, and `networks` are emulated for drivers unless the server says otherwise.
    """

    def __init__(
        self,
        *,
        adapter: Adapter,
        capabilities: frozenset[Capability],
        link: AgentLink,
        store: Store,
        boot: str,
        rng: random.Random,
        times: TimeSource | None = None,
        networks: Networks = CLEAN,
    ) -> None:
        profile = adapter.profile
        monitor = self._monitor = monitor_of(profile)
        # an RCA that assists by itself needs no other
        shaper = None if "assist" in profile.capabilities else monitor
        assists: frozenset[Capability] = frozenset() if shaper is None else frozenset({"assist"})
        self.kernel = Kernel(
            profile.limits,
            profile.watchdog,
            capabilities | assists,
            latch=store.latch(),
            newest_lease=store.lease(),
            monitor=shaper,
            standstill=profile.standstill,
        )
        # until it has ended as requested; threading.excepthook logs an error
        self.failed = True
        self.ticks = 0  # shows the agent whether the thread hangs
        self._adapter = AdapterLink(adapter, rng=rng)
        self._link, self._store, self._boot = link, store, boot
        self._times, self._networks = times or TimeSource(), networks
        self.thread = threading.Thread()
        self._calls = LoopCalls("control")
        self._dispatcher: CommandDispatcher | None = None
        self._closing = threading.Event()
        self._ready, self._ended = threading.Event(), threading.Event()
        self._background: set[asyncio.Task[None]] = set()
        # it wakes the loop only once until it is drained, so that call must not be dropped
        self._ingress = Ingress(lambda: self._calls.post(self._drain, most=math.inf))

    # --- any thread -------------------------------------------------------------------------------

    def start(self, media: Media) -> None:
        self.thread = threading.Thread(target=self._run, args=(media,), name="control", daemon=True)
        self.thread.start()
        self._ready.wait()

    def receive(self, peer: str, role: Role, received: ReceivedPacket) -> None:
        """Take a packet of a data channel. The lease decides whether `peer` drives; `role` is from
        signalling.
        """
        self._ingress.put(peer, role, received)

    def reply(self, peer: str, message: SignalReply) -> None:
        self.publish(f"signal/{peer}/reply", message)

    def publish(self, suffix: str, message: Message) -> None:
        self._calls.post(self._send, suffix, message)

    def publish_picture(self, payload: bytes, peer: str | None = None) -> None:
        """Send an image to pages that WebRTC does not reach, or to one peer's page."""
        self._calls.post(self._send_picture, payload, peer, most=MOST_FRAMES)

    def close(self) -> None:
        """Brake, say goodbye and release the robot, within `CLOSE_TIME`; then a hanging thread ends
        the process. Idempotent.
        """
        self._closing.set()
        if self.thread.is_alive():
            self.thread.join(CLOSE_TIME)
            if self.thread.is_alive():
                end_process(self.thread, "closing")

    def wait(self, timeout: float) -> bool:
        """Return whether the thread ends within `timeout` seconds; `failed` tells whether by an
        error.
        """
        return self._ended.wait(timeout)

    # --- the thread -------------------------------------------------------------------------------

    async def run(self, media: Media) -> None:
        """Control the robot on the caller's event loop until `close`; `start` uses a thread."""
        loop = self._calls.loop = asyncio.get_running_loop()
        # background work (disks, images, the start of a simulator) gets an ordinary priority
        loop.set_default_executor(
            ThreadPoolExecutor(
                thread_name_prefix="beside", initializer=set_nice, initargs=(ORDINARY,)
            )
        )
        dispatcher = self._dispatcher = CommandDispatcher(
            self.kernel,
            self._adapter,
            self._link,
            media,
            self._store,
            times=self._times,
            boot=self._boot,
            spawn=self._spawn,
            networks=self._networks,
            monitor=self._monitor,
        )
        adapter = asyncio.create_task(self._adapter.run(dispatcher), name="adapter")
        link = asyncio.create_task(self._link.run(dispatcher), name="broker link")
        self._ready.set()
        try:
            await self._until_closing(dispatcher, {adapter, link})
        finally:
            await self._bring_to_rest(dispatcher)
            await cancel(adapter)
            await self._adapter.close()
            self._link.close()
            await asyncio.wait({link}, timeout=FAREWELL_TIME)
            await cancel(link, *self._background)

    def _run(self, media: Media) -> None:
        set_nice(FIRST)
        try:
            # not asyncio.run: on Windows its default loop cannot watch the sockets of MQTT
            with asyncio.Runner(loop_factory=asyncio.SelectorEventLoop) as runner:
                runner.run(self.run(media))
            self.failed = False
        finally:
            self._calls.loop = None
            self._ready.set()
            self._ended.set()

    async def _until_closing(
        self, dispatcher: CommandDispatcher, vital: set[asyncio.Task[None]]
    ) -> None:
        """Tick at 50 Hz and at the deadman until `close` or the end of a `vital` task."""
        next_tick = self._times.now()
        while not self._closing.is_set():
            for task in vital:
                if task.done():
                    task.result()
                    raise RuntimeError(f"the task of the {task.get_name()} has ended")
            self.ticks += 1
            now = self._times.now()
            if now - next_tick > LATE:
                log.warning("control_loop_late", seconds=round(now - next_tick, 3))
            if now >= next_tick:
                next_tick = max(next_tick + PERIOD, now)
            dispatcher.tick()
            wake = min(next_tick, dispatcher.deadline() or next_tick)
            await asyncio.sleep(max(0.0, wake - self._times.now()))

    async def _bring_to_rest(self, dispatcher: CommandDispatcher) -> None:
        """Brake and end the RCA's actions, after `close` or a failure."""
        until = self._times.now() + BRAKING_TIME
        try:
            dispatcher.brake()
            while not dispatcher.is_at_rest and self._times.now() < until:
                self.ticks += 1
                dispatcher.tick()
                await asyncio.sleep(PERIOD)
            dispatcher.reports.state()
        except Exception:  # the base's watchdog and the guard of the RCA are left
            log.exception("braking_failed")

    def _spawn(self, work: Coroutine[Any, Any, None]) -> None:
        task = asyncio.get_running_loop().create_task(
            work, name=getattr(work, "__qualname__", None)
        )
        self._background.add(task)
        task.add_done_callback(self._done)

    def _done(self, task: asyncio.Task[None]) -> None:
        """Log a failed background task; control continues without it."""
        self._background.discard(task)
        if not task.cancelled() and (error := task.exception()) is not None:
            log.error("background_task_failed", task=task.get_name(), exc_info=error)

    def _drain(self) -> None:
        commands, rejected = self._ingress.drain()
        if self._dispatcher is not None:
            self._dispatcher.take_commands(commands, rejected)

    def _send(self, suffix: str, message: Message) -> None:
        if self._dispatcher is not None:
            self._dispatcher.out.send(suffix, message)

    def _send_picture(self, payload: bytes, peer: str | None) -> None:
        if self._dispatcher is not None:
            self._dispatcher.out.picture(payload, peer)
