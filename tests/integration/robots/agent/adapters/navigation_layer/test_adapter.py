"""A simulated robot with only velocity, odometry and a laser in our navigation layer: the
conformance suite, real drives, and the death of the navigation process.
"""

import asyncio
import math
import os
import signal
from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import pytest

from robots.agent.adapters import registry
from robots.agent.adapters.navigation_layer.adapter import OURS, AutonomyAdapter
from robots.agent.adapters.navigation_layer.pose_memory import PoseMemory
from robots.agent.autonomy.area import update_of
from robots.agent.ramp import ZERO
from robots.agent.robot_interface import Adapter, AdapterError, Navigating
from robots.api.geometry import Pose2D
from robots.api.messages import Cancel, Dock, FloorPlanUpdate, Follow, Goto, Relocalize, Tilt
from robots.world.sites import load_site
from tests.support.agents.autonomous_drive import driving, made
from tests.support.agents.scripted_robot import ScriptedRobot, still
from tests.support.agents.simulators import alive
from tests.support.agents.truth import Onlooker
from tests.support.architectures.adapter_conformance import AdapterConformance, some

pytestmark = pytest.mark.usefixtures("patient_adapters")
NEAR = "3.0,1.0,3.1"  # two metres before
THERE = {"place": None, "x": 1.2, "y": 1.0}  # reached without turning round


class TestWrapped(AdapterConformance):
    def make(self) -> Adapter:
        return made()

    def obeyed_at(self, adapter: Adapter) -> float:
        assert isinstance(adapter, AutonomyAdapter)
        truth = adapter.inner._truth
        return truth.commanded_at if truth else 0.0


def goto(action_id="g", **fields):
    return Goto(action_id=action_id, stamp=0.0, **({"place": "corridor-west"} | fields))


def with_laser(**fields):
    profile = replace(ScriptedRobot().profile, laser=made().profile.laser, **fields)
    return ScriptedRobot(profile=profile)


def test_only_a_robot_with_a_laser_and_without_localization_gets_ours():
    adapter = made()
    assert set(OURS) <= set(adapter.profile.capabilities)
    assert isinstance(adapter, Navigating)
    able = with_laser(capabilities=("velocity", "localization", "goto"))
    for other in (ScriptedRobot(), able):
        assert registry.autonomous(other) is other


def test_self_localizing_robot_without_navigation_gets_ours_and_keeps_its_pose():
    own = ("velocity", "localization", "dock")
    wrapped = registry.autonomous(with_laser(capabilities=own))
    assert {*wrapped.profile.capabilities} == {*own, "goto", "follow", "undock"}
    reading = still(odometry=Pose2D(0.0, 0.0, 0.0))
    assert wrapped.located(reading, np.zeros((0, 2))) == replace(reading, path=())


def test_robot_keeps_its_own_capabilities():
    inner = with_laser()
    wrapped = registry.autonomous(inner)
    assert sorted(wrapped.profile.capabilities) == sorted({*inner.profile.capabilities, *OURS})


def test_unknown_site_is_refused_with_a_sentence():
    with pytest.raises(AdapterError, match="office"):
        registry.autonomous(registry.create("simulator", "giraff"), "castle")


async def test_robot_is_localized_reaches_its_goal_and_reports_its_path():
    adapter = made(start=NEAR)
    async with driving(adapter) as drive:
        await drive.known()
        onlooker = Onlooker(drive.port())
        await adapter.start(goto(**THERE))
        await drive.until(lambda: drive.state.path)
        await drive.moving()
        state = drive.state
        truth = await asyncio.to_thread(onlooker.at, state.stamp)
        assert math.hypot(truth.x - state.pose.x, truth.y - state.pose.y) < 0.1
        assert (await drive.ended("g")).status == "FINISHED"
        await drive.standing()
        await drive.until(lambda: drive.state.path == ())
        assert math.hypot(drive.state.pose.x - 1.2, drive.state.pose.y - 1.0) < 0.3
        assert (await asyncio.to_thread(onlooker.truth)).contacts == 0
        assert adapter.wanted() is None
        onlooker.close()


async def test_action_waits_for_the_navigation_process_and_impossible_ones_are_refused():
    adapter = made()
    async with driving(adapter) as drive:
        await drive.until(lambda: drive.state is not None and adapter._beams is not None)
        with pytest.raises(AdapterError, match="unknown_place: "):
            await adapter.start(goto(place="the moon"))
        with pytest.raises(AdapterError, match="no_goal"):
            await adapter.start(Follow(action_id="f", stamp=0.0, points=((0.0, 0.0),)))
        with pytest.raises(AdapterError):
            await adapter.start(Cancel(action_id="c", stamp=0.0))
        await adapter.start(Tilt(action_id="t", stamp=0.0, angle=0.3))
        assert (await drive.ended("t")).status == "FINISHED", "the RCA itself tilts"


@pytest.mark.nightly
async def test_cancelling_stops_the_robot():
    async with driving(made()) as drive:
        await drive.known()
        await drive.adapter.start(goto())
        await drive.moving()
        assert await drive.adapter.cancel("g") is True
        assert drive.adapter.wanted() is None
        assert (await drive.ended("g")).status == "CANCELLED"
        await drive.standing()


@pytest.mark.nightly
async def test_killed_navigation_process_fails_the_action_and_its_successor_is_localized():
    async with driving(made(start=NEAR)) as drive:
        await drive.known()
        await drive.adapter.start(goto())
        await drive.moving()
        pid = drive.adapter.node.pid
        os.kill(pid, signal.SIGKILL)
        ended = await drive.ended("g", 3.0)
        assert ended.status == "FAILED"
        assert "navigation" in ended.reason
        await drive.standing()
        assert any("navigation" in text for text in drive.complaints)
        await drive.until(lambda: drive.adapter.node.ready and drive.adapter.node.pid != pid)
        await drive.known()
        assert drive.state.errors == ()
        await drive.adapter.start(goto("g2", **THERE))
        assert (await drive.ended("g2")).status == "FINISHED"


@pytest.mark.nightly
async def test_hung_navigation_process_stops_the_robot_and_is_replaced():
    async with driving(made()) as drive:
        await drive.known()
        await drive.adapter.start(goto())
        await drive.moving()
        pid = drive.adapter.node.pid
        os.kill(pid, signal.SIGSTOP)
        await drive.until(lambda: drive.adapter.wanted() == ZERO, 2.0)
        ended = await drive.ended("g", 5.0)
        assert ended.reason == "navigation_lost: silent"
        await drive.standing()
        await drive.until(lambda: drive.adapter.node.ready and drive.adapter.node.pid != pid)
        assert not alive(pid)
        await drive.known()


@pytest.mark.nightly
async def test_death_of_the_simulator_fails_the_action():
    adapter = made()
    async with driving(adapter) as drive:
        await drive.known()
        await adapter.start(goto())
        await drive.moving()
        os.kill(adapter.inner._child.pid, signal.SIGKILL)
        assert (await drive.ended("g", 5.0)).reason == "not_connected"
        assert adapter.wanted() is None


async def test_closing_leaves_no_process_behind():
    adapter = made()
    async with driving(adapter) as drive:
        await drive.known()
        pids = adapter.node.pid, adapter.inner._child.pid
    assert not any(alive(pid) for pid in pids)


def without_site(memory: Path | None = None) -> AutonomyAdapter:
    """Return a robot that knows no site and no start, only the map that the server sends."""
    inner = made().inner
    inner.profile = replace(inner.profile, plan="", start=None)
    adapter = registry.autonomous(inner, memory=memory)
    assert isinstance(adapter, AutonomyAdapter)
    return adapter


async def recalled(path: Path | None) -> Pose2D | None:
    memory = PoseMemory(path)
    await memory.read()
    return memory.recall("office")


def office() -> FloorPlanUpdate:
    return update_of(load_site("office"))


@pytest.mark.nightly
async def test_robot_without_a_site_navigates_with_the_map_of_the_server():
    adapter = without_site()
    async with driving(adapter) as drive:
        await drive.until(lambda: drive.state is not None)
        assert not drive.state.pose.localized
        assert any("no map" in text for text in drive.state.errors)
        with pytest.raises(AdapterError, match=r"no map|laser"):
            await adapter.start(goto())
        adapter.take_floorplan(office())
        await drive.until(lambda: adapter.node.ready)
        await adapter.start(Relocalize(action_id="r", stamp=0.0, x=5.0, y=1.0, theta=3.1))
        await drive.known()
        await adapter.start(Dock(action_id="d", stamp=0.0))
        await drive.moving()


async def test_invalid_map_is_reported_and_replaced_by_a_valid_one():
    adapter = without_site()
    async with driving(adapter) as drive:
        adapter.take_floorplan(msgspec.structs.replace(office(), image="iVBORw0KGgo="))
        await drive.until(
            lambda: drive.state is not None and any("image" in text for text in drive.state.errors)
        )
        with pytest.raises(AdapterError, match="image"):
            await adapter.start(Relocalize(action_id="r", stamp=0.0))
        adapter.take_floorplan(office())
        await drive.until(lambda: adapter.node.ready)


async def test_robot_with_a_site_ignores_other_maps():
    adapter = made()
    adapter.take_floorplan(msgspec.structs.replace(office(), map_id="elsewhere"))
    assert adapter._area.map_id == "office"
    assert adapter.node.starts == 0


async def test_next_agent_starts_at_the_last_pose(tmp_path):
    memory = tmp_path / "agent" / "pose.json"
    first = without_site(memory)
    async with driving(first) as drive:
        first.take_floorplan(office())
        await drive.until(lambda: first.node.ready)
        await first.start(Relocalize(action_id="r", stamp=0.0, x=5.0, y=1.0, theta=3.1))
        ended = await drive.ended("r")
        assert ended.status == "FINISHED"
        assert ended.result["score"] >= 0.5
        await drive.known()
    assert (await recalled(memory)).distance(Pose2D(5.0, 1.0, 3.1)) < 0.2
    second = without_site(memory)
    async with driving(second) as drive:
        second.take_floorplan(office())
        await drive.known()
        assert math.hypot(drive.state.pose.x - 5.0, drive.state.pose.y - 1.0) < 0.2


async def test_malformed_pose_memory_is_ignored(tmp_path):
    path = tmp_path / "pose.json"
    assert await recalled(None) is None
    assert await recalled(path) is None
    for text in (
        "nonsense",
        "[]",
        '{"map_id": "office"}',
        '{"map_id": "office", "x": 1, "y": NaN, "theta": 0}',
        '{"map_id": "flat", "x": 1, "y": 1, "theta": 0}',
    ):
        path.write_text(text)
        assert await recalled(path) is None


async def test_states_arrive_without_a_navigation_process():
    adapter = without_site()
    await adapter.connect()
    assert len(await some(adapter.states(), 10)) == 10
    await adapter.close()
