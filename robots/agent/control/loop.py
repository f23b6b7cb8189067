"""The control loop: a thread of its own, because it must run when nothing else does.

Adapter, safety and the broker's connection share one selector loop that no picture and no disk can
hold up; the wheels turn at 50 Hz of monotonic time, and once more for every command that arrives.
When the thread itself is stuck, the base's own watchdog stops it.
"""

import asyncio
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
from robots.agent.media.webrtc.packet_gate import ReceivedPacket
from robots.agent.robot_interface import Adapter
from robots.agent.safety.collision_monitor import monitor_of
from robots.agent.safety.kernel import Kernel
from robots.agent.store import Store
from robots.agent.thread_priority import FIRST, ORDINARY, set_nice
from robots.agent.timing import TimeSource
from robots.api.messages import Capability, Message, Role, SignalReply, Velocity
from robots.cancellation import cancel

log = structlog.stdlib.get_logger(__name__)

PERIOD = 0.02
LATE = 0.2
BRAKING_TIME = 3.0
FAREWELL_TIME = 3.0


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
            standstill=Velocity(
                linear=profile.standstill_linear, angular=profile.standstill_angular
            ),
        )
        self.failed = True  # until it has ended well; why it did not, threading.excepthook is told
        self._adapter, self._link, self._store, self._boot = (
            AdapterLink(adapter, rng=rng),
            link,
            store,
            boot,
        )
        self._times, self._networks = times or TimeSource(), networks
        self._thread = threading.Thread()
        self._loop: asyncio.AbstractEventLoop | None = None
        self._dispatcher: CommandDispatcher | None = None
        self._closing = threading.Event()
        self._ready, self._ended = threading.Event(), threading.Event()
        self._beside: set[asyncio.Task[None]] = set()
        self._ingress = Ingress(lambda: self._post(self._hear))

    # --- any thread -------------------------------------------------------------------------------

    def start(self, media: Media) -> None:
        """Start the thread; `media` hears signals, leases and telemetry, and takes pictures."""
        self._thread = threading.Thread(
            target=self._run, args=(media,), name="control", daemon=True
        )
        self._thread.start()
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
        self._post(self._send, suffix, message)

    def publish_picture(self, payload: bytes, peer: str | None = None) -> None:
        """Send a picture for pages that WebRTC does not reach, or for the page of
        one peer alone.
        """
        self._post(self._send_picture, payload, peer)

    def close(self) -> None:
        """Brake, say goodbye, let go of the robot; returns when that is done, after some seconds at
        most. Idempotent.
        """
        self._closing.set()
        if self._thread.is_alive():
            self._thread.join()

    def wait(self, timeout: float) -> bool:
        """Wait until the thread has ended, at most `timeout` seconds; `failed` says that nobody
        asked for it.
        """
        return self._ended.wait(timeout)

    # --- the thread -------------------------------------------------------------------------------

    async def run(self, media: Media) -> None:
        """Control the robot on the caller's own event loop until `close` was called; `start` gives
        it a thread of its own.
        """
        loop = self._loop = asyncio.get_running_loop()
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
        adapter = asyncio.create_task(self._adapter.run(dispatcher))
        link = asyncio.create_task(self._link.run(dispatcher))
        self._ready.set()
        try:
            await self._until_closing(dispatcher, {adapter, link})
            dispatcher.brake()
            await self._until_standing(dispatcher)
        finally:
            await cancel(adapter)
            await self._adapter.close()
            self._link.close()
            await asyncio.wait({link}, timeout=FAREWELL_TIME)
            await cancel(link, *self._beside)

    def _run(self, media: Media) -> None:
        set_nice(FIRST)
        try:
            # Not asyncio.run: on Windows its default loop can watch no sockets that are not its
            # own, which MQTT needs.
            with asyncio.Runner(loop_factory=asyncio.SelectorEventLoop) as runner:
                runner.run(self.run(media))
            self.failed = False
        finally:
            self._loop = None
            self._ready.set()
            self._ended.set()

    async def _until_closing(
        self, dispatcher: CommandDispatcher, vital: set[asyncio.Task[None]]
    ) -> None:
        """Tick at 50 Hz, and at the very moment of the deadman, until `close()` was called or one
        of `vital` fails.
        """
        next_tick = self._times.now()
        while not self._closing.is_set():
            for task in (*vital, *self._beside):
                if task.done():
                    task.result()
            now = self._times.now()
            if now - next_tick > LATE:
                log.warning("control_loop_late", seconds=round(now - next_tick, 3))
            if now >= next_tick:
                next_tick = max(next_tick + PERIOD, now)
            dispatcher.tick()
            wake = min(next_tick, dispatcher.deadline() or next_tick)
            await asyncio.sleep(max(0.0, wake - self._times.now()))

    async def _until_standing(self, dispatcher: CommandDispatcher) -> None:
        until = self._times.now() + BRAKING_TIME
        while not dispatcher.is_at_rest and self._times.now() < until:
            dispatcher.tick()
            await asyncio.sleep(PERIOD)
        dispatcher.reports.state()

    def _spawn(self, work: Coroutine[Any, Any, None]) -> None:
        task = asyncio.get_running_loop().create_task(work)
        self._beside.add(task)
        task.add_done_callback(self._done)

    def _done(self, task: asyncio.Task[None]) -> None:
        # One that failed stays, for the next tick to raise what went wrong.
        if task.cancelled() or task.exception() is None:
            self._beside.discard(task)

    def _post(self, call: Any, *arguments: Any) -> None:
        loop = self._loop
        if loop is None:
            return
        try:
            loop.call_soon_threadsafe(call, *arguments)
        except RuntimeError:
            log.debug("control_loop_ended")

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
