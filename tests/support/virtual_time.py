"""Two clocks for tests on an event loop: one that jumps when all tasks wait, and the real one.

With the virtual clock ten seconds take milliseconds, and a busy computer delays nothing. The loop
runs only inside `wait` and `sleep`, in the test's own thread.
"""

import asyncio
import functools
import selectors
import time
from collections.abc import Callable, Coroutine
from typing import Any, Self

from robots.agent.timing import TimeSource
from tests.support.patience import patient

POLL_INTERVAL_S = 0.005
EPOCH = 1_800_000_000.0  # Unix seconds at which every virtual clock begins
LONGEST_JOB_S = 60.0  # real seconds for a job in a thread


class EverybodyWaitsForeverError(AssertionError):
    """No timer is set and no thread runs: the loop would wait forever."""


class _JumpingSelector(selectors.DefaultSelector):
    """Moves the loop's clock instead of waiting. While threads work for the loop, the clock stops
    and it really waits.
    """

    loop: "VirtualLoop"

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        if self.loop.jobs:
            if timeout == 0:
                return super().select(0)
            ready = super().select(LONGEST_JOB_S)
            assert ready, "a thread does not end"
            return ready
        ready = super().select(0)
        if not ready and timeout is None:
            raise EverybodyWaitsForeverError
        if not ready and timeout:
            self.loop.elapsed += timeout
        return ready


class VirtualLoop(asyncio.SelectorEventLoop):
    """An event loop whose time passes only when all of its tasks wait (trio's autojump clock)."""

    def __init__(self) -> None:
        selector = _JumpingSelector()
        selector.loop = self
        self.elapsed = 1000.0  # s; a monotonic clock that begins at 0 hides mistakes
        self.jobs = 0
        super().__init__(selector)

    def time(self) -> float:
        return self.elapsed

    def run_in_executor(
        self, executor: Any, func: Callable[..., Any], *args: Any
    ) -> asyncio.Future[Any]:
        self.jobs += 1
        future = super().run_in_executor(executor, func, *args)
        future.add_done_callback(self._job_done)
        return future

    async def shutdown_default_executor(self) -> None:
        self.jobs += 1  # a thread that waits for the others
        await super().shutdown_default_executor()
        self.jobs -= 1

    def _job_done(self, _future: asyncio.Future[Any]) -> None:
        self.jobs -= 1


class VirtualTime:
    """A loop of its own, and its clocks. Use as a context manager, or end it with `close`."""

    def __init__(self) -> None:
        self.loop = VirtualLoop()
        self.times = TimeSource(self.now, self.unix)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def now(self) -> float:
        return self.loop.time()

    def unix(self) -> float:
        return EPOCH + self.loop.time()

    def run(self, work: Coroutine[Any, Any, Any]) -> Any:
        return self.loop.run_until_complete(work)

    def sleep(self, seconds: float) -> None:
        self.run(asyncio.sleep(seconds))

    def wait(
        self, condition: Callable[[], Any], within: float = 5.0, what: Any = "what was waited for"
    ) -> None:
        """Let time pass until the condition is true; fails after `within` s, naming `what`."""
        self.run(self._until(condition, within, what))

    async def _until(self, condition: Callable[[], Any], within: float, what: Any) -> None:
        await asyncio.sleep(0)
        deadline = self.now() + within
        while not condition():
            assert self.now() < deadline, (
                f"{what() if callable(what) else what} did not come within {within} s"
            )
            await asyncio.sleep(POLL_INTERVAL_S)

    def close(self) -> None:
        tasks = asyncio.all_tasks(self.loop)
        for task in tasks:
            task.cancel()
        self.run(_gather(tasks))
        self.run(self.loop.shutdown_default_executor())
        self.loop.close()


async def _gather(tasks: set[asyncio.Task[Any]]) -> None:
    await asyncio.gather(*tasks, return_exceptions=True)


class RealTime:
    """The computer's clocks, for tests with threads and processes."""

    times = TimeSource()
    now = staticmethod(time.monotonic)
    unix = staticmethod(time.time)
    sleep = staticmethod(time.sleep)

    @staticmethod
    def wait(
        condition: Callable[[], Any], within: float = 5.0, what: Any = "what was waited for"
    ) -> None:
        """Wait until the condition is true; fails after `patient(within)` seconds."""
        deadline = time.monotonic() + patient(within)
        while not condition():
            assert time.monotonic() < deadline, (
                f"{what() if callable(what) else what} did not come within {within} s"
            )
            time.sleep(POLL_INTERVAL_S)

    @staticmethod
    def close() -> None: ...


def on_virtual_time(test: Callable[..., Coroutine[Any, Any, None]]) -> Callable[..., None]:
    """Run an async test on a loop whose clock jumps."""

    @functools.wraps(test)
    def run(*args: Any, **kwargs: Any) -> None:
        with VirtualTime() as time:
            time.run(test(*args, **kwargs))

    return run
