"""The control loop: a thread of its own, because it must run when nothing else does.

Adapter, safety and the broker's connection share one selector loop that no picture and no disk can
hold up; the wheels turn at 50 Hz of monotonic time, and once more for every command that arrives.
When the thread itself is stuck, the base's own watchdog stops it, and the agent ends its process
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

from robots.agent.control.dispatcher import CommandDispatcher, DispatcherParts
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
from robots.cancellation import cancel

log = structlog.stdlib.get_logger(__name__)

PERIOD = 0.02
LATE = 0.2
BRAKING_TIME = 5.0  # s; a Giraff needs 3.5 s from its largest speed
FAREWELL_TIME = 3.0
# s for all of it, and for a photo that a thread of the executor still takes
CLOSE_TIME = 20.0


class ControlLoop:
    """One robot's control. `start`, `close`, `receive`, `reply` and `publish` may be called from
    any thread.

    Args:
        adapter: the robot control architecture.
        capabilities: what the robot can do: the adapter's, and what the agent adds.
        link: the broker.
        store: what is remembered across restarts.
        boot: the id of this run.
        rng: spreads attempts to connect.
        times: the clocks.
        networks: what is put on the network of drivers of whom the server says nothing.
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
        # until it has ended as it was asked to; threading.excepthook logs why it did not
        self.failed = True
        self.ticks = 0  # from which the agent notices a thread that hangs
        self._adapter, self._link, self._store, self._boot = (
            AdapterLink(adapter, rng=rng),
            link,
            store,
            boot,
        )
        self._times, self._networks = times or TimeSource(), networks
        self.thread = threading.Thread()
        self._calls = LoopCalls("control")
        self._dispatcher: CommandDispatcher | None = None
        self._closing = threading.Event()
        self._ready, self._ended = threading.Event(), threading.Event()
        self._background: set[asyncio.Task[None]] = set()
        # it wakes the loop once until that has drained it, so that wake must not be dropped
        self._ingress = Ingress(lambda: self._calls.post(self._hear, most=math.inf))

    # --- any thread -------------------------------------------------------------------------------

    def start(self, media: Media) -> None:
        """Start the thread; `media` hears signals, leases and telemetry, and takes pictures."""
        self.thread = threading.Thread(target=self._run, args=(media,), name="control", daemon=True)
        self.thread.start()
        self._ready.wait()

    def receive(self, peer: str, role: Role, heard: ReceivedPacket) -> None:
        """Take what came on a data channel. The lease says whether `peer` drives; `role` is what
        signalling makes of that.
        """
        self._ingress.put(peer, role, heard)

    def reply(self, peer: str, message: SignalReply) -> None:
        """Answer a page's signal."""
        self.publish(f"signal/{peer}/reply", message)

    def publish(self, suffix: str, message: Message) -> None:
        """Send a message of the robot."""
        self._calls.post(self._send, suffix, message)

    def publish_picture(self, payload: bytes, peer: str | None = None) -> None:
        """Send a picture for pages that WebRTC does not reach, or for the page of
        one peer alone.
        """
        self._calls.post(self._send_picture, payload, peer, most=MOST_FRAMES)

    def close(self) -> None:
        """Brake, say goodbye, let go of the robot; returns when that is done, after `CLOSE_TIME`
        at most. A thread that hangs until then ends the process. Idempotent.
        """
        self._closing.set()
        if self.thread.is_alive():
            self.thread.join(CLOSE_TIME)
            if self.thread.is_alive():
                end_process(self.thread, "closing")

    def wait(self, timeout: float) -> bool:
        """Return whether the thread has ended, after at most `timeout` seconds; `failed` tells
        whether it ended by itself.
        """
        return self._ended.wait(timeout)

    # --- the thread -------------------------------------------------------------------------------

    async def run(self, media: Media) -> None:
        """Control the robot on the caller's own event loop until `close` was called; `start` gives
        it a thread of its own.
        """
        loop = self._calls.loop = asyncio.get_running_loop()
        # What is done beside the loop (disks, pictures, a simulator that is started) has no
        # business to go first.
        loop.set_default_executor(
            ThreadPoolExecutor(
                thread_name_prefix="beside", initializer=set_nice, initargs=(ORDINARY,)
            )
        )
        parts = DispatcherParts(
            self.kernel,
            self._adapter,
            self._link,
            media,
            self._store,
            self._times,
            self._boot,
            self._networks,
            self._monitor,
        )
        dispatcher = self._dispatcher = CommandDispatcher(parts, self._spawn)
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
            # Not asyncio.run: on Windows its default loop can watch no sockets that are not its
            # own, which MQTT needs.
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
        """Tick at 50 Hz, and at the very moment of the deadman, until `close()` was called or one
        of `vital` has ended.
        """
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
        """Brake and end what the RCA does by itself, whether control was closed or has failed."""
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
        """Log why a task beside the loop failed; control goes on without it."""
        self._background.discard(task)
        if not task.cancelled() and (error := task.exception()) is not None:
            log.error("background_task_failed", task=task.get_name(), exc_info=error)

    def _hear(self) -> None:
        said, rejected = self._ingress.drain()
        if self._dispatcher is not None:
            self._dispatcher.heard(said, rejected)

    def _send(self, suffix: str, message: Message) -> None:
        if self._dispatcher is not None:
            self._dispatcher.out.send(suffix, message)

    def _send_picture(self, payload: bytes, peer: str | None) -> None:
        if self._dispatcher is not None:
            self._dispatcher.out.picture(payload, peer)
