"""The adapter around a robot without navigation: ends of its actions, and forwarded calls."""

import asyncio
from dataclasses import replace

import numpy as np
import pytest

from robots.agent.adapters.navigation_layer.adapter import AutonomyAdapter
from robots.agent.adapters.navigation_layer.pose_memory import PoseMemory
from robots.agent.autonomy import wire
from robots.agent.autonomy.sensor_snapshot import NavigationOutput
from robots.agent.robot_interface import (
    ActionRefusedError,
    AdapterError,
    LimitsSpeed,
    PassesVelocities,
    WithLock,
)
from robots.api.messages import Goto, Laser, Velocity
from robots.world.sensing import CENTRE, LaserScan
from tests.support.agents.scripted_robot import ScriptedRobot, still
from tests.support.virtual_time import on_virtual_time

GOTO = Goto(action_id="g", stamp=0.0, x=1.0, y=1.0)
FORWARD = Velocity(linear=0.3, angular=0.0)


class Node:
    """A navigation process that answers on request of the test."""

    def __init__(self):
        self.said, self.answer = [], None

    def send(self, message):
        self.said.append(message)
        return True

    async def order(self, _):
        self.answer = asyncio.get_running_loop().create_future()
        await self.answer


def wrapped(inner=None, now=lambda: 0.0):
    inner = inner or ScriptedRobot()
    inner._progress = asyncio.Queue()
    inner.profile = replace(inner.profile, laser=Laser(x=0.0), capabilities=("velocity",))
    adapter = AutonomyAdapter(inner, Laser(x=0.0), None, now=now)
    adapter.node = Node()
    adapter._last, adapter._beams = still(), LaserScan(0.0, 0.0, 0.1, 1.0, np.ones(3))
    return adapter


def output(wanted):
    pose = {"stamp": 0.0, "odometry": CENTRE, "pose": CENTRE, "covariance": None}
    return NavigationOutput(**pose, score=1.0, localized=True, wanted=wanted, news=(), path=None)


async def started(adapter):
    starting = asyncio.ensure_future(adapter.start(GOTO))
    await asyncio.sleep(0.01)
    return starting


@on_virtual_time
async def test_a_cancel_ends_an_action_at_once_although_its_process_continues():
    adapter = wrapped()
    starting = await started(adapter)
    adapter.node.answer.set_result(None)
    await starting
    adapter._take_output(output(FORWARD))
    assert adapter.wanted() == FORWARD
    assert await adapter.cancel("g") is True
    adapter._take_output(output(FORWARD))
    assert adapter.wanted() is None
    assert wire.CancelAction("g") in adapter.node.said


@on_virtual_time
async def test_an_action_that_is_cancelled_while_its_process_is_asked_never_moves():
    adapter = wrapped()
    starting = await started(adapter)
    assert await adapter.cancel("g") is True
    adapter.node.answer.set_result(None)
    with pytest.raises(ActionRefusedError, match="cancelled"):
        await starting
    adapter._take_output(output(FORWARD))
    assert adapter.wanted() is None
    assert adapter.node.said == [wire.CancelAction("g")]


@on_virtual_time
@pytest.mark.parametrize("end", ["no answer", "the caller's time-out"])
async def test_an_action_that_the_process_begins_after_the_time_out_never_moves(end):
    adapter = wrapped()
    starting = await started(adapter)
    if end == "no answer":
        adapter.node.answer.set_exception(AdapterError("the navigation does not answer"))
        with pytest.raises(ActionRefusedError, match="does not answer"):
            await starting
    else:
        starting.cancel()
        with pytest.raises(asyncio.CancelledError):
            await starting
    adapter._take_output(output(FORWARD))
    assert adapter.wanted() is None
    assert adapter.node.said == [wire.CancelAction("g")]
    assert await adapter.cancel("g") is True


@on_virtual_time
async def test_a_second_action_is_refused_and_does_not_replace_the_first():
    adapter = wrapped()
    starting = await started(adapter)
    adapter.node.answer.set_result(None)
    await starting
    with pytest.raises(ActionRefusedError, match="busy"):
        await adapter.start(Goto(action_id="h", stamp=0.0, x=2.0, y=1.0))
    adapter._take_output(output(FORWARD))
    assert adapter.wanted() == FORWARD


@on_virtual_time
async def test_cancel_of_an_action_of_the_rca_waits_for_its_confirmation():
    inner = ScriptedRobot()
    adapter = wrapped(inner)

    async def unconfirmed(_):
        return False

    inner.cancel = unconfirmed
    assert await adapter.cancel("of the RCA") is False


def test_optional_protocols_are_those_of_the_inner_adapter():
    plain = wrapped()
    assert not isinstance(plain, WithLock)
    assert not isinstance(plain, LimitsSpeed)
    assert isinstance(plain, PassesVelocities)
    assert plain.wanted() is None
    calls = []
    inner = ScriptedRobot()
    inner.set_lock = lambda *, locked: calls.append(locked)
    inner.limit_speed = calls.append
    inner.wanted = lambda: FORWARD
    able = wrapped(inner)
    assert isinstance(able, WithLock)
    assert isinstance(able, LimitsSpeed)
    able.set_lock(locked=True)
    able.limit_speed(0.4)
    assert calls == [True, 0.4]
    assert able.wanted() == FORWARD


async def test_a_disk_that_hangs_delays_the_connection_by_a_second_and_not_the_loop(
    tmp_path, monkeypatch
):
    monkeypatch.setattr("robots.agent.adapters.navigation_layer.pose_memory.READING_TIME", 0.05)
    release = asyncio.Event()

    async def hang(*_):
        await release.wait()

    monkeypatch.setattr(asyncio, "to_thread", hang)
    memory = PoseMemory(tmp_path / "pose.json")
    await memory.read()
    assert memory.recall("office") is None
