"""The conformance suite reports an adapter that blocks the control loop, and does not stall."""

import asyncio
import time

import pytest

from tests.support.agents.scripted_robot import ScriptedRobot
from tests.support.architectures.adapter_conformance import AdapterConformance
from tests.support.loop_guard import guarded


class Blocking(ScriptedRobot):
    """Its SDK's call takes a minute."""

    async def connect(self):
        time.sleep(60.0)


class Slow(ScriptedRobot):
    """Now and then, its SDK's call takes a third of a second."""

    calls = 0

    def apply(self, velocity):
        self.calls += 1
        if self.calls % 20 == 0:
            time.sleep(0.3)
        return super().apply(velocity)


@pytest.mark.nightly
def test_call_that_does_not_return_is_reported_within_30_s():
    began = time.monotonic()
    with guarded(), pytest.raises(pytest.fail.Exception) as caught:
        asyncio.run(Blocking().connect())
    assert time.monotonic() - began < 30.0
    assert "blocks the control loop" in str(caught.value)
    assert "time.sleep(60.0)" in str(caught.value), "the line is named"
    assert "asyncio.to_thread" in str(caught.value)


def test_calls_that_block_briefly_are_reported():
    class Quiet:
        @staticmethod
        def excuse(_since, _until):
            return 0.0

    async def drive():
        robot = Slow()
        await robot.connect()
        conformance = AdapterConformance()
        await conformance.test_control_loop_is_never_blocked(robot, Quiet())

    with pytest.raises(AssertionError, match="blocks the control loop"):
        asyncio.run(drive())


def test_running_loop_is_not_reported():
    with guarded(0.5):
        asyncio.run(asyncio.sleep(1.2))
    time.sleep(0.3)
