"""A simulated robot that navigates or assists, with the control loop's part."""

import asyncio
import time
from contextlib import asynccontextmanager

from robots.agent.adapters import registry
from robots.agent.adapters.navigation_layer.adapter import AutonomyAdapter
from robots.agent.ramp import ZERO
from robots.agent.safety.collision_monitor import monitor_of
from tests.support.patience import patient


def made(profile: str = "giraff", **options: str) -> AutonomyAdapter:
    adapter = registry.autonomous(
        registry.create(
            "simulator", profile, {"camera": "no", "start": "5.0,1.0,3.1", "seed": "3"} | options
        )
    )
    assert isinstance(adapter, AutonomyAdapter)
    return adapter


class Drive:
    """A robot whose wanted velocities reach its wheels, and everything that it reports."""

    def __init__(self, adapter: AutonomyAdapter) -> None:
        self.adapter = adapter
        self.monitor = monitor_of(adapter.profile)
        self.state = None
        self.news = []
        # of all states, because a busy test may miss an error that lasts a moment
        self.complaints = set()
        self.driver = None
        self.told = ZERO
        self._changed = asyncio.Condition()

    async def read(self):
        async for reading in self.adapter.states():
            self.monitor.sense(reading, time.monotonic())
            state = self.state = self.adapter.located(reading, self.monitor.points())
            self.complaints.update(state.errors)
            wanted = self.adapter.wanted()
            if wanted is not None:
                self.told = self.adapter.apply(wanted)
            elif self.driver is not None:
                self.told = self.adapter.apply(self.driver)
            await self._say_so()

    async def listen(self):
        async for news in self.adapter.progress():
            self.news.append(news)
            await self._say_so()

    async def _say_so(self):
        async with self._changed:
            self._changed.notify_all()

    async def until(self, condition, seconds=30.0):
        async with asyncio.timeout(patient(seconds)), self._changed:
            await self._changed.wait_for(condition)

    async def known(self):
        """Wait until the robot thinks and knows where it is."""
        await self.until(lambda: self.state is not None and self.state.pose.localized)

    def last(self, action_id):
        return next((n for n in reversed(self.news) if n.action_id == action_id), None)

    async def ended(self, action_id, seconds=60.0):
        await self.until(
            lambda: (
                (n := self.last(action_id)) is not None
                and n.status in {"FINISHED", "FAILED", "CANCELLED"}
            ),
            seconds,
        )
        return self.last(action_id)

    async def moving(self):
        await self.until(lambda: abs(self.state.velocity.linear) > 0.1)

    async def standing(self):
        await self.until(lambda: self.state.velocity == ZERO, 5.0)

    def port(self):
        return int(self.adapter.inner.address.rpartition(":")[2])


@asynccontextmanager
async def driving(adapter: AutonomyAdapter):
    await adapter.connect()
    drive = Drive(adapter)
    tasks = [asyncio.ensure_future(drive.read()), asyncio.ensure_future(drive.listen())]
    try:
        yield drive
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        await adapter.close()
