"""What every adapter of an outside RCA does with its connection and its actions."""

import asyncio
import contextlib
import time
from types import SimpleNamespace
from unittest import mock

import pytest

from robots.agent.adapters.common import remote_adapter
from robots.agent.adapters.common.remote_adapter import RemoteAdapter, profile_of
from robots.agent.adapters.common.robot_profile import load_profile
from robots.agent.ramp import ZERO
from robots.agent.robot_interface import ActionRefusedError, AdapterError
from robots.api.geometry import Pose2D
from robots.api.messages import Goto, Velocity
from tests.support.virtual_time import on_virtual_time

AHEAD = Velocity(linear=0.2, angular=0.0)
GOTO = Goto(action_id="g", stamp=0.0, x=1.0, y=0.0)


class Rca(RemoteAdapter):
    """An RCA that does what the test says."""

    place = "the robot"

    def __init__(self):
        robot = load_profile("rhodon")
        super().__init__(profile_of(robot, "RCA", 0.6, own=("goto",), control="guarded"))
        self.trouble = self.refusal = None
        self.sent, self.withdrawn = [], []
        self.confirms = False
        self.answers = asyncio.Event()

    async def _open(self):
        if self.trouble is not None:
            raise self.trouble
        self.readings.moved(
            Pose2D(0.0, 0.0, 0.0), ZERO, time.time(), remote_adapter.time.monotonic()
        )
        self._received()

    async def _shut(self):
        pass

    async def _ask(self):
        await self.answers.wait()

    def _drive(self, velocity):
        self.sent.append(velocity)

    async def _order(self, action):
        if self.refusal is not None:
            raise self.refusal
        return self._pending(action)

    async def _withdraw(self, pending):
        self.withdrawn.append((pending.action_id, len(self.sent)))
        return self.confirms


@contextlib.asynccontextmanager
async def connected():
    virtual = SimpleNamespace(monotonic=asyncio.get_running_loop().time, time=time.time)
    with mock.patch.object(remote_adapter, "time", virtual):
        rca = Rca()
        await rca.connect()
        try:
            yield rca
        finally:
            rca.confirms = True
            await rca.close()


@pytest.mark.parametrize(
    ("trouble", "reason"),
    [
        (OSError(), "it is not connected after 5 s"),
        (TimeoutError(), "it is not connected after 5 s"),
        (OSError(113, "No route to host"), "[Errno 113] No route to host"),
    ],
)
@on_virtual_time
async def test_a_failed_connection_always_has_a_reason(trouble, reason):
    rca = Rca()
    rca.trouble = trouble
    with pytest.raises(AdapterError) as caught:
        await rca.connect()
    assert str(caught.value) == f"the robot does not answer: {reason}"


@on_virtual_time
async def test_apply_returns_the_velocity_that_was_really_sent():
    async with connected() as rca:
        rca.sent.clear()
        assert rca.apply(AHEAD) == ZERO
        assert rca.sent == []
        rca.answers.set()
        await asyncio.sleep(0.01)
        assert rca.sent == [AHEAD]
        assert rca.apply(AHEAD) == AHEAD


@on_virtual_time
async def test_an_estop_keeps_its_last_known_state_over_a_reconnection():
    async with connected() as rca:
        assert rca.readings.estop is None
        rca.readings.estop = True
        await rca.connect()
        assert rca.readings.estop is True


@on_virtual_time
async def test_a_refused_action_is_not_ours():
    async with connected() as rca:
        rca.refusal = ActionRefusedError("no map")
        with pytest.raises(ActionRefusedError):
            await rca.start(GOTO)
        assert await rca.cancel("g")
        assert rca.withdrawn == []


@on_virtual_time
async def test_an_action_without_confirmation_is_cancelled_until_its_end_is_confirmed():
    async with connected() as rca:
        rca.refusal = AdapterError("no answer")
        with pytest.raises(AdapterError, match="no answer"):
            await rca.start(GOTO)
        await asyncio.sleep(1.2)
        assert len(rca.withdrawn) == 3
        with pytest.raises(ActionRefusedError, match="navigation_does_not_end"):
            await rca.start(GOTO)
        rca.confirms = True
        await asyncio.sleep(0.6)
        news = [await asyncio.wait_for(anext(rca.progress()), 1.0)]
        assert [(each.status, each.reason) for each in news] == [
            ("FAILED", "not_connected: no answer")
        ]
        assert await rca.cancel("g")


@on_virtual_time
async def test_leftovers_of_a_lost_connection_are_cancelled_first():
    async with connected() as rca:
        await rca.start(GOTO)
        rca._lose("the cable was pulled")
        assert not await rca.cancel("g")
        assert rca.withdrawn == []
        rca.sent.clear()
        await rca.connect()
        assert rca.withdrawn == [("g", 0)]
        assert rca.sent == [ZERO]
        await asyncio.sleep(remote_adapter.CANCEL_AGAIN + 0.1)
        assert len(rca.withdrawn) == 2
