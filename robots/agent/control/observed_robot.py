"""A robot connected without a site, for `run_robot NAME --check`."""

import asyncio
import contextlib
from dataclasses import dataclass

from robots.agent.ramp import ZERO, is_within
from robots.agent.robot_interface import ActionProgress, Adapter, AdapterError, RcaState, Severable


@dataclass(frozen=True)
class ObserverParams:
    connecting: float = 30.0
    first_reading: float = 5.0
    period: float = 0.05  # between two velocities
    stopping: float = 2.0  # in which zeros are sent at the end, unless the robot is at rest before
    cancelling: float = 0.5  # between two cancels


@dataclass(frozen=True)
class Observed:
    """A reading and when it arrived, monotonic seconds."""

    at: float
    state: RcaState


class ObservedRobot:
    """One adapter, its `readings` since the connection or `forget`, and the `progress` of its
    actions by id. Every wait raises AdapterError when the robot is lost.
    """

    def __init__(self, adapter: Adapter, params: ObserverParams | None = None) -> None:
        self.adapter, self.params = adapter, params or ObserverParams()
        self.readings: list[Observed] = []
        self.progress: dict[str, ActionProgress] = {}
        self._tasks: list[asyncio.Task[None]] = []

    async def connect(self) -> None:
        """Connect, or reconnect after `sever`. Raises AdapterError with one sentence."""
        try:
            async with asyncio.timeout(self.params.connecting):
                await self.adapter.connect()
        except TimeoutError as error:
            raise AdapterError(f"no answer within {self.params.connecting:g} s") from error
        self.readings.clear()
        self._tasks = [
            asyncio.ensure_future(self._read()),
            asyncio.ensure_future(self._follow()),
        ]

    def forget(self) -> None:
        self.readings.clear()

    @property
    def newest(self) -> RcaState | None:
        return self.readings[-1].state if self.readings else None

    def is_at_rest(self, state: RcaState) -> bool:
        """Tell whether a reading is within the standstill thresholds of the profile."""
        return is_within(state.velocity, self.adapter.profile.standstill)

    async def wait(self, seconds: float) -> None:
        """Wait while the robot reports."""
        reading = self._tasks[0]
        done, _ = await asyncio.wait({reading}, timeout=seconds)
        if done:
            reading.result()
            raise AdapterError("the robot stopped reporting")

    async def first_reading(self) -> Observed:
        """Return the first reading of this connection, or raise AdapterError."""
        ends = now() + self.params.first_reading
        while not self.readings:
            if now() > ends:
                raise AdapterError(f"no reading within {self.params.first_reading:g} s")
            await self.wait(self.params.period)
        return self.readings[0]

    async def sever(self) -> None:
        """Cut the connection as a crash of the agent would; only for a `Severable` adapter."""
        assert isinstance(self.adapter, Severable)
        self.adapter.sever()
        await self._end_tasks()

    async def cancel(self, action_id: str, seconds: float) -> bool:
        """Cancel an action repeatedly; return whether its end was confirmed within `seconds`."""
        ends = now() + seconds
        if not self._tasks:
            raise AdapterError("not connected")
        while not await self.adapter.cancel(action_id):
            if now() > ends:
                return False
            await self.wait(self.params.cancelling)
        return True

    async def leave(self) -> None:
        """Brake and disconnect, also after a failure."""
        if self._tasks:
            with contextlib.suppress(AdapterError):
                await self._brake()
        await self._end_tasks()
        with contextlib.suppress(AdapterError, TimeoutError):
            async with asyncio.timeout(self.params.stopping):
                await self.adapter.close()

    async def _brake(self) -> None:
        ends = now() + self.params.stopping
        while now() < ends:
            self.adapter.apply(ZERO)
            await asyncio.sleep(self.params.period)
            recent = self.readings[-3:]
            if recent and all(self.is_at_rest(reading.state) for reading in recent):
                break
        self.adapter.apply(ZERO)

    async def _read(self) -> None:
        async for state in self.adapter.states():
            self.readings.append(Observed(now(), state))

    async def _follow(self) -> None:
        async for progress in self.adapter.progress():
            self.progress[progress.action_id] = progress

    async def _end_tasks(self) -> None:
        tasks, self._tasks = self._tasks, []
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)


def now() -> float:
    """Return the running loop's time, monotonic seconds."""
    return asyncio.get_running_loop().time()
