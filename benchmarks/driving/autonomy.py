"""Delay of the control loop's ticks without navigation, with the navigation node in a thread of the
same process, and with it in its own process.

A simulated giraff drives to and fro between two places. Each variant runs for `--seconds`
(default 20).
"""

import argparse
import asyncio
import queue
import sys
import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

from benchmarks.table import Figure, keep, quantiles
from robots.agent.adapters import registry
from robots.agent.adapters.navigation_layer.adapter import AutonomyAdapter
from robots.agent.autonomy import wire
from robots.agent.autonomy.__main__ import Conversation
from robots.agent.robot_interface import Adapter
from robots.agent.thread_priority import FIRST, ORDINARY, set_nice
from robots.api.messages import Goto

PERIOD = 0.02
WARM_UP = 3.0
PLACES = ("corridor-east", "laboratory")


class NodeThread:
    """The navigation node in a thread of the control loop process, to compare with its process."""

    def __init__(self, adapter: AutonomyAdapter) -> None:
        self.ready, self.problem = False, ""
        self._process = adapter.node
        self._spoken: queue.Queue[wire.NodeMessage | None] = queue.Queue()
        self._order: asyncio.Future[str] | None = None
        self._thread = threading.Thread(target=self._run, daemon=True)

    def settle(self, _: Any) -> None:
        """Nothing: settled by `run`."""

    def run(self) -> None:
        self._loop = asyncio.get_running_loop()
        self._spoken.put(wire.Settle(self._process._body, self._process._area, 0))
        self._thread.start()

    def check(self) -> None:
        pass

    def give_up(self, why: str) -> None:
        """A thread cannot be given up, which is one more thing against it."""
        print("stuck:", why)

    def say(self, message: wire.NodeMessage) -> bool:
        self._spoken.put(message)
        return True

    async def order(self, action: Any) -> None:
        self._order = self._loop.create_future()
        self._spoken.put(wire.BeginAction(0, action))
        await self._order

    async def close(self) -> None:
        self._spoken.put(None)

    def _run(self) -> None:
        set_nice(ORDINARY)
        conversation = Conversation(
            lambda word: self._loop.call_soon_threadsafe(self._answer, word) and None
        )
        while (word := self._spoken.get()) is not None:
            words = [word]
            while not self._spoken.empty() and (more := self._spoken.get()) is not None:
                words.append(more)
            conversation.take(words)

    def _answer(self, word: wire.NodeMessage) -> None:
        match word:
            case wire.NodeOutput(output):
                self._process._output(output)
            case wire.Settled():
                self.ready = True
                self._process._settled()
            case wire.OrderReply() if self._order is not None:
                self._order.set_result("")


def main() -> int:
    parser = argparse.ArgumentParser()
    parser.add_argument("--seconds", type=float, default=20.0)
    seconds = parser.parse_args().seconds
    measured = {
        name: _measure(make, seconds)
        for name, make in (("no navigation", _bare), ("thread", _threaded), ("process", _wrapped))
    }
    figures = []
    for name, (late, _) in measured.items():
        figures += quantiles(f"tick late, {name}", late, "ms", p50=None, p99=None, max=None)
    worse = figures[-2].value - figures[1].value
    figures += [
        Figure(f"control thread's share of a core, {name}", 100.0 * share, "%")
        for name, (_, share) in measured.items()
    ]
    figures.append(Figure("tick late p99, process against no navigation", worse, "ms", 5.0))
    return keep("autonomy", figures, seconds=seconds)


def _bare() -> Adapter:
    return registry.create("simulator", "giraff", {"camera": "no"})


def _wrapped() -> Adapter:
    return registry.autonomous(_bare())


def _threaded() -> Adapter:
    adapter = _wrapped()
    assert isinstance(adapter, AutonomyAdapter)
    adapter.node = NodeThread(adapter)  # type: ignore[assignment]
    return adapter


def _measure(make: Callable[[], Adapter], seconds: float) -> tuple[list[float], float]:
    """Return the lateness of every tick in ms, of a loop in a thread of its own as the agent's is,
    and the thread's share of a core.
    """
    found: list[float] = []
    shares: list[float] = []

    def run() -> None:
        set_nice(FIRST)
        begun, used = time.monotonic(), time.thread_time()
        asyncio.run(_drive(make(), seconds, found))
        shares.append((time.thread_time() - used) / (time.monotonic() - begun))

    thread = threading.Thread(target=run)
    thread.start()
    thread.join()
    return found, shares[0]


async def _drive(adapter: Adapter, seconds: float, found: list[float]) -> None:
    asyncio.get_running_loop().set_default_executor(
        ThreadPoolExecutor(initializer=set_nice, initargs=(ORDINARY,))
    )
    await adapter.connect()
    tasks = [
        asyncio.ensure_future(work)
        for work in (_read(adapter), _go(adapter), _tick(adapter, seconds, found))
    ]
    await tasks[-1]
    for task in tasks:
        task.cancel()
    await asyncio.gather(*tasks, return_exceptions=True)
    await adapter.close()


async def _read(adapter: Adapter) -> None:
    async for _ in adapter.states():
        pass


async def _go(adapter: Adapter) -> None:
    if not isinstance(adapter, AutonomyAdapter):
        return
    await asyncio.sleep(WARM_UP / 2)
    goals, number = [PLACES[0], PLACES[1]] * 50, 0
    await adapter.start(Goto(action_id="0", stamp=0.0, place=goals[0]))
    async for news in adapter.progress():
        if news.action_id == str(number) and news.status in {"FINISHED", "FAILED"}:
            number += 1
            await adapter.start(Goto(action_id=str(number), stamp=0.0, place=goals[number]))


async def _tick(adapter: Adapter, seconds: float, found: list[float]) -> None:
    begun = due = time.monotonic()
    while time.monotonic() < begun + WARM_UP + seconds:
        await asyncio.sleep(max(0.0, due - time.monotonic()))
        now = time.monotonic()
        if now > begun + WARM_UP:
            found.append((now - due) * 1e3)
        due = max(due + PERIOD, now)
        if isinstance(adapter, AutonomyAdapter) and (wanted := adapter.wanted()) is not None:
            adapter.apply(wanted)


if __name__ == "__main__":
    sys.exit(main())
