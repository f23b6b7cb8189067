"""A control architecture that needs longer to its first reading than it may fall silent later."""

import asyncio
import random

import pytest

from robots.agent.control import supervised_adapter
from robots.agent.control.supervised_adapter import AdapterLink
from tests.support.agents.scripted_robot import ScriptedRobot
from tests.support.virtual_time import on_virtual_time


class Listener:
    """Keeps what it hears."""

    def __init__(self) -> None:
        self.readings: list[object] = []
        self.changes: list[tuple[bool, str]] = []
        self.heard = asyncio.Event()

    def reading(self, reading: object) -> None:
        self.readings.append(reading)
        self.heard.set()

    def progressed(self, progress: object) -> None:
        """No action is started."""

    def adapter_changed(self, *, up: bool, reason: str = "") -> None:
        self.changes.append((up, reason))
        self.heard.set()


@on_virtual_time
async def test_the_first_reading_may_come_late_and_the_next_may_not(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(supervised_adapter, "SILENCE", 0.2)
    robot, listener = ScriptedRobot(silent=True), Listener()
    link = AdapterLink(robot, rng=random.Random(1))
    running = asyncio.create_task(link.run(listener))
    try:
        await asyncio.sleep(3 * supervised_adapter.SILENCE)
        assert (robot.connections, listener.changes) == (1, []), "it is still waited for"
        robot.silent = False
        await asyncio.wait_for(listener.heard.wait(), 10.0)
        assert (robot.connections, listener.changes) == (1, [(True, "")])
        robot.silent = True
        listener.heard.clear()
        async with asyncio.timeout(10.0):
            while (False, "it is silent") not in listener.changes:
                listener.heard.clear()
                await listener.heard.wait()
    finally:
        running.cancel()
        await asyncio.gather(running, return_exceptions=True)


@on_virtual_time
async def test_nonsense_from_the_start_is_no_better_than_silence_between_two_readings(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(supervised_adapter, "SILENCE", 0.1)
    monkeypatch.setattr(supervised_adapter, "sound", nonsense)
    listener = Listener()
    running = asyncio.create_task(AdapterLink(ScriptedRobot(), rng=random.Random(1)).run(listener))
    try:
        await asyncio.wait_for(listener.heard.wait(), 5.0)
        assert listener.changes[0] == (False, "it reports nonsense: a pose of NaN")
    finally:
        running.cancel()
        await asyncio.gather(running, return_exceptions=True)


def nonsense(_reading: object) -> object:
    raise supervised_adapter.UnsoundReadingError("a pose of NaN")
